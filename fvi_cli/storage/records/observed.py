"""What is said of the quantities and events of a run without their arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from fvi_cli.integrator.results.observed import Extent, Observed
from fvi_cli.storage.files import printable
from fvi_cli.storage.records.fields import extents_of


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservedSummary:
    """Quantities and events of a run."""

    # how large every quantity becomes, by name
    extents: Mapping[str, Extent] = field(default_factory=dict)
    # how often every event happened, by name
    counts: Mapping[str, int] = field(default_factory=dict)
    stopped_by: str = ""  # event that ended the run, or empty


EMPTY_SUMMARY: Final = ObservedSummary()


def summary_of(observed: Observed | None) -> ObservedSummary:
    """What is said of what was observed."""
    if observed is None:
        return EMPTY_SUMMARY
    return ObservedSummary(
        extents=observed.extents,
        counts={name: one.time.size for name, one in observed.events.items()},
        stopped_by=observed.stopped_by,
    )


def observed_summary(attributes: Mapping[str, Any]) -> ObservedSummary:
    """The same from the attributes of a run."""
    counts = json.loads(attributes.get("event_counts", "{}"))
    return ObservedSummary(
        extents=extents_of(json.loads(attributes.get("quantity_extents", "{}"))),
        counts={printable(name): int(one["count"]) for name, one in counts.items()},
        stopped_by=printable(str(attributes.get("stopped_by", ""))),
    )
