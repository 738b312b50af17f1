"""Finished runs as records of the result file, and read back from them."""

from __future__ import annotations

import functools
import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.trajectory import (
    Diagnostics,
    NewtonRecord,
    Observed,
    Occurrences,
    Trajectory,
)
from fvi_cli.storage.digests import (
    SOLVER_VERSION,
    Inputs,
    extract_inputs,
    identity_of,
    specification_of,
)
from fvi_cli.storage.files import escape_text
from fvi_cli.storage.provenance import libraries, origin
from fvi_cli.storage.records.fields import (
    FIELDS,
    MESH,
    TIME,
    Field,
    field_named,
    named_as,
    read_extents,
)
from fvi_cli.storage.records.record import SWEPT, StoredRecord, swept_by
from fvi_cli.studies.accuracy_settings import Assurance
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.norms import Measured

ORIGIN: Final = ("created", "fvi_version", "git_commit", "git_dirty", "libraries", "solver_version")
"""Attributes that say by whom, and not what."""

_MADE: Final[Mapping[tuple[str, ...], type]] = {
    ("measured",): Measured,
    ("trajectory",): Trajectory,
    ("trajectory", "newton"): NewtonRecord,
    ("trajectory", "diagnostics"): Diagnostics,
    ("trajectory", "observed"): Observed,
    ("trajectory", "observed", "events", "*"): Occurrences,
    ("assurance",): Assurance,
}
"""The class that is made of the fields below a path."""


def stored_record(finished: FinishedRun) -> StoredRecord:
    """The record of a finished run; its grid is thinned as its experiment asks for.

    For a member of a sweep only points on the grid that all members share are stored.
    """
    run = finished.run
    attributes: dict[str, Any] = {}
    arrays: dict[str, NDArray[Any]] = {}
    axes: dict[str, tuple[str, ...]] = {}
    for one in FIELDS:
        for name, value in _values(one, finished):
            if one.axes:
                arrays[name] = np.asarray(value, dtype="<f8")
                axes[name] = tuple(named_as(name, axis) for axis in one.axes)
            elif (written := _written(one, value)) is not None:
                attributes[name] = written
    # a trajectory with `every` was thinned while it was integrated
    every = 1 if finished.trajectory.every > 1 else run.experiment.store_every
    if every > 1:
        kept = kept_points(arrays[TIME].size, every)
        arrays = {n: v[kept] if axes[n][0] in (TIME, MESH) else v for n, v in arrays.items()}
        attributes["store_every"] = every
    if run.member is not None:
        own = _times_on_grid(run, arrays[TIME])
        arrays = {n: v[: own.size] if axes[n][0] == TIME else v for n, v in arrays.items()}
        arrays[TIME] = own
    identity = identity_of(run)
    return record_for(run, identity, specification_of(run), attributes, arrays, axes)


def record_for(
    run: Run,
    identity: str,
    specification: tuple[str, Inputs],
    attributes: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    axes: Mapping[str, tuple[str, ...]],
) -> StoredRecord:
    """A record that says what was asked for, of which member, and what it was made with."""
    text, inputs = specification[0], dict(specification[1])
    of_member: dict[str, Any] = {}
    if run.member is not None:
        # long lists of numbers are moved to `inputs`
        of_member = {key: extract_inputs(value, inputs) for key, value in run.member.values.items()}
        of_member[SWEPT] = json.dumps(swept_by(run))
    made_by = {"solver_version": SOLVER_VERSION, "libraries": libraries(), **origin()}
    return StoredRecord(
        identity=identity,
        attributes={**attributes, **of_member, "specification": text, **made_by},
        arrays=arrays,
        axes=axes,
        inputs=inputs,
    )


def _values(one: Field, finished: FinishedRun) -> Iterator[tuple[str, Any]]:
    """Name and value of a field as often as there is one."""
    try:
        found = one.given(finished)
    except AttributeError:
        if callable(one.at):
            raise
        return  # something on the way is None
    if not callable(one.at) and "*" in one.at:
        after = one.at.partition(".*")[2]
        for name, inner in found.items():
            value = attrgetter(after[1:])(inner) if after else inner
            yield one.name.replace("*", name), value
        return
    if found is not None:
        yield one.name, found


