"""Export of result files for programs without HDF5: CSV, NumPy's npz, MATLAB's mat."""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import RequestError
from fvi_cli.storage.atomic import replace_file
from fvi_cli.storage.files import explain_damage
from fvi_cli.storage.groups.reading import ARRAYS
from fvi_cli.storage.records.fields import OCCURRENCE
from fvi_cli.storage.result_file import ResultFile

MATLAB_NAME_LENGTH = 63
"""Longest name of a field that MATLAB reads."""

DESIGN = "design"
_LONG_FORM = ("member", "time")
_DUST = 1e-13
"""Stored times this near to k T / N, relative to T, count as k T / N."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredArrays:
    """One group of a result file."""

    experiment: str  # its path in the file is /<experiment>/<case>/<name>
    case: str
    name: str
    attributes: Mapping[str, Any]  # text, integers, floats, or arrays of numbers
    arrays: Mapping[str, NDArray[Any]]  # numbers or text (dtype object), by name
    dimensions: Mapping[str, tuple[str, ...]]  # name of every axis of every array


def stored_arrays(path: Path) -> Iterator[StoredArrays]:
    """The groups of a result file (runs or sweeps), one at a time in the order of the file."""
    with contextlib.closing(ResultFile(path)) as file, explain_damage(path):
        runs = (entry for entry in file.entries if not entry.is_reference)
        resolved = json.loads(str(file.root["resolved_config"]))
        designs = {one["name"]: one.get("designs") or {} for one in resolved["experiments"]}
        for place, entries in itertools.groupby(runs, key=lambda entry: entry.path):
            for entry in entries:
                entry.record()
            group = file.group(place)
            _, experiment, case, name = place.split("/")
            arrays = {name: _values(group.datasets[name]) for name in group.dimensions}
            names = _names_of_members(arrays, designs.get(experiment, {}))
            own = {} if names is None else {DESIGN: names}
            yield StoredArrays(
                experiment=experiment,
                case=case,
                name=name,
                attributes={k: v for k, v in group.attributes.items() if k != ARRAYS},
                arrays={**arrays, **own},
                dimensions={**group.dimensions, **dict.fromkeys(own, ("member",))},
            )


def _names_of_members(
    arrays: Mapping[str, NDArray[Any]], designs: Mapping[str, Mapping[str, Any]]
) -> NDArray[Any] | None:
    """Name of the design of every member, found by its stored values; None without designs."""
    if not designs or "member" not in arrays:
        return None
    found = np.full(arrays["member"].size, "", dtype=object)
    for name, values in designs.items():
        for place in range(found.size):
            if all(_is(arrays[key][place], value) for key, value in values.items()):
                found[place] = name
    return found


def _is(stored: object, value: object) -> bool:
    """Whether a stored value equals one of a configuration."""
    return bool((json.loads(stored) if isinstance(stored, str) else stored) == value)


def _values(dataset: h5py.Dataset) -> NDArray[Any]:
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()], dtype=object)
    return np.asarray(dataset[()])


def export_file(path: Path | str, form: str, directory: Path | str) -> list[Path]:
    """Write the runs of a result file in another format, as ``fvi export`` does.

    Parameters
    ----------
    path
        Result file.
    form
        ``csv``: one file for every run, ``<experiment>-<case>-n000016.csv``, with a column for
        every coordinate (``x1``, its momentum ``p_x1``), and with it ``.json`` with the attributes
        of the run; a sweep is one file with a column ``member`` and the swept values, and with it
        ``...-members.csv`` with the attributes of each member. The numbers are the stored ones to
        the last digit; times k T / N are rounded once. ``npz``: one
        file with arrays named ``<experiment>/<case>/n000016/position`` and the attributes as JSON
        in the same file. ``mat``: one file (MATLAB 5) of nested structures.
    directory
        Folder; it is created if it does not exist.

    Returns
    -------
    list of Path
        The files that were written.
    """
    if form not in FORMATS:
        raise RequestError(f"--to {form}: is not one of {', '.join(FORMATS)}")
    path, directory = Path(path), Path(directory)
    runs = stored_arrays(path)
    written = []
    for name, content in FORMATS[form](path.stem, runs):
        directory.mkdir(parents=True, exist_ok=True)
        target = directory / name
        replace_file(target, content)
        written.append(target)
    if not written:
        raise RequestError(f"{path}: holds no runs")
    return written


def _csv_files(stem: str, runs: Iterator[StoredArrays]) -> Iterator[tuple[str, bytes]]:
    for run in runs:
        name = f"{run.experiment}-{run.case}-{run.name}"
        yield f"{name}.csv", _csv(run, _LONG_FORM).encode()
        about = json.dumps(_plain(run.attributes), indent=1, ensure_ascii=False)
        yield f"{name}.json", f"{about}\n".encode()
        if "member" in run.arrays:
            yield f"{name}-members.csv", _csv(run, ("member",)).encode()
        for axis in run.arrays:
            if axis.startswith("events/") and run.dimensions[axis] == (axis,):
                event = axis.split("/")[1]
                yield f"{name}-events-{event}.csv", _csv(run, ("member", axis)).encode()


def _csv(run: StoredArrays, along: Sequence[str]) -> str:
    """One row for every time of every member, or for every member."""
    text = io.StringIO()
    columns = dict(_columns(run, [axis for axis in along if axis in run.arrays]))
    if OCCURRENCE in columns:
        # nan pads members in which an event happens less often than in others
        happened = np.isfinite(columns["time"])
        columns = {name: values[happened] for name, values in columns.items()}
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(_words(values) for values in columns.values()), strict=True))
    return text.getvalue()


def _columns(run: StoredArrays, along: Sequence[str]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Columns of equal length: first the axes `along`, then the arrays that depend on them."""
    shape = tuple(run.arrays[axis].size for axis in along)
    swept = json.loads(str(run.attributes.get("swept", "[]")))
    swept = [DESIGN, *swept] if DESIGN in run.arrays else swept
    others = [name for name in run.arrays if name not in along and name not in swept]
    problem = json.loads(str(run.attributes.get("specification", "{}"))).get("problem", {})
    coordinates = _coordinates(run)
    for name in (*along, *swept, *others):
        axes = run.dimensions[name]
        if name in others and (axes[: len(along)] != tuple(along)):
            continue  # labels of other axes, and attributes of members
        if "time" in axes and "time" not in along:
            continue
        values = run.arrays[name] if name != "time" else _times(run.arrays[name], run, problem)
        # one column for each index of further axes, such as dof
        further = range(len(along), len(axes)) if name in others else range(0)
        for label in np.ndindex(*(values.shape[axis] for axis in further)):
            part = values[(..., *label)] if label else values
            whole = part.reshape([run.arrays[a].size if a in axes else 1 for a in along])
            labels = [
                coordinates[k] if axes[axis] == "dof" else str(k)
                for axis, k in zip(further, label, strict=True)
            ]
            bare = name.rpartition("/")[2]
            title = "_".join([_SHORT.get(bare, bare) if "dof" in axes else bare, *labels])
            if bare == "position" and labels[0] not in run.arrays:
                title = "_".join(labels)
            elif bare == "velocity" and "dof" in axes:
                title = f"v{labels[0]}"
            yield title, np.broadcast_to(whole, shape).ravel()


