"""A finished batch is a file: a small result file in ``NAME.partial/`` that appears whole.

Killed commands, shards and other machines all leave the same thing: files in that folder. A result
file of another machine, put there, is a part like any other.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.scenes.records.inputs import inputs_in
from fvi_cli.storage.columns import NewRows
from fvi_cli.storage.fields import MESH, TIME, arrays_of, axes_of, values_of
from fvi_cli.storage.groups import write_group
from fvi_cli.storage.hdf5 import CREATOR, FORMAT, LIBVER, NewGroup, write_attributes
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
SETTINGS: Final = "@settings"
CONFIGURATION: Final = "@configuration"
INPUTS: Final = "@inputs"
"""Groups of the root that are no experiments."""

_TEXT: Final = "text_number"
_Row = tuple[dict[str, Any], dict[str, NDArray[Any]]]


def part_name(identities: Iterable[str]) -> str:
    """The name of the part of some runs or references."""
    return sha256(" ".join(identities))[:24] + ".h5"


def part_of(runs: Sequence[Run], finished: Sequence[FinishedRun], origin: str) -> bytes:
    """The part of finished runs, which were asked for as `runs`; `origin` is their provenance."""
    groups: dict[tuple[str, tuple[str, ...]], list[_Row]] = {}
    for run, one in zip(runs, finished, strict=True):
        arrays, is_shared = _stored_arrays(one)
        values = _labels(run) | {"provenance": origin} | values_of(one)
        values["points"] = int(arrays[TIME].size)
        if run.experiment.store_every > 1:
            values["store_every"] = run.experiment.store_every
        path = f"/{run.experiment.name}/{one.run.method.case}/n{one.run.n_steps:06d}"
        keys = tuple(sorted(run.member.values)) if run.member else ()
        if run.member and not is_shared:
            path, keys = f"{path}-member{run.member.number:05d}", ()
        groups.setdefault((path, keys), []).append((values, arrays))
    variants = dict(variant_of(run) for run in runs)
    return _image(groups, variants)


def references_part_of(runs: Sequence[Run], references: Sequence[Reference | None]) -> bytes:
    """The part of the references of some runs; None where the exact solution is one."""
    groups: dict[tuple[str, tuple[str, ...]], list[_Row]] = {}
    for run, one in zip(runs, references, strict=True):
        arrays: dict[str, NDArray[Any]] = {}
        values: dict[str, Any] = {"identity": reference_identity_of(run), "points": 0}
        place = "exact"
        if one is not None:
            if not isinstance(one.values, Tabulated):
                raise TypeError(f"{run.title}: the reference is a function, which is not stored")
            arrays = {"time": one.values.time, "position": one.values.position}
            values |= {"reference_error": one.error, "reference": one.source}
            values["points"] = int(one.values.time.size)
            place = hashlib.sha256(one.values.time.tobytes()).hexdigest()[:12]
        values["number"] = -1 if run.member is None else run.member.number
        # references of members share a group; so do those of a single scene
        path = f"/{REFERENCES}/{run.experiment.name}/{place}"
        groups.setdefault((path, ("number",)), []).append((values, arrays))
    return _image(groups, {})


def configuration_part_of(
    text: str, resolved: Mapping[str, Any], overrides: Sequence[str]
) -> tuple[str, bytes]:
    """Digest and part of a configuration, with the numbers of its files."""
    digest = configuration_digest(text, resolved, overrides)
    texts = {"text": text, "resolved": json.dumps(resolved), "overrides": json.dumps(overrides)}
    return digest, _image({}, {}, {**texts, "digest": digest}, dict(inputs_in(resolved)))


def configuration_digest(text: str, resolved: Mapping[str, Any], overrides: Sequence[str]) -> str:
    """SHA-256 of a configuration."""
    return sha256(canonical_json([text, resolved, list(overrides)]))


def write_root(file: h5py.File, origin: Mapping[str, str]) -> None:
    """Write the attributes of the root by which a result file is known."""
    write_attributes(file.id, {"creator": CREATOR, "format": FORMAT, **origin})


def write_texts(file: h5py.File, path: str, texts: Mapping[str, str]) -> None:
    """Write texts of any length as a group."""
    new = NewGroup(file, path)
    for name, text in texts.items():
        new.add(name, (_TEXT,), np.array([text.encode()], dtype="S"))
    new.attach_scales()


def texts_in(group: h5py.Group) -> dict[str, str]:
    """The texts of a group, read back."""
    names = [name for name in group if name != _TEXT]
    return {name: bytes(group[name][0]).decode() for name in names}


def write_input(file: h5py.File, digest: str, numbers: NDArray[Any]) -> None:
    """Write the numbers of an input file."""
    new = NewGroup(file, f"/{INPUTS}/{digest}")
    axes = ("row", "column", "layer")[: numbers.ndim]
    new.add("numbers", axes, numbers)
    new.attach_scales()


def _image(
    groups: Mapping[tuple[str, tuple[str, ...]], Sequence[_Row]],
    variants: Mapping[str, str],
    configuration: Mapping[str, str] | None = None,
    inputs: Mapping[str, NDArray[Any]] | None = None,
) -> bytes:
    """The content of a part; dimension scales are added when it is folded."""
    with h5py.File("part", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        write_root(file, {})
        for (path, keys), own in groups.items():
            rows = NewRows([values for values, _ in own], [arrays for _, arrays in own], keys)
            write_group(file, path, [(rows, 0, rows.count)], has_scales=False)
        for variant, text in variants.items():
            write_texts(file, f"/{SETTINGS}/{variant}", {"settings": text})
        if configuration is not None:
            write_texts(file, f"/{CONFIGURATION}", configuration)
        for digest, numbers in (inputs or {}).items():
            write_input(file, digest, numbers)
        file.flush()
        return bytes(file.id.get_file_image())


def _labels(run: Run) -> dict[str, Any]:
    """What is stored of a run besides its result."""
    labels: dict[str, Any] = {"identity": identity_of(run), "variant": variant_of(run)[0]}
    if run.member is not None:
        labels |= {"number": run.member.number, "design": run.member.name}
        labels |= {key: _plain(value) for key, value in run.member.values.items()}
    return labels


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
    grid = _grid(run.experiment, run.method, run.n_steps)
    own = arrays[TIME]
    common = min(own.size, 0 if grid is None else grid.size)
    if grid is None or not common:
        return arrays, False
    # members have the times of their sweep bit by bit
    spacing = float(np.diff(grid).min(initial=grid[-1]))
    off = np.flatnonzero(np.abs(own[:common] - grid[:common]) > 1e-6 * spacing)
    # an event may have ended the run between the points of the grid
    if off.size and off[0] < common - 1:
        return arrays, False
    points = int(off[0]) if off.size else common
    arrays = {n: one[:points] if axes_of(n)[0] == TIME else one for n, one in arrays.items()}
    return arrays | {TIME: grid[:points]}, True


@functools.lru_cache(maxsize=64)
def _grid(experiment: Experiment, method: Any, n_steps: int) -> NDArray[Any] | None:
    """The times that members of a sweep report; None: each chooses its own."""
    if experiment.observations.times is not None:
        return np.asarray(experiment.observations.times, dtype=float)
    if experiment.accuracy is not None:
        return None
    times = Run(experiment=experiment, method=method, n_steps=n_steps).times
    return times[_kept_points(times.size, experiment.store_every)]


def _kept_points(points: int, every: int) -> NDArray[np.intp]:
    """Every n-th point and the last one."""
    return np.unique(np.append(np.arange(0, points, every), max(points - 1, 0)))[:points]
