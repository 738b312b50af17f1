"""One finished run as attributes and arrays, and back; and what tells runs apart."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.method import method_columns
from fvi_cli.integrator.results.newton_record import NewtonRecord
from fvi_cli.integrator.trajectory import Outcome, Trajectory
from fvi_cli.scenes.problem import Problem
from fvi_cli.storage.code import own_code
from fvi_cli.storage.fields.diagnostics import (
    DIAGNOSTIC_DIMENSIONS,
    DIAGNOSTIC_NAMES,
    diagnostic_attributes,
    diagnostic_datasets,
    diagnostics_of,
)
from fvi_cli.storage.fields.observed import (
    observed_attributes,
    observed_datasets,
    observed_dimensions,
    observed_of,
    occurrences,
)
from fvi_cli.storage.files import printable
from fvi_cli.storage.provenance import SOLVER_VERSION, canonical_json, identity, origin
from fvi_cli.studies.accuracy_settings import Assurance
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.members import value_at, without_values
from fvi_cli.studies.order import damping_orders

DIMENSIONS: Mapping[str, tuple[str, ...]] = {
    "time": ("time",),
    "dof": ("dof",),
    "position": ("time", "dof"),
    "momentum": ("time", "dof"),
    "energy": ("time",),
    **DIAGNOSTIC_DIMENSIONS,
}

LONG_NAMES: Mapping[str, str] = {
    "time": "time",
    "dof": "degree of freedom",
    "position": "position",
    "momentum": "momentum",
    "energy": "Hamiltonian without forcing",
    **DIAGNOSTIC_NAMES,
    "n_steps": "number of steps",
    "step_size": "step size",
    "error": "error in the norm that the runs name",
    "seconds": "time for the steps in seconds",
    "history_operations": "multiply-adds spent on the memory",
    "status": "what was observed",
}


def dimensions_of(name: str, *, of_members: bool = False) -> tuple[str, ...] | None:
    """Names of the axes of a dataset of a run; None for what is no array of a run."""
    if name in DIMENSIONS:
        return DIMENSIONS[name]
    return observed_dimensions(name, of_members=of_members)


def rows_of(name: str, attributes: Mapping[str, Any]) -> int:
    """How many rows of a dataset along times or occurrences belong to a member of a sweep."""
    return int(attributes[POINTS]) if has_points(name) else occurrences(name, attributes)


def has_points(name: str) -> bool:
    """Whether a dataset has a value at every time of a run."""
    return "time" in (dimensions_of(name) or ())


SHARED = ("time", "dof", "map")
"""Arrays that the members of a sweep have in common."""

SWEPT, POINTS, FIELDS = "swept", "points", "fields"
"""Attributes: of a member of a sweep a JSON list of the keys in which members differ; number of
points that a run has; names of its own arrays."""

RUN_KEYS = ("method", "n_steps", "allow_unstable")
"""Keys of a run's specification in which runs of one variant of an experiment may differ."""

Form = tuple[str, ...]

Place = tuple[str, str, int, str]
"""Experiment, case, number of steps, and the values of a member of a sweep as JSON text."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """What a group of a file holds."""

    attributes: Mapping[str, Any]
    datasets: Mapping[str, NDArray[Any]]


def place_of(run: Run) -> Place:
    """Where a run belongs."""
    values = "" if run.member is None else canonical_json(dict(run.member.values))
    return run.experiment.name, sys.intern(run.method.case), run.n_steps, values


def form_of(place: Place) -> Form:
    """The keys in which the runs in the same group differ; none for a run that stands alone."""
    return tuple(sorted(json.loads(place[3]))) if place[3] else ()


def variant_of(specification: Mapping[str, Any], swept: Sequence[str] = ()) -> str:
    """What the runs of an experiment that belong together have in common, as text.

    It is the specification without :data:`RUN_KEYS` and without the values of swept keys.
    """
    shared = {k: v for k, v in specification.items() if k not in RUN_KEYS}
    if swept:
        problem = without_values(shared["problem"], tuple(swept))
        shared |= {"problem": problem, SWEPT: sorted(swept)}
    return canonical_json(shared)


def digest_of(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of names, shapes and numbers."""
    digest = hashlib.sha256()
    for name, values in arrays.items():
        numbers = np.ascontiguousarray(values, dtype=stored_kind(values))
        digest.update(f"{name}{numbers.shape}".encode())
        digest.update(numbers.data)
    return digest.hexdigest()


