"""A finished batch is a file: a small result file in ``NAME.partial/`` that appears whole.

Killed commands, shards and other machines all leave the same thing: files in that folder.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.scenes.records.inputs import inputs_in
from fvi_cli.storage.fields import MESH, TIME, arrays_of, axes_of, values_of
from fvi_cli.storage.groups import DESIGN, IDENTITY, NUMBER, POINTS, GroupWriter, Record
from fvi_cli.storage.hdf5 import LIBVER, as_text, write_attributes, write_plain, write_root
from fvi_cli.storage.identity import identity_of, reference_identity_of, sha256, variant_of
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.reference import Reference, Tabulated

REFERENCES: Final = "@references"
CONFIGURATION: Final = "@configuration"
INPUTS: Final = "@inputs"
SETTINGS: Final = "@settings"
"""Groups of the root that are no experiments."""
VARIANT: Final = "variant"
"""Attribute of an experiment: the digest of the settings that its runs share."""


def part_name(first: Run, identities: Iterable[str]) -> str:
    """The name of the part of some runs or references.

    Sorted by their names, parts have the members of a sweep in their order.
    """
    number = first.member.number if first.member else 0
    return f"n{first.n_steps:06d}-{number:06d}-{sha256(' '.join(identities))[:24]}.h5"


def part_of(runs: Sequence[Run], finished: Sequence[FinishedRun]) -> bytes:
    """The part of finished runs, which were asked for as `runs`."""
    records = [_record(run, one) for run, one in zip(runs, finished, strict=True)]
    first = {run.experiment: run for run in runs}
    variants = {one.name: variant_of(run) for one, run in first.items()}
    settings = {f"{SETTINGS}/{variant}": {"settings": text} for variant, text in variants.values()}
    return _image(records, settings, {name: variant for name, (variant, _) in variants.items()})


def references_part_of(runs: Sequence[Run], references: Sequence[Reference]) -> bytes:
    """The part of the references of some runs."""
    records = []
    for run, one in zip(runs, references, strict=True):
        if not isinstance(one.values, Tabulated):
            raise TypeError(f"{run.title}: the reference is a function, which is not stored")
        arrays = {TIME: one.values.time, "position": one.values.position}
        values = {
            IDENTITY: reference_identity_of(run),
            POINTS: int(one.values.time.size),
            "reference_error": one.error,
            "reference": one.source,
        }
        place = hashlib.sha256(arrays[TIME].tobytes()).hexdigest()[:12]
        # references at the same times share a group
        path = f"/{REFERENCES}/{run.experiment.name}/{place}"
        records.append(Record(path, values, arrays, (IDENTITY,)))
    return _image(records)


def configuration_part_of(resolved: Mapping[str, Any], texts: Mapping[str, str]) -> bytes:
    """The part of a configuration, with the numbers of its files."""
    inputs = {f"{INPUTS}/{digest}": {"numbers": one} for digest, one in inputs_in(resolved)}
    return _image((), {CONFIGURATION: texts, **inputs})


def _image(
    records: Sequence[Record],
    plain: Mapping[str, Mapping[str, str | NDArray[Any]]] | None = None,
    variants: Mapping[str, str] | None = None,
) -> bytes:
    """The content of a part; dimension scales of runs are added when it is folded."""
    with h5py.File("part", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        write_root(file, {})
        GroupWriter(file).write(records)
        for path, arrays in (plain or {}).items():
            write_plain(file, path, arrays)
        for experiment, variant in (variants or {}).items():
            write_attributes(file[experiment], {VARIANT: variant})
        file.flush()
        return bytes(file.id.get_file_image())


def _record(run: Run, finished: FinishedRun) -> Record:
    """What is stored of a run, which was asked for as `run`."""
    arrays, is_shared = _stored_arrays(finished)
    values = {IDENTITY: identity_of(run), **values_of(finished)}
    path = f"/{run.experiment.name}/{finished.run.method.case}/n{finished.run.n_steps:06d}"
    if run.member is None:
        return Record(path, values, arrays)
    values |= {NUMBER: run.member.number, DESIGN: run.member.name}
    values |= {key: _plain(value) for key, value in run.member.values.items()}
    if not is_shared:
        return Record(f"{path}-{values[IDENTITY][:12]}", values, arrays)
    values[POINTS] = arrays[TIME].size
    return Record(path, values, arrays, tuple(sorted(run.member.values)))


def _plain(value: Any) -> Any:
    """A swept value as a number or a text."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number else as_text(value)


def _stored_arrays(finished: FinishedRun) -> tuple[dict[str, NDArray[Any]], bool]:
    """The arrays that are stored of a run, and whether its times are those of its sweep."""
    run, arrays = finished.run, arrays_of(finished)
    every = run.experiment.store_every
    if every > 1:
        for name, one in arrays.items():
            if axes_of(name)[0] in (TIME, MESH):
                arrays[name] = one[_kept_points(len(one), every)]
    if run.member is None:
        return arrays, False
    own, grid = arrays[TIME], _grid(run.experiment, run.method, run.n_steps)
    common = min(own.size, grid.size)
    is_same = np.isclose(own[:common], grid[:common], rtol=1e-9, atol=0.0)
    points = int(np.append(is_same, False).argmin())
    # an event may have ended the run between the points of the grid
    if points < max(1, own.size - 1):
        return arrays, False
    # members have the times of their sweep bit by bit
    arrays = {n: one[:points] if axes_of(n)[0] == TIME else one for n, one in arrays.items()}
    return arrays | {TIME: grid[:points]}, True


@functools.lru_cache(maxsize=64)
def _grid(experiment: Experiment, method: Any, n_steps: int) -> NDArray[Any]:
    """The times that members of a sweep report; empty: each chooses its own."""
    if experiment.observations.times is not None:
        return np.asarray(experiment.observations.times, dtype=float)
    if experiment.accuracy is not None:
        return np.zeros(0)
    times = Run(experiment=experiment, method=method, n_steps=n_steps).times
    return times[_kept_points(times.size, experiment.store_every)]


def _kept_points(points: int, every: int) -> NDArray[np.intp]:
    """Every n-th point and the last one."""
    return np.unique(np.append(np.arange(0, points, every), max(points - 1, 0)))[:points]
