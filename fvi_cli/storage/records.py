"""One finished run as attributes and datasets, and back."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.method import method_columns
from fvi_cli.integrator.trajectory import NewtonRecord, Trajectory
from fvi_cli.storage.assurance_records import assurance_attributes, assurance_of
from fvi_cli.storage.diagnostic_records import (
    DIAGNOSTIC_DIMENSIONS,
    DIAGNOSTIC_NAMES,
    diagnostic_attributes,
    diagnostic_datasets,
    diagnostics_of,
)
from fvi_cli.storage.provenance import SOLVER_VERSION, canonical_json, identity, origin
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.members import value_at, without_values
from fvi_cli.studies.order import damping_orders

COMPLETE = "complete"
"""Attribute of a run that is written last."""

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

RUN_KEYS = ("method", "n_steps", "store_every", "allow_unstable", "diagnostics", "accuracy")
"""Keys of a run's specification in which runs of one experiment may differ."""

SWEPT = "swept"
"""Attribute of a member of a sweep: a JSON list of the keys in which members differ."""

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
    return run.experiment.name, run.method.case, run.n_steps, values


def form_of(place: Place) -> Form:
    """The keys in which the runs in the same group differ; none for a run that stands alone."""
    return tuple(sorted(json.loads(place[3]))) if place[3] else ()


def place_in(attributes: Mapping[str, Any]) -> Place:
    """Where the run with these attributes belongs."""
    experiment, case = str(attributes["experiment"]), str(attributes["case"])
    values = ""
    if keys := json.loads(attributes.get(SWEPT, "[]")):
        problem = json.loads(attributes["specification"])["problem"]
        values = canonical_json({key: value_at(problem, key) for key in keys})
    return experiment, case, int(attributes["n_steps"]), values


def basis_in(attributes: Mapping[str, Any]) -> str:
    """What the runs of one experiment have in common, as text: its problem and norm."""
    keys = tuple(json.loads(attributes.get(SWEPT, "[]")))
    return basis(json.loads(attributes["specification"]), keys)


def basis_of(run: Run) -> str:
    """As :func:`basis_in`, for a run that may not be stored."""
    keys = () if run.member is None else tuple(run.member.values)
    return basis(json.loads(canonical_json(run.specification())), keys)


def basis(specification: Mapping[str, Any], swept: tuple[str, ...]) -> str:
    """What is left of a specification without what runs of one experiment may differ in."""
    shared = {k: v for k, v in specification.items() if k not in RUN_KEYS}
    if swept:
        shared |= {"problem": without_values(shared["problem"], swept), SWEPT: list(swept)}
    return canonical_json(shared)


def checksum(datasets: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of names, shapes and numbers."""
    digest = hashlib.sha256()
    for name, values in datasets.items():
        numbers = np.ascontiguousarray(values, dtype=stored_kind(values))
        digest.update(f"{name}{numbers.shape}".encode())
        digest.update(numbers.data)
    return digest.hexdigest()


def stored_kind(values: NDArray[Any]) -> str:
    """Type of the numbers in a file."""
    return "<i8" if values.dtype.kind == "i" else "<f8"


def group_path(place: Place) -> str:
    """Path of a run inside the file."""
    experiment, case, n_steps, _ = place
    return f"/{experiment}/{case}/n{n_steps:06d}"


def record_of(finished: FinishedRun) -> Record:
    """What is stored of a finished run; the grid is thinned as its experiment asks for."""
    run, trajectory = finished.run, finished.trajectory
    experiment, method, newton = run.experiment, run.method, trajectory.newton
    columns: dict[str, str | int] = dict(method_columns(method))
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
        "specification": canonical_json(run.specification()),
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
    attributes["data_sha256"] = checksum(datasets)
    return Record(attributes=attributes, datasets=datasets)


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
        message=a["message"],
        history_operations=int(a["history_operations"]),
        newton=NewtonRecord(
            iterations=int(a["newton_iterations"]),
            largest=int(a["newton_largest"]),
            worst_step=int(a["newton_worst_step"]),
            worst_residuals=tuple(np.asarray(a.get("newton_worst_residuals", ())).tolist()),
        ),
        setup_seconds=float(a["setup_seconds"]),
        stepping_seconds=float(a["stepping_seconds"]),
        remarks=tuple(json.loads(a["remarks"])),
        every=int(a["store_every"]),
        diagnostics=diagnostics_of(a, data),
    )
    return FinishedRun(
        run=run,
        trajectory=trajectory,
        error=float(a["error"]),
        floor=float(a["floor"]),
        status=a["status"],
        predicted=a["predicted"],
        expected_order=float(a["expected_order"]),
        reference=a["reference"],
        assurance=assurance_of(a),
    )


def write_record(file: h5py.File, record: Record) -> None:
    """Write a record where it belongs."""
    group = file.create_group(group_path(place_in(record.attributes)), track_order=True)
    for name, value in record.attributes.items():
        group.attrs[name] = attribute(value)
    write_datasets(group, record.datasets, DIMENSIONS)
    group.attrs[COMPLETE] = np.int64(1)


def write_datasets(
    group: h5py.Group,
    datasets: Mapping[str, NDArray[Any]],
    dimensions: Mapping[str, tuple[str, ...]],
) -> None:
    """Write datasets with a scale on every axis; a scale is the dataset named like its axis."""
    for name, values in datasets.items():
        is_text = values.dtype.kind in "OUT"
        dataset = (
            group.create_dataset(name, data=values.tolist(), dtype=h5py.string_dtype())
            if is_text
            else group.create_dataset(name, data=values, dtype=stored_kind(values))
        )
        dataset.attrs["long_name"] = LONG_NAMES[name]
        if dimensions[name] == (name,):
            dataset.make_scale(name)
    for name in datasets:
        for axis, dimension in enumerate(dimensions[name]):
            if dimension != name:
                group[name].dims[axis].attach_scale(group[dimension])


def attribute(value: Any) -> Any:
    """A value as other readers of HDF5 expect it: text, float64, int64, or an array of these.

    Raises
    ------
    TypeError
        For anything else; bool and None have no counterpart in netCDF.
    """
    if isinstance(value, bool) or value is None:
        raise TypeError(f"attribute: {value!r} is not text, a number or an array of numbers")
    if isinstance(value, str):
        return value
    if isinstance(value, int | np.integer):
        return np.int64(value)
    if isinstance(value, float | np.floating):
        return np.float64(value)
    if isinstance(value, np.ndarray) and value.dtype.kind in "if" and value.size:
        return value
    raise TypeError(f"attribute: {value!r} is not text, a number or an array of numbers")


def read_record(group: h5py.Group) -> Record:
    """A record as it was written.

    Raises
    ------
    KeyError
        If a dataset is missing.
    ValueError
        If its numbers are not those that were written.
    """
    names = [name for name in DIMENSIONS if name in group]
    if missing := {"time", "position"} - set(names):
        raise KeyError(f"{group.name} has no {', '.join(sorted(missing))}")
    attributes = {name: value for name, value in group.attrs.items() if name != COMPLETE}
    datasets = {name: np.asarray(group[name][()]) for name in names}
    if checksum(datasets) != attributes["data_sha256"]:
        raise ValueError(f"the numbers in {group.name} are not those that were written")
    return Record(attributes=attributes, datasets=datasets)