def stored_kind(values: NDArray[Any]) -> str:
    """Type of the numbers in a file."""
    return "<i8" if values.dtype.kind == "i" else "<f8"


def group_path(place: Place) -> str:
    """Path inside the file of the run that the file's configuration asks for."""
    experiment, case, n_steps, _ = place
    return f"/{experiment}/{case}/n{n_steps:06d}"


def record_of(finished: FinishedRun) -> Record:
    """What is stored of a finished run; the grid is thinned as its experiment asks for.

    Of a member of a sweep there is no point off the grid that all members share.
    """
    run, trajectory = finished.run, finished.trajectory
    experiment, method, newton = run.experiment, run.method, trajectory.newton
    columns: dict[str, str | int] = dict(method_columns(method))
    specification = run.specification()
    if columns["degree"] != "-":
        columns["degree"] = int(columns["degree"])
    attributes: dict[str, Any] = {
        "experiment": experiment.name,
        "case": method.case,
        **columns,
        "gamma": damping_orders(run.member or experiment),
        "n_steps": run.n_steps,
        "step_size": run.step_size,
        "norm": experiment.norm,
        "error": finished.error,
        "floor": finished.floor,
        "expected_order": finished.expected_order,
        "reference": finished.reference,
        "status": finished.status,
        "predicted": finished.predicted,
        "integration_status": trajectory.status,
        "message": trajectory.message,
        "remarks": json.dumps(list(trajectory.remarks), ensure_ascii=False),
        "setup_seconds": trajectory.setup_seconds,
        "stepping_seconds": trajectory.stepping_seconds,
        "history_operations": trajectory.history_operations,
        "newton_iterations": newton.iterations,
        "newton_largest": newton.largest,
        "newton_worst_step": newton.worst_step,
        "store_every": experiment.store_every,
        "identity": identity(run),
        "solver_version": SOLVER_VERSION,
        "code": own_code().text,
        "specification": canonical_json(specification),
        **origin(),
    }
    if finished.assurance is not None:
        attributes.update(assurance_attributes(finished.assurance))
    if newton.worst_residuals:
        attributes["newton_worst_residuals"] = np.array(newton.worst_residuals, dtype=float)
    # what has been thinned on the way is not thinned again
    every = 1 if trajectory.every > 1 else experiment.store_every
    kept = kept_points(trajectory.time.size, every)
    datasets: dict[str, NDArray[Any]] = {
        "time": trajectory.time[kept],
        "dof": np.arange(trajectory.position.shape[1]),
        "position": trajectory.position[kept],
    }
    if trajectory.momentum is not None:
        datasets["momentum"] = trajectory.momentum[kept]
    if trajectory.energy is not None:
        datasets["energy"] = trajectory.energy[kept]
    diagnostics = None if trajectory.diagnostics is None else trajectory.diagnostics.at(kept)
    datasets.update(diagnostic_datasets(diagnostics))
    attributes.update(diagnostic_attributes(diagnostics))
    found = observed_datasets(
        trajectory.observed,
        has_mesh=run.member is None and experiment.observations.times is not None,
    )
    datasets |= {
        name: values[kept] if has_points(name) else values for name, values in found.items()
    }
    attributes |= observed_attributes(trajectory.observed, experiment.observations)
    points = datasets["time"].size
    if run.member is not None:
        points = _points_on_grid(run, datasets["time"])
        # what members have in common is said once, what they differ in beside it
        keys = tuple(run.member.values)
        common = {**specification, "problem": without_values(specification["problem"], keys)}
        attributes |= {SWEPT: json.dumps(keys), "specification": canonical_json(common)}
        attributes |= {key: value_at(specification["problem"], key) for key in keys}
        datasets = {
            name: values[:points] if has_points(name) else values
            for name, values in datasets.items()
        }
    own = {name: values for name, values in datasets.items() if name not in SHARED}
    attributes |= {POINTS: points, FIELDS: ",".join(own), "data_sha256": digest_of(own)}
    return Record(attributes=attributes, datasets=datasets)


def _points_on_grid(run: Run, time: NDArray[Any]) -> int:
    """How many of the first points lie on the grid of the experiment."""
    grid = run.experiment.observations.times
    if grid is None and run.experiment.accuracy is not None:
        return time.size
    if grid is None:
        grid = run.times[kept_points(run.n_steps + 1, run.experiment.store_every)]
    common = min(time.size, grid.size)
    spacing = float(np.diff(grid).min(initial=grid[-1]))
    off = np.flatnonzero(np.abs(time[:common] - grid[:common]) > 1e-6 * spacing)
    return int(off[0]) if off.size else common