def _written(one: Field, value: Any) -> Any:
    """An attribute as it is written; None for nothing at all."""
    if one.form == "json":
        # that a run has no remarks is stored too
        return json.dumps(value, ensure_ascii=False) if value or one.name == "remarks" else None
    if isinstance(value, tuple):
        return [float(number) for number in value] or None
    return value.item() if isinstance(value, np.generic) else value


def _times_on_grid(run: Run, time: NDArray[Any]) -> NDArray[Any]:
    """Leading times of a run that lie on its experiment's grid, as the grid has them bit by bit.

    A search for a tolerance finds its own mesh: without output times all of it.
    """
    grid = run.experiment.observations.times
    if grid is None and run.experiment.accuracy is not None:
        return time
    if grid is None:
        grid = _grid(run.times, run.experiment.store_every)
    common = min(time.size, grid.size)
    spacing = float(np.diff(grid).min(initial=grid[-1]))
    off = np.flatnonzero(np.abs(time[:common] - grid[:common]) > 1e-6 * spacing)
    return np.asarray(grid[: int(off[0]) if off.size else common])


def _grid(times: NDArray[Any], every: int) -> NDArray[Any]:
    return times if every == 1 else times[kept_points(times.size, every)]


def kept_points(points: int, every: int) -> NDArray[np.intp]:
    """Every n-th point and the last one."""
    return np.unique(np.append(np.arange(0, points, every), max(points - 1, 0)))[:points]


def finished_of(record: StoredRecord, run: Run) -> FinishedRun:
    """The finished run of a record; fields that the record lacks take their defaults.

    Errors are stored in all norms: where the experiment asks for another one, it is judged anew.
    """
    tree: dict[str, Any] = {}
    for name, value in itertools.chain(record.attributes.items(), record.arrays.items()):
        one = field_named(name)
        if one is not None and not callable(one.at):
            _put(tree, one, name, value)
    observed = tree["trajectory"].get("observed")
    if observed is not None:
        a = record.attributes
        observed["mesh"] = record.arrays.get(MESH, record.arrays[TIME])
        observed["extents"] = read_extents(json.loads(a.get("quantity_extents", "{}")))
    if (diagnostics := tree["trajectory"].get("diagnostics")) is not None:
        diagnostics["time"] = record.arrays[MESH]
    found = FinishedRun(run=run, **{k: _made(v, (k,)) for k, v in tree.items()})
    if record.attributes["norm"] == run.experiment.norm:
        return found
    # most commands recall runs in the norm that they have, and need not wait for this import
    from fvi_cli.studies.study import expected_order_of, judged

    found = replace(found, expected_order=expected_order_of(run))
    if found.measured is None:
        return found
    return replace(found, **judged(run, found.trajectory.status, found.measured))


def _put(tree: dict[str, Any], one: Field, name: str, value: Any) -> None:
    """Put a value where it stands in a finished run."""
    if one.form == "json":
        value = json.loads(value)
    elif one.form == "words":
        value = escape_text(value)  # the file may be a stranger's, and terminals obey
    *above, last = _path_of(name)
    for part in above:
        tree = tree.setdefault(part, {})
    tree[last] = one.decode(value)


@functools.lru_cache(maxsize=4096)
def _path_of(name: str) -> list[str]:
    """Where a field that is put back stands in a finished run."""
    one = field_named(name)
    return named_as(name, "" if one is None else str(one.at)).split(".")


def _made(node: Any, path: tuple[str, ...]) -> Any:
    if not isinstance(node, dict):
        return node
    inner = {k: _made(v, (*path, "*" if path[-1] == "events" else k)) for k, v in node.items()}
    return _MADE[path](**inner) if path in _MADE else inner


def run_of(requested: Run, attributes: Mapping[str, Any]) -> Run | None:
    """The run of a record: with a tolerance the one that the search chose, else `requested`.

    None where the stored method is no candidate of the search, as where all were refused.
    """
    accuracy, n_steps = requested.experiment.accuracy, int(attributes["n_steps"])
    if accuracy is None:
        return requested
    stored_method = json.loads(attributes["specification"])["method"]
    for method in accuracy.methods:
        if method.case == attributes["case"]:
            run = requested.experiment.chosen_run(method, n_steps, requested.member)
            if json.loads(json.dumps(run.settings()["method"])) == stored_method:
                return (
                    requested if (requested.method, requested.n_steps) == (method, n_steps) else run
                )
    return None
