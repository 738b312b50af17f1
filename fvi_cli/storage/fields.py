"""The table of all that is stored of a finished run: one line for every field.

Result files, ``fvi show``, JSON documents and data frames have their names from here.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.method import Method
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.tables import step_tables
from fvi_cli.integrator.trajectory import (
    Assessment,
    Diagnostics,
    Extent,
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
    is_json: bool = False  # a list or a mapping, which is written as JSON


def _extents(finished: FinishedRun) -> dict[str, Any] | None:
    """Peaks and other extents of quantities; JSON has no nan."""
    observed = finished.trajectory.observed
    if observed is None:
        return None
    return {
        name: {key: value if math.isfinite(value) else None for key, value in vars(one).items()}
        for name, one in observed.extents.items()
    }


def _counts(finished: FinishedRun) -> dict[str, int] | None:
    """How often events happened."""
    observed = finished.trajectory.observed
    if observed is None:
        return None
    return {name: int(one.time.size) for name, one in observed.events.items()}


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
_D, _O, _A = _T + "diagnostics.", _T + "observed.", _T + "assessment."

FIELDS: Final[dict[str, Field]] = {one.name: one for one in (
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
    Field("remarks", "what a reader should know", _T + "remarks", is_json=True),
    Field("coordinates", "names of the coordinates", _T + "coordinates", is_json=True),
    Field("seconds", "time of the run in seconds", _T + "seconds"),
    Field("history_operations", "multiply-adds spent on the memory", _T + "history_operations"),
    Field("newton_iterations", "Newton's iterations", _T + "newton_iterations"),
    Field("store_every", "every n-th point is kept", lambda f: f.run.experiment.store_every),
    Field("stopped_by", "event that ended the run", _O + "stopped_by"),
    Field(EXTENTS, "how large quantities become", _extents, is_json=True),
    Field(COUNTS, "how often events happened", _counts, is_json=True),
    Field("tolerance", "largest error that was asked for", _A + "tolerance"),
    Field("estimate", "estimated error", _A + "estimate"),
    Field("relative", "share of the largest position that was asked for",
          lambda f: f.run.experiment.accuracy and f.run.experiment.accuracy.relative),
)}  # fmt: skip

_NOTHING: Final[Mapping[str, NDArray[Any]]] = {"time": np.zeros(0), "position": np.zeros((0, 1))}
"""Arrays of a run that is read without its motion."""


def field_named(name: str) -> Field | None:
    """The field of a name; None: this version does not know the name."""
    first, *rest = name.split("/")
    return FIELDS.get("/".join([first, "*", *rest[1:]]) if rest else first)


@functools.lru_cache(maxsize=4096)
def axes_of(name: str) -> tuple[str, ...]:
    """The axes of an array, which follow from its name; empty for a value."""
    found = field_named(name)
    return () if found is None else tuple(_named(name, axis) for axis in found.axes)


def _named(name: str, text: str) -> str:
    """A text of the table with the name that a user has chosen in place of *."""
    return text.replace("*", name.split("/")[1]) if "*" in text else text


def values_of(finished: FinishedRun) -> dict[str, Any]:
    """The values of a finished run by the names of the table: text, numbers, lists, mappings."""
    return {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in _given(finished, are_arrays=False)
    }


def arrays_of(finished: FinishedRun) -> dict[str, NDArray[Any]]:
    """The arrays of a finished run by the names of the table."""
    given = _given(finished, are_arrays=True)
    return {name: np.asarray(value, dtype="<f8") for name, value in given}


def _given(finished: FinishedRun, *, are_arrays: bool) -> Iterator[tuple[str, Any]]:
    """Name and value of every field that a run has."""
    for one in FIELDS.values():
        if bool(one.axes) != are_arrays:
            continue
        found: Any
        if callable(one.at):
            found, many = one.at(finished), ""
        else:
            found, (above, many, after) = finished, one.at.partition(".*")
            for part in above.split("."):
                # nothing is stored where something on the way is None
                found = None if found is None else getattr(found, part)
        if found is not None and not many:
            yield one.name, found
        elif found is not None:
            for name, inner in found.items():
                yield one.name.replace("*", name), attrgetter(after[1:])(inner) if after else inner


def finished_of(
    run: Run, values: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> FinishedRun:
    """The finished run of stored values and arrays; what is missing takes its default.

    Without arrays the run has no points. Errors are stored in all norms: where the experiment asks
    for another one, the run is judged anew.
    """
    tree: dict[str, Any] = {}
    for name, value in {**values, **_NOTHING, **arrays}.items():
        node, path = tree, _place(name)
        for part in path[:-1]:
            node = node.setdefault(part, {})
        for last in path[-1:]:
            node[last] = tuple(value) if isinstance(value, list) else value
    trajectory = tree.pop("trajectory")
    if not run.experiment.observations.is_empty:
        trajectory["observed"] = _observed(trajectory.pop("observed", {}), values, arrays)
    if "diagnostics" in trajectory:
        trajectory["diagnostics"]["time"] = arrays[MESH]
        trajectory["diagnostics"] = Diagnostics(**trajectory["diagnostics"])
    trajectory["assessment"] = _made(Assessment, trajectory.get("assessment", {}))
    measured = _made(Measured, tree.pop("measured", {}))
    motion = Trajectory(**trajectory, steps=steps_in(run, arrays))
    found = FinishedRun(run=run, trajectory=motion, measured=measured, **tree)
    if measured is None or values["norm"] == run.experiment.norm:
        return found
    # most commands read runs in the norm that they have, and need not wait for this import
    from fvi_cli.studies.study import judged, order_smooth_of

    return replace(found, order_smooth=order_smooth_of(run), **judged(run, motion.status, measured))


@functools.lru_cache(maxsize=4096)
def _place(name: str) -> tuple[str, ...]:
    """The attribute path to which a value is read back; empty: none."""
    one = field_named(name)
    return () if one is None or callable(one.at) else tuple(_named(name, one.at).split("."))


def _made(kind: Callable[..., Any], own: Mapping[str, Any]) -> Any:
    """An object, or None; members of a sweep have nan where others have a value."""
    is_there = not all(isinstance(one, float) and math.isnan(one) for one in own.values())
    return kind(**own) if is_there else None


def _observed(
    found: Mapping[str, Any], values: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> Observed:
    """The quantities and events."""
    mesh = arrays.get(MESH, arrays.get(TIME, _NOTHING[TIME]))
    events = {name: Occurrences(**one) for name, one in found.get("events", {}).items()}
    return Observed(**{**found, "mesh": mesh, "events": events, "extents": extents_in(values)})


def extents_in(values: Mapping[str, Any]) -> dict[str, Extent]:
    """The extents (peak, rms, ...) of quantities by name, from stored values."""
    return {
        quantity: Extent(**{k: math.nan if v is None else v for k, v in one.items()})
        for quantity, one in values.get(EXTENTS, {}).items()
    }
