"""What was observed of a motion as datasets and attributes of its run, and back."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.observations.asked import Event, Impact, Observations
from fvi_cli.integrator.results.observed import Extent, Observed, Occurrences
from fvi_cli.storage.files import printable

QUANTITIES: Final = "quantities"
EVENTS: Final = "events"
STOPPED_BY: Final = "stopped_by"
EXTENTS, COUNTS = "quantity_extents", "event_counts"
"""Attributes, as JSON by name."""
MESH: Final = "mesh"
ROOMS: Final = (QUANTITIES, EVENTS)
"""Groups inside of the group of a run."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservedSummary:
    """What is said of the quantities and events of a run without their arrays.

    Parameters
    ----------
    extents
        How large every quantity becomes, by name.
    counts
        How often every event happened, by name.
    stopped_by
        Event that ended the run, or empty.
    """

    extents: Mapping[str, Extent] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)
    stopped_by: str = ""


NOTHING_OBSERVED: Final = ObservedSummary()

_PARTS: Final = ("time", "position", "velocity")
OCCURRENCE: Final = "occurrence"
"""Axis of an event of the members of a sweep, whose times differ."""


def observed_dimensions(name: str, *, of_members: bool = False) -> tuple[str, ...] | None:
    """Names of the axes of a dataset that was observed; None for any other name.

    Those of members come after the one along the members.
    """
    room, _, rest = name.partition("/")
    if room == QUANTITIES and rest:
        return ("time",)
    if room == EVENTS and rest:
        event, _, part = name.rpartition("/")
        own = f"{event}/{OCCURRENCE if of_members or part == OCCURRENCE else 'time'}"
        return (own, "dof") if part in _PARTS[1:] else (own,)
    return (MESH,) if name == MESH else None


def occurrences(name: str, attributes: Mapping[str, Any]) -> int:
    """How often the event of a dataset happened, as the attributes of a run have it."""
    told = json.loads(attributes.get(COUNTS) or "{}")
    event = name.removeprefix(f"{EVENTS}/").rpartition("/")[0]
    return int(told[event]["count"]) if event in told else 0


def observed_meaning(name: str) -> str:
    """What a dataset that was observed is."""
    room, _, rest = name.partition("/")
    if room == QUANTITIES:
        return f"quantity {rest}"
    event, _, part = rest.rpartition("/")
    return f"{part} at the event {event}" if room == EVENTS else "points of the steps"


def observed_datasets(observed: Observed | None, *, has_mesh: bool) -> dict[str, NDArray[Any]]:
    """The datasets by name."""
    if observed is None:
        return {}
    found: dict[str, NDArray[Any]] = {MESH: observed.mesh} if has_mesh else {}
    for name, values in observed.quantities.items():
        found[f"{QUANTITIES}/{name}"] = np.asarray(values)
    for name, one in observed.events.items():
        found |= {f"{EVENTS}/{name}/{part}": getattr(one, part) for part in _PARTS}
    return found


def observed_attributes(observed: Observed | None, asked: Observations) -> dict[str, str]:
    """The attributes of a run that belong to what was observed."""
    if observed is None:
        return {}
    found: dict[str, str] = {STOPPED_BY: observed.stopped_by}
    if observed.quantities:
        expressions = asked.quantities or {}
        told = {
            name: {
                "expression": expressions[name].text,
                **{key: _null(value) for key, value in asdict(observed.extents[name]).items()},
            }
            for name in observed.quantities
        }
        found[EXTENTS] = json.dumps(told, ensure_ascii=False)
    if observed.events:
        sources: dict[str, Event | Impact] = {**(asked.events or {}), **(asked.impacts or {})}
        counts = {
            name: {"when": sources[name].when.text, "count": int(one.time.size)}
            for name, one in observed.events.items()
        }
        found[COUNTS] = json.dumps(counts, ensure_ascii=False)
    return found


def observed_of(
    attributes: Mapping[str, Any], datasets: Mapping[str, NDArray[Any]]
) -> Observed | None:
    """What was observed again; None if there is nothing.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it is not as it was written.
    """
    if STOPPED_BY not in attributes:
        return None
    told = observed_summary(attributes)
    return Observed(
        mesh=datasets.get(MESH, datasets["time"]),
        quantities={name: datasets[f"{QUANTITIES}/{name}"] for name in told.extents},
        extents=told.extents,
        events={
            name: Occurrences(**{part: datasets[f"{EVENTS}/{name}/{part}"] for part in _PARTS})
            for name in told.counts
        },
        stopped_by=told.stopped_by,
    )


def summary_of(observed: Observed | None) -> ObservedSummary:
    """What is said of what was observed."""
    if observed is None:
        return NOTHING_OBSERVED
    return ObservedSummary(
        extents=observed.extents,
        counts={name: one.time.size for name, one in observed.events.items()},
        stopped_by=observed.stopped_by,
    )


def observed_summary(attributes: Mapping[str, Any]) -> ObservedSummary:
    """The same from the attributes of a run.

    Raises
    ------
    KeyError, TypeError, ValueError
        If they are not as they were written.
    """
    told = json.loads(attributes.get(EXTENTS) or "{}")
    names = [field.name for field in fields(Extent)]
    return ObservedSummary(
        extents={
            printable(name): Extent(**{key: _number(one[key]) for key in names})
            for name, one in told.items()
        },
        counts={
            printable(name): int(one["count"])
            for name, one in json.loads(attributes.get(COUNTS) or "{}").items()
        },
        stopped_by=printable(str(attributes.get(STOPPED_BY, ""))),
    )


def _null(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