def kept_points(points: int, every: int) -> NDArray[np.intp]:
    """Every n-th point and the last one."""
    return np.unique(np.append(np.arange(0, points, every), max(points - 1, 0)))[:points]


def finished_of(record: Record, run: Run) -> FinishedRun:
    """The finished run again, its trajectory as it was stored.

    Raises
    ------
    KeyError, TypeError, ValueError
        If the record is not that of a run.
    """
    a, data = record.attributes, record.datasets
    trajectory = Trajectory(
        time=data["time"],
        position=data["position"],
        momentum=data.get("momentum"),
        energy=data.get("energy"),
        n_steps=int(a["n_steps"]),
        step_size=float(a["step_size"]),
        status=a["integration_status"],
        message=printable(a["message"]),
        history_operations=int(a["history_operations"]),
        newton=NewtonRecord(
            iterations=int(a["newton_iterations"]),
            largest=int(a["newton_largest"]),
            worst_step=int(a["newton_worst_step"]),
            worst_residuals=tuple(np.asarray(a.get("newton_worst_residuals", ())).tolist()),
        ),
        setup_seconds=float(a["setup_seconds"]),
        stepping_seconds=float(a["stepping_seconds"]),
        remarks=tuple(map(printable, json.loads(a["remarks"]))),
        every=int(a["store_every"]),
        diagnostics=diagnostics_of(a, data),
        observed=observed_of(a, data),
        coordinates=run.problem.coordinates if isinstance(run.problem, Problem) else (),
    )
    return FinishedRun(
        run=run,
        trajectory=trajectory,
        error=float(a["error"]),
        floor=float(a["floor"]),
        status=a["status"],
        predicted=a["predicted"],
        expected_order=float(a["expected_order"]),
        reference=printable(a["reference"]),
        assurance=assurance_of(a),
    )


def assurance_attributes(assurance: Assurance) -> dict[str, str | float]:
    """Attributes of a run."""
    return {
        "tolerance": assurance.tolerance,
        "estimate": assurance.estimate,
        "choice": assurance.choice,
        "attempts": json.dumps(list(assurance.attempts), ensure_ascii=False),
        "outcome": assurance.outcome,
        **({} if assurance.relative is None else {"relative": assurance.relative}),
    }


def assurance_of(attributes: Mapping[str, Any]) -> Assurance | None:
    """The assurance again; None of a run that was not made for a tolerance.

    Raises
    ------
    KeyError, TypeError, ValueError
        If the attributes are not those that were written.
    """
    if "tolerance" not in attributes:
        return None
    return Assurance(
        tolerance=float(attributes["tolerance"]),
        estimate=float(attributes["estimate"]),
        choice=str(attributes["choice"]),
        attempts=tuple(json.loads(attributes["attempts"])),
        outcome=_outcome(attributes),
        relative=float(attributes["relative"]) if "relative" in attributes else None,
    )


def _outcome(attributes: Mapping[str, Any]) -> Outcome:
    """What became of a tolerance; files of earlier versions tell by the status alone."""
    word = str(attributes.get("outcome", ""))
    if word == "met" or (not word and attributes["status"] != "refused"):
        return "met"
    return "unreliable" if word == "unreliable" else "refused"


def _asked_for(attributes: Mapping[str, Any]) -> tuple[float | None, float | None]:
    """Tolerance and relative tolerance of a stored run, one of them None."""
    if "relative" in attributes:
        return None, float(attributes["relative"])
    return float(attributes["tolerance"]), None


def asked_for_tolerance(search: Run, attributes: Mapping[str, Any]) -> Run | None:
    """The run that `search` comes to, if a stored run with these attributes was chosen by such one.

    Whether it is the same experiment otherwise is told by its identity.
    """
    accuracy = search.experiment.accuracy
    if accuracy is None or "tolerance" not in attributes:
        return None
    case, n_steps = str(attributes["case"]), int(attributes["n_steps"])
    method = next((one for one in accuracy.candidates if one.case == case), None)
    if method is None or _asked_for(attributes) != (accuracy.tolerance, accuracy.relative):
        return None
    return search.experiment.chosen_run(method, n_steps, search.member)
