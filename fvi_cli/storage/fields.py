"""The table of all that is stored of a finished run: one line for every field.

Result files, ``fvi show``, JSON documents and data frames have their names from here.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from operator import attrgetter
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.request import Event, Impact
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.tables import step_tables
from fvi_cli.integrator.trajectory import (
    Assessment,
    Diagnostics,
    Extent,
    NewtonRecord,
    Observed,
    Occurrences,
    Trajectory,
)
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.norms import Measured


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
    form: Literal["plain", "json"] = "plain"  # how an attribute is written

    @functools.cached_property
    def get(self) -> Callable[[FinishedRun], Any]:
        """A function that returns the value of a finished run; for a name with * all values."""
        return self.at if callable(self.at) else attrgetter(self.at.partition(".*")[0])


def _extents(finished: FinishedRun) -> dict[str, Any] | None:
    """Peaks and other extents of quantities, with their expressions."""
    observed = finished.trajectory.observed
    if observed is None or not observed.extents:
        return None
    formulas = finished.run.experiment.observations.quantities or {}
    return {
        name: {"expression": formulas[name].text, **_without_nan(asdict(extent))}
        for name, extent in observed.extents.items()
    }


def _without_nan(values: Mapping[str, float]) -> dict[str, float | None]:
    return {key: float(one) if math.isfinite(one) else None for key, one in values.items()}


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


def _mesh(finished: FinishedRun) -> NDArray[Any] | None:
    """Points of works and energies, or of a single run whose output times are others; or None."""
    observed, diagnostics = finished.trajectory.observed, finished.trajectory.diagnostics
    if diagnostics is not None:
        return diagnostics.time
    if observed is None or finished.run.member is not None:
        return None
    return None if finished.run.experiment.observations.times is None else observed.mesh


def _steps(finished: FinishedRun, name: str) -> NDArray[Any] | None:
    steps = finished.trajectory.steps
    return None if steps is None else np.asarray(getattr(steps, name))


def steps_in(run: Run, arrays: Mapping[str, NDArray[Any]]) -> RunSteps | None:
    """The polynomials of the steps of stored velocities at the stages; None: none are stored."""
    if STAGES not in arrays or not isinstance(run.method, Method):
        return None
    time, velocity, tables = arrays[POINTS], arrays[STAGES], step_tables(run.method)
    sizes, start = np.diff(time), run.scene.initial_position[None]
    # a polynomial ends at its last control point
    moved = sizes[:, None] * np.einsum("r,nrd->nd", tables.to_unknowns[-1], velocity)
    position = np.concatenate([start, start + np.cumsum(moved, axis=0)])
    return RunSteps(
        tables=tables,
        time=time,
        position=position,
        momentum=np.full(position.shape, math.nan),
        step_size=sizes,
        velocity=velocity,
    )


TIME: Final = "time"
STAGES: Final = "stages"
POINTS: Final = "stage_mesh"
OCCURRENCE: Final = "occurrence"
MESH: Final = "mesh"
EXTENTS: Final = "quantity_extents"
COUNTS: Final = "event_counts"
_EVENT = f"events/*/{OCCURRENCE}"
_T = "trajectory."
_D, _O, _N, _A = _T + "diagnostics.", _T + "observed.", _T + "newton.", _T + "assessment."

FIELDS: Final[tuple[Field, ...]] = (
    Field("time", "time", _T + "time", (TIME,)),
    Field("position", "position", _T + "position", (TIME, "dof")),
    Field("momentum", "momentum", _T + "momentum", (TIME, "dof")),
    Field("energy", "Hamiltonian without forcing", _T + "energy", (TIME,)),
    Field("dissipated_work", "work done against the damping since the start",
          _D + "dissipated_work", (MESH,)),
    Field("forcing_work", "work done by the forcing since the start", _D + "forcing_work", (MESH,)),
    Field("energy_defect",
          "energy less its start, plus dissipated work, less work of the forcing",
          _D + "energy_defect", (MESH,)),
    Field("stored_energy", "energy in the memory of the damping", _D + "stored_energy", (MESH,)),
    Field(MESH, "points of the steps", _mesh, (MESH,)),
    Field(POINTS, "points of the steps of the stages", lambda f: _steps(f, "time"), (POINTS,)),
    Field(STAGES, "velocity at the stages of the steps", lambda f: _steps(f, "velocity"),
          ("step", "stage", "dof")),
    Field("quantities/*", "quantity *", _O + "quantities.*", (TIME,)),
    Field("events/*/time", "time at the event *", _O + "events.*.time", (_EVENT,)),
    Field("events/*/position", "position at the event *", _O + "events.*.position",
          (_EVENT, "dof")),
    Field("events/*/velocity", "velocity at the event *", _O + "events.*.velocity",
          (_EVENT, "dof")),
    Field("method", "method", lambda f: f.run.method_label),
    Field("case", "method in names of groups and files", lambda f: f.run.method.case),
    Field("n_steps", "number of steps", _T + "n_steps"),
    Field("step_size", "step size", _T + "step_size"),
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
    Field("order_smooth", "order on smooth data", "order_smooth"),
    Field("reference", "what the error is measured against", "reference"),
    Field("status", "what was observed", "status"),
    Field("predicted", "what the stability analysis said", "predicted"),
    Field("integration_status", "how the integration ended", _T + "status"),
    Field("message", "what happened where it is not ok", _T + "message"),
    Field("remarks", "what a reader should know", _T + "remarks", form="json"),
    Field("coordinates", "names of the coordinates", _T + "coordinates", form="json"),
    Field("setup_seconds", "time for weights and factorisations in seconds", _T + "setup_seconds"),
    Field("seconds", "time for the steps in seconds", _T + "stepping_seconds"),
    Field("history_operations", "multiply-adds spent on the memory", _T + "history_operations"),
    Field("newton_iterations", "Newton's iterations", _N + "iterations"),
    Field("newton_largest", "most iterations of a step", _N + "largest"),
    Field("store_every", "every n-th point is kept", _T + "every"),
    Field("stopped_by", "event that ended the run", _O + "stopped_by"),
    Field(EXTENTS, "how large quantities become", _extents, form="json"),
    Field(COUNTS, "how often events happened", _counts, form="json"),
    Field("tolerance", "largest error that was asked for", _A + "tolerance"),
    Field("estimate", "estimated error", _A + "estimate"),
    Field("attempts", "what was tried", _A + "attempts", form="json"),
    Field("outcome", "whether the tolerance is met", _A + "outcome"),
    Field("relative", "share of the largest position that was asked for",
          lambda f: f.run.experiment.accuracy and f.run.experiment.accuracy.relative),
)  # fmt: skip

JSON_FIELDS: Final = frozenset(one.name for one in FIELDS if one.form == "json")
"""Values of several entries."""

CLASSES: Final[Mapping[str, type]] = {
    "measured": Measured,
    "trajectory": Trajectory,
    "trajectory.assessment": Assessment,
    "trajectory.newton": NewtonRecord,
    "trajectory.diagnostics": Diagnostics,
    "trajectory.observed": Observed,
}
"""Classes by the path at which they stand in a finished run."""

AXES: Final[Mapping[str, str]] = {
    "dof": "degree of freedom",
    "step": "step",
    "stage": "stage of a step",
}
"""Axes that have no values of their own."""

_NOTHING: Final[Mapping[str, NDArray[Any]]] = {"time": np.zeros(0), "position": np.zeros((0, 1))}
"""Arrays of a run that is read without its motion."""


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


def axes_of(name: str) -> tuple[str, ...]:
    """The axes of an array, which follow from its name; empty for a value."""
    found = field_named(name)
    return () if found is None else tuple(_named(name, axis) for axis in found.axes)


def _named(name: str, path: str) -> str:
    """A path or axis of the table with * replaced by the name that a user has chosen."""
    return path.replace("*", name.split("/")[1]) if "*" in path else path


def values_of(finished: FinishedRun) -> dict[str, Any]:
    """The values of a finished run by the names of the table: text, numbers, lists of numbers.

    Texts with several entries are JSON.
    """
    found = {}
    for one in FIELDS:
        if not one.axes:
            for name, value in _given(one, finished):
                written = _written(one, value)
                if written is not None:
                    found[name] = written
    return found


def arrays_of(finished: FinishedRun) -> dict[str, NDArray[Any]]:
    """The arrays of a finished run by the names of the table."""
    return {
        name: np.asarray(value, dtype="<f8")
        for one in FIELDS
        if one.axes
        for name, value in _given(one, finished)
    }


def _given(one: Field, finished: FinishedRun) -> Iterator[tuple[str, Any]]:
    """Name and value of a field, as often as there is one."""
    try:
        found = one.get(finished)
    except AttributeError:
        if callable(one.at):
            raise
        return  # something on the way is None
    if found is None:
        return
    if callable(one.at) or "*" not in one.at:
        yield one.name, found
        return
    after = one.at.partition(".*")[2]
    for name, inner in found.items():
        yield one.name.replace("*", name), attrgetter(after[1:])(inner) if after else inner


def _written(one: Field, value: Any) -> Any:
    """A value as text, int, float or list of floats; None for nothing at all."""
    if one.form == "json":
        # that a run has no remarks is stored too
        return json.dumps(value, ensure_ascii=False) if value or one.name == "remarks" else None
    return value.item() if isinstance(value, np.generic) else value


def finished_of(
    run: Run, values: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> FinishedRun:
    """The finished run of stored values and arrays; what is missing takes its default.

    Without arrays the run has no points. Errors are stored in all norms: where the experiment asks
    for another one, the run is judged anew.
    """
    objects: dict[str, dict[str, Any]] = {"": {}, "trajectory": {}}
    for name, value in (*values.items(), *({**_NOTHING, **arrays}).items()):
        place = _place(name)
        if place is not None and value is not None:
            above, last, is_json = place
            objects.setdefault(above, {})[last] = _entries(value) if is_json else value
    if (path := "trajectory.diagnostics") in objects:
        objects[path]["time"] = arrays[MESH]
    if "stopped_by" in values:
        _observe(objects, values, arrays)
    objects["trajectory"]["steps"] = steps_in(run, arrays)
    # inner objects first
    for path in sorted(objects, key=len, reverse=True):
        if path:
            above, _, last = path.rpartition(".")
            made = CLASSES[path](**objects[path]) if path in CLASSES else objects[path]
            objects.setdefault(above, {})[last] = made
    found = FinishedRun(run=run, **objects[""])
    if found.measured is None or values["norm"] == run.experiment.norm:
        return found
    # most commands read runs in the norm that they have, and need not wait for this import
    from fvi_cli.studies.study import judged, order_smooth_of

    own = judged(run, found.trajectory.status, found.measured)
    return replace(found, order_smooth=order_smooth_of(run), **own)


@functools.lru_cache(maxsize=4096)
def _place(name: str) -> tuple[str, str, bool] | None:
    """The object and attribute to which a value is read back, and whether it is JSON."""
    one = field_named(name)
    if one is None or callable(one.at):
        return None
    above, _, last = _named(name, one.at).rpartition(".")
    return above, last, one.form == "json"


@functools.lru_cache(maxsize=4096)
def _entries(text: str) -> tuple[str, ...]:
    return tuple(json.loads(text))


def _observe(
    objects: dict[str, dict[str, Any]],
    values: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
) -> None:
    """Put the observed quantities and events where they stand."""
    observed = objects.setdefault("trajectory.observed", {})
    observed["mesh"] = arrays.get(MESH, arrays.get(TIME, _NOTHING[TIME]))
    observed["extents"] = extents_in(values)
    prefix = "trajectory.observed.events."
    events = {path[len(prefix) :]: path for path in objects if path.startswith(prefix)}
    observed["events"] = {name: Occurrences(**objects.pop(path)) for name, path in events.items()}


def extents_in(values: Mapping[str, Any]) -> dict[str, Extent]:
    """The extents (peak, rms, ...) of quantities by name, from stored values."""
    names = [one.name for one in fields(Extent)]
    return {
        quantity: Extent(**{k: math.nan if one.get(k) is None else float(one[k]) for k in names})
        for quantity, one in json.loads(values.get(EXTENTS) or "{}").items()
    }


def counts_in(values: Mapping[str, Any]) -> dict[str, int]:
    """How often every event happened, from stored values."""
    return dict(_counted(values.get(COUNTS) or "{}"))


@functools.lru_cache(maxsize=4096)
def _counted(text: str) -> tuple[tuple[str, int], ...]:
    return tuple((name, int(one["count"])) for name, one in json.loads(text).items())
