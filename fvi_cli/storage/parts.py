"""A finished batch is a file: a small result file in ``NAME.partial/`` that appears whole.

Killed commands, shards and other machines all leave the same thing: files in that folder.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.scenes.records.inputs import inputs_in
from fvi_cli.storage.fields import MESH, TIME, arrays_of, axes_of, values_of
from fvi_cli.storage.groups import DESIGN, IDENTITY, LENGTHS, NUMBER, GroupWriter, Record
from fvi_cli.storage.hdf5 import (
    CREATOR,
    FORMAT,
    LIBVER,
    attach_scales,
    children,
    make_group,
    put,
    write_attributes,
)
from fvi_cli.storage.identity import (
    canonical_json,
    identity_of,
    reference_identity_of,
    sha256,
    variant_of,
)
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
    with _new_image() as file:
        # dimension scales are added when the part is folded
        GroupWriter(file).write(records)
        for run in {run.experiment: run for run in runs}.values():
            write_settings(file, f"/{run.experiment.name}", *variant_of(run))
        return _content(file)


def references_part_of(runs: Sequence[Run], references: Sequence[Reference | None]) -> bytes:
    """The part of the references of some runs; None where the exact solution is one."""
    records = []
    for run, one in zip(runs, references, strict=True):
        arrays: dict[str, NDArray[Any]] = {}
        values = {IDENTITY: reference_identity_of(run), LENGTHS[TIME]: 0}
        place = "exact"
        if one is not None:
            if not isinstance(one.values, Tabulated):
                raise TypeError(f"{run.title}: the reference is a function, which is not stored")
            arrays = {TIME: one.values.time, "position": one.values.position}
            values |= {"reference_error": one.error, "reference": one.source}
            values |= {LENGTHS[TIME]: int(one.values.time.size)}
            place = hashlib.sha256(arrays[TIME].tobytes()).hexdigest()[:12]
        # references at the same times share a group
        path = f"/{REFERENCES}/{run.experiment.name}/{place}"
        records.append(Record(path, values, arrays, (IDENTITY,)))
    with _new_image() as file:
        GroupWriter(file).write(records)
        return _content(file)


def configuration_part_of(
    text: str, resolved: Mapping[str, Any], overrides: Sequence[str]
) -> bytes:
    """The part of a configuration, with the numbers of its files."""
    texts = {
        "text": text,
        "resolved": json.dumps(resolved),
        "overrides": json.dumps(overrides),
        "digest": configuration_digest(text, resolved, overrides),
    }
    with _new_image() as file:
        _write_configuration(file, texts, inputs_in(resolved))
        return _content(file)


def configuration_digest(text: str, resolved: Mapping[str, Any], overrides: Sequence[str]) -> str:
    """SHA-256 of a configuration."""
    return sha256(canonical_json([text, resolved, list(overrides)]))


def configuration_in(file: h5py.File) -> dict[str, str]:
    """The texts of the configuration that made a file."""
    group = file[CONFIGURATION]
    return {name: _text_in(group, name) for name in ("text", "resolved", "overrides", "digest")}


def inputs_of(file: h5py.File) -> Iterator[tuple[str, NDArray[Any]]]:
    """Digests and numbers of the input files."""
    for digest, group in children(file[INPUTS]) if INPUTS in file else ():
        yield digest, group["numbers"][()]


def copy_configuration(source: h5py.File, target: h5py.File) -> None:
    """Copy the configuration, in place of another one, and the numbers of its files."""
    if CONFIGURATION in target:
        del target[CONFIGURATION]
    _write_configuration(target, configuration_in(source), inputs_of(source))


def _write_configuration(
    file: h5py.File, texts: Mapping[str, str], inputs: Iterable[tuple[str, NDArray[Any]]]
) -> None:
    _write_texts(file, f"/{CONFIGURATION}", texts)
    for digest, numbers in inputs:
        if (path := f"/{INPUTS}/{digest}") not in file:
            group = make_group(file, path)
            put(group, "numbers", numbers)
            attach_scales(group, {"numbers": ("row", "column", "layer")[: numbers.ndim]})


def write_root(file: h5py.File, origin: Mapping[str, str]) -> None:
    """Write the attributes of the root by which a result file is known."""
    write_attributes(file.id, {"creator": CREATOR, "format": FORMAT, **origin})


def write_settings(file: h5py.File, path: str, variant: str, text: str) -> None:
    """Write what the runs of the experiment in a group share."""
    write_attributes(file[path].id, {VARIANT: variant})
    if (own := f"/{SETTINGS}/{variant}") not in file:
        _write_texts(file, own, {"settings": text})


def settings_in(file: h5py.File, variant: str) -> str:
    """What the runs of an experiment share, as JSON text."""
    return _text_in(file[SETTINGS][variant], "settings")


def _write_texts(file: h5py.File, path: str, texts: Mapping[str, str]) -> None:
    """Write texts of any length into a group."""
    group = make_group(file, path)
    for name, text in texts.items():
        put(group, name, np.array([text.encode()], dtype="S"))
    attach_scales(group, dict.fromkeys(texts, ("text_number",)))


def _text_in(group: h5py.Group, name: str) -> str:
    """A text of a group, read back."""
    return bytes(group[name][0]).decode()


@contextlib.contextmanager
def _new_image() -> Iterator[h5py.File]:
    """A part in memory."""
    with h5py.File("part", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        write_root(file, {})
        yield file


def _content(file: h5py.File) -> bytes:
    file.flush()
    return bytes(file.id.get_file_image())


def _record(run: Run, finished: FinishedRun) -> Record:
    """What is stored of a run, which was asked for as `run`."""
    arrays, is_shared = _stored_arrays(finished)
    values = {IDENTITY: identity_of(run), **values_of(finished)}
    path = f"/{run.experiment.name}/{finished.run.method.case}/n{finished.run.n_steps:06d}"
    if run.experiment.store_every > 1:
        values["store_every"] = run.experiment.store_every
    if run.member is None:
        return Record(path, values, arrays)
    values |= {NUMBER: run.member.number, DESIGN: run.member.name}
    values |= {key: _plain(value) for key, value in run.member.values.items()}
    if not is_shared:
        return Record(f"{path}-{values[IDENTITY][:12]}", values, arrays)
    values |= {name: arrays[axis].size for axis, name in LENGTHS.items() if axis in arrays}
    return Record(path, values, arrays, tuple(sorted(run.member.values)))


def _plain(value: Any) -> Any:
    is_plain = isinstance(value, int | float | str) and not isinstance(value, bool)
    return value if is_plain else json.dumps(value)


def _stored_arrays(finished: FinishedRun) -> tuple[dict[str, NDArray[Any]], bool]:
    """The arrays that are stored of a run, and whether its times are those of its sweep."""
    run, arrays = finished.run, arrays_of(finished)
    every = run.experiment.store_every
    # a trajectory with `every` was thinned while it was integrated
    if every > 1 and finished.trajectory.every == 1:
        for name, one in arrays.items():
            if axes_of(name)[0] in (TIME, MESH):
                arrays[name] = one[_kept_points(len(one), every)]
    if run.member is None:
        return arrays, False
    grids = _grids(run.experiment, run.method, run.n_steps)
    for axis in [axis for axis in LENGTHS if axis in arrays]:
        own, grid = arrays[axis], grids[axis]
        common = min(own.size, grid.size)
        if not common:
            return arrays, False
        # members have the times of their sweep bit by bit
        spacing = float(np.diff(grid).min(initial=grid[-1]))
        off = np.flatnonzero(np.abs(own[:common] - grid[:common]) > 1e-6 * spacing)
        # an event may have ended the run between the points of the grid
        if off.size and off[0] < common - 1:
            return arrays, False
        points = int(off[0]) if off.size else common
        arrays |= {n: one[:points] for n, one in arrays.items() if axes_of(n)[0] == axis}
        arrays[axis] = grid[:points]
    return arrays, True


@functools.lru_cache(maxsize=64)
def _grids(experiment: Experiment, method: Any, n_steps: int) -> dict[str, NDArray[Any]]:
    """Times that members of a sweep report, and points of their meshes; empty: each has its own."""
    mesh, times = np.zeros(0), experiment.observations.times
    if experiment.accuracy is None:
        mesh = Run(experiment=experiment, method=method, n_steps=n_steps).times
        mesh = mesh[_kept_points(mesh.size, experiment.store_every)]
    return {TIME: mesh if times is None else np.asarray(times, dtype=float), MESH: mesh}


def _kept_points(points: int, every: int) -> NDArray[np.intp]:
    """Every n-th point and the last one."""
    return np.unique(np.append(np.arange(0, points, every), max(points - 1, 0)))[:points]