_SHORT = {"momentum": "p"}


def _coordinates(run: StoredArrays) -> Sequence[str]:
    """The stored names of the coordinates; without them ``x``, or ``x1``, ``x2``."""
    size = run.arrays["dof"].size if "dof" in run.arrays else 0
    names = json.loads(str(run.attributes.get("coordinates", "[]")))
    if len(names) == size:
        return [str(name) for name in names]
    return ["x"] if size == 1 else [f"x{k}" for k in range(1, size + 1)]


def _times(stored: NDArray[Any], run: StoredArrays, problem: Mapping[str, Any]) -> NDArray[Any]:
    """The exact times k T / N, rounded once, where stored times equal them up to round-off."""
    final_time, n_steps = problem.get("final_time"), run.attributes.get("n_steps")
    if not isinstance(final_time, int | float) or n_steps is None or stored.ndim != 1:
        return stored
    step = Fraction(repr(final_time)) / int(n_steps)
    numbers = np.rint(stored / float(step)).astype(np.int64)
    times = np.array([float(int(k) * step) for k in numbers])
    return np.where(np.abs(times - stored) <= _DUST * final_time, times, stored)


def _words(values: NDArray[Any]) -> Sequence[str]:
    """Numbers as text from which the same numbers are read back."""
    if values.dtype.kind == "f":
        return [repr(value) for value in values.tolist()]
    return [str(value) for value in values.tolist()]


def _npz_files(stem: str, runs: Iterator[StoredArrays]) -> Iterator[tuple[str, bytes]]:
    arrays: dict[str, NDArray[Any]] = {}
    for run in runs:
        place = f"{run.experiment}/{run.case}/{run.name}"
        arrays[f"{place}/attributes"] = np.array(
            json.dumps(_plain(run.attributes), ensure_ascii=False)
        )
        for name, values in run.arrays.items():
            # text with fixed width: reading objects would need pickle
            arrays[f"{place}/{name}"] = values.astype(str) if values.dtype.kind == "O" else values
    if arrays:
        stream = io.BytesIO()
        np.savez_compressed(stream, allow_pickle=False, **arrays)
        yield f"{stem}.npz", stream.getvalue()


def _mat_files(stem: str, runs: Iterator[StoredArrays]) -> Iterator[tuple[str, bytes]]:
    from scipy.io import savemat

    tree: dict[str, Any] = {}
    names: dict[tuple[str, ...], str] = {}
    for run in runs:
        node = tree
        place = (run.experiment, run.case, run.name)
        for depth in range(len(place)):
            key = place[: depth + 1]
            if key not in names:
                names[key] = _field(place[depth], taken=node)
            node = node.setdefault(names[key], {})
        for name, values in run.arrays.items():
            node[_field(name, taken=node)] = values
        attributes: dict[str, Any] = {}
        for name, value in _plain(run.attributes).items():
            attributes[_field(name, taken=attributes)] = value
        node["attributes"] = attributes
    if tree:
        stream = io.BytesIO()
        # the stubs accept only names of files
        file: Any = stream
        savemat(file, tree, long_field_names=True, oned_as="column", do_compression=True)
        yield f"{stem}.mat", stream.getvalue()


def _field(name: str, *, taken: Mapping[str, object]) -> str:
    """A name that MATLAB accepts: letters, digits and _, beginning with a letter, not yet taken."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)
    word = word if word[:1].isalpha() else f"x{word}"
    short, number = word[:MATLAB_NAME_LENGTH], 1
    while short in taken:
        number += 1
        ending = f"_{number}"
        short = word[: MATLAB_NAME_LENGTH - len(ending)] + ending
    return short


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as JSON values."""
    return {
        name: value.tolist() if isinstance(value, np.generic | np.ndarray) else value
        for name, value in attributes.items()
    }


Exported = Iterator[tuple[str, bytes]]
FORMATS: Mapping[str, Callable[[str, Iterator[StoredArrays]], Exported]] = {
    "csv": _csv_files,
    "npz": _npz_files,
    "mat": _mat_files,
}
