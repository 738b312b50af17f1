"""The table of all that is stored of a finished run: one line for every field."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from operator import attrgetter
from typing import Any, Final, Literal

from numpy.typing import NDArray

from fvi_cli.integrator.method import method_columns
from fvi_cli.integrator.observe.request import Event, Impact
from fvi_cli.integrator.trajectory import Extent, Observed
from fvi_cli.storage.files import escape_text
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.order import damping_orders

Form = Literal["plain", "json", "words"]
"""How an attribute is written: unchanged, as JSON text, or as text that is escaped when read."""


@dataclass(frozen=True)
class Field:
    """One attribute or array that is stored of a finished run."""

    name: str  # name of the attribute or array; * stands for a name that a user has chosen
    meaning: str  # for readers of the file
    # attribute path in a FinishedRun, from which the value is taken and to which it is read back;
    # no value is stored where a part of the path is None. Or a function that returns a value which
    # is not read back
    at: str | Callable[[FinishedRun], Any]
    axes: tuple[str, ...] = ()  # axes of an array; empty: an attribute
    form: Form = "plain"  # how an attribute is written and read back
    decode: Callable[[Any], Any] = lambda value: value

    @functools.cached_property
    def given(self) -> Callable[[FinishedRun], Any]:
        """A function that returns the value of a finished run; for a name with * all values."""
        return self.at if callable(self.at) else attrgetter(self.at.partition(".*")[0])


def _extents(finished: FinishedRun) -> dict[str, Any] | None:
    """Peaks and other extents of quantities, with their expressions."""
    observed = finished.trajectory.observed
    if observed is None or not observed.quantities:
        return None
    formulas = finished.run.experiment.observations.quantities or {}
    return {
        name: {"expression": formulas[name].text, **_nulled(asdict(observed.extents[name]))}
        for name in observed.quantities
    }


def _nulled(values: Mapping[str, float]) -> dict[str, float | None]:
    return {key: float(one) if math.isfinite(one) else None for key, one in values.items()}


def read_extents(stored: Mapping[str, Any]) -> dict[str, Extent]:
    """The extents by the names of quantities, read back."""
    names = [one.name for one in fields(Extent)]
    return {
        escape_text(name): Extent(
            # files of old versions lack the error
            **{k: math.nan if one.get(k) is None else float(one[k]) for k in names}
        )
        for name, one in stored.items()
    }


def _counts(finished: FinishedRun) -> dict[str, Any] | None:
    """How often events happened, with their expressions."""
    observed, observations = finished.trajectory.observed, finished.run.experiment.observations
    if observed is None or not observed.events:
        return None
    sources: dict[str, Event | Impact] = {
        **(observations.events or {}),
        **(observations.impacts or {}),
    }
    return {
        name: {"when": sources[name].when.text, "count": int(one.time.size)}
        for name, one in observed.events.items()
    }


def _degree(finished: FinishedRun) -> int | str:
    degree = method_columns(finished.run.method)["degree"]
    return degree if degree == "-" else int(degree)


def _column(name: str) -> Callable[[FinishedRun], str]:
    return lambda finished: method_columns(finished.run.method)[name]


def _mesh(finished: FinishedRun) -> NDArray[Any] | None:
    """Points of works and energies, or of a single run whose output times are others; or None."""
    observed, diagnostics = finished.trajectory.observed, finished.trajectory.diagnostics
    if diagnostics is not None:
        return diagnostics.time
    if observed is None or finished.run.member is not None:
        return None
    return None if finished.run.experiment.observations.times is None else observed.mesh


def _texts(values: list[str]) -> tuple[str, ...]:
    return tuple(map(escape_text, values))


TIME: Final = "time"
OCCURRENCE: Final = "occurrence"
MESH: Final = "mesh"
_EVENT = f"events/*/{OCCURRENCE}"
_D, _O, _N, _A = (
    "trajectory.diagnostics.", "trajectory.observed.", "trajectory.newton.", "assurance."
)  # fmt: skip

FIELDS: Final[tuple[Field, ...]] = (
    Field("time", "time", "trajectory.time", (TIME,)),
    Field("position", "position", "trajectory.position", (TIME, "dof")),
    Field("momentum", "momentum", "trajectory.momentum", (TIME, "dof")),
    Field("energy", "Hamiltonian without forcing", "trajectory.energy", (TIME,)),
    Field("dissipated_work", "work done against the damping since the start",
          _D + "dissipated_work", (MESH,)),
    Field("forcing_work", "work done by the forcing since the start", _D + "forcing_work", (MESH,)),
    Field("energy_defect",
          "energy less its start, plus dissipated work, less work of the forcing",
          _D + "energy_defect", (MESH,)),
    Field("stored_energy", "energy in the memory of the damping", _D + "stored_energy", (MESH,)),
    Field(MESH, "points of the steps", _mesh, (MESH,)),
    Field("quantities/*", "quantity *", _O + "quantities.*", (TIME,)),
    Field("events/*/time", "time at the event *", _O + "events.*.time", (_EVENT,)),
    Field("events/*/position", "position at the event *", _O + "events.*.position",
          (_EVENT, "dof")),
    Field("events/*/velocity", "velocity at the event *", _O + "events.*.velocity",
          (_EVENT, "dof")),
    Field("experiment", "experiment", lambda f: f.run.experiment.name),
    Field("case", "method in files", lambda f: f.run.method.case),
    Field("cq", "convolution quadrature", _column("cq")),
    Field("sampling", "where the motion is sampled", _column("sampling")),
    Field("degree", "degree of the trial functions", _degree),
    Field("quadrature", "quadrature of the forces", _column("quadrature")),
    Field("start", "start", _column("start")),
    Field("gamma", "orders of the damping",
          lambda f: damping_orders(f.run.member or f.run.experiment)),
    Field("n_steps", "number of steps", "trajectory.n_steps"),
    Field("step_size", "step size", "trajectory.step_size"),
    Field("norm", "norm of the error", lambda f: f.run.experiment.norm),
    Field("error", "error in the norm that the runs name", "error"),
    Field("error_max", "error in the maximum norm", "measured.max"),
    Field("error_final", "error at the final time", "measured.final"),
    Field("error_l2", "error in the norm l2", "measured.l2"),
    Field("largest", "largest position of the reference", "measured.largest"),
    Field("round_off", "error by round-off, relative to the largest position",
          "measured.round_off"),
    Field("reference_error", "error of the reference", "measured.reference"),
    Field("floor", "errors below are round-off or the reference's own", "floor"),
    Field("expected_order", "order on smooth data", "expected_order"),
    Field("reference", "what the error is measured against", "reference", form="words"),
    Field("status", "what was observed", "status"),
    Field("predicted", "what the stability analysis said", "predicted"),
    Field("integration_status", "how the integration ended", "trajectory.status"),
    Field("message", "what happened where it is not ok", "trajectory.message", form="words"),
    Field("remarks", "what a reader should know", "trajectory.remarks", form="json", decode=_texts),
    Field("coordinates", "names of the coordinates", "trajectory.coordinates", form="json",
          decode=_texts),
    Field("setup_seconds", "time for weights and factorisations in seconds",
          "trajectory.setup_seconds"),
    Field("stepping_seconds", "time for the steps in seconds", "trajectory.stepping_seconds"),
    Field("history_operations", "multiply-adds spent on the memory",
          "trajectory.history_operations"),
    Field("newton_iterations", "Newton's iterations", _N + "iterations"),
    Field("newton_largest", "most iterations of a step", _N + "largest"),
    Field("store_every", "every n-th point is kept", "trajectory.every"),
    Field("stopped_by", "event that ended the run", _O + "stopped_by", form="words"),
    Field("quantity_extents", "how large quantities become", _extents, form="json"),
    Field("event_counts", "how often events happened", _counts, form="json"),
    Field("tolerance", "largest error that was asked for", _A + "tolerance"),
    Field("estimate", "estimated error", _A + "estimate"),
    Field("attempts", "what was tried", _A + "attempts", form="json", decode=_texts),
    Field("outcome", "whether the tolerance is met", _A + "outcome"),
    Field("relative", "share of the largest position that was asked for", _A + "relative"),
)  # fmt: skip

AXES: Final[Mapping[str, str]] = {
    "dof": "degree of freedom",
}
"""Axes that have no values of their own."""


@functools.lru_cache(maxsize=4096)
def field_named(name: str) -> Field | None:
    """The field of a name; None: this version does not know the name."""
    parts = name.split("/")
    for one in FIELDS:
        own = one.name.split("/")
        if len(own) == len(parts) and all(a in ("*", b) for a, b in zip(own, parts, strict=True)):
            return one
    return None


def meaning_of(name: str) -> str:
    """The meaning of an attribute, array or axis, for readers of the file."""
    found = field_named(name)
    if found is None:
        return AXES.get(name, name.replace("_", " "))
    return found.meaning.replace("*", name.split("/")[1]) if "*" in found.name else found.meaning


def named_as(name: str, axis: str) -> str:
    """A path or axis of the table with * replaced by the name that a user has chosen."""
    return axis.replace("*", name.split("/")[1]) if "*" in axis else axis


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservedSummary:
    """Quantities and events of a run."""

    # extents (peak, rms, ...) of every quantity, by name
    extents: Mapping[str, Extent] = field(default_factory=dict)
    # how often every event happened, by name
    counts: Mapping[str, int] = field(default_factory=dict)
    stopped_by: str = ""  # event that ended the run, or empty


EMPTY_SUMMARY: Final = ObservedSummary()


def summary_of(observed: Observed | None) -> ObservedSummary:
    """The summary of quantities and events of a run."""
    if observed is None:
        return EMPTY_SUMMARY
    return ObservedSummary(
        extents=observed.extents,
        counts={name: one.time.size for name, one in observed.events.items()},
        stopped_by=observed.stopped_by,
    )


def observed_summary(attributes: Mapping[str, Any]) -> ObservedSummary:
    """The same from the stored attributes of a run."""
    counts = json.loads(attributes.get("event_counts", "{}"))
    return ObservedSummary(
        extents=read_extents(json.loads(attributes.get("quantity_extents", "{}"))),
        counts={escape_text(name): int(one["count"]) for name, one in counts.items()},
        stopped_by=escape_text(str(attributes.get("stopped_by", ""))),
    )
