"""Result files in formats for those without HDF5: CSV, NumPy's npz, MATLAB's mat."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import RequestError
from fvi_cli.storage.arrays import StoredArrays, stored_arrays
from fvi_cli.storage.atomic import replace_file

MATLAB_NAME_LENGTH = 63
"""Longest name of a field that MATLAB reads."""

_LONG_FORM = ("member", "time")
_NAMING = ("experiment", "case", "n_steps")
"""Attributes that tell what a file is; they stand at its top."""


def export_file(path: Path, form: str, directory: Path) -> list[Path]:
    """Write the runs of a result file in another format.

    Parameters
    ----------
    path
        Result file.
    form
        ``csv``: one file for every run, ``<experiment>-<case>-n000016.csv``, with its attributes
        as comments; a batch of a sweep is one file with a column ``member`` and the swept values,
        and beside it ``...-members.csv`` with what is known of each member. The numbers are those
        that were stored, to the last digit. ``npz``: one file with arrays named
        ``<experiment>/<case>/n000016/position`` and the attributes as JSON beside them. ``mat``:
        one file (MATLAB 5) of nested structures.
    directory
        Folder; it is made when it is missing.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    RequestError
        For an unknown format, or a file without runs.
    StorageError
        If the result file cannot be read.
    """
    if form not in FORMATS:
        raise RequestError(f"--to {form}: is not one of {', '.join(FORMATS)}")
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
        if "member" in run.arrays:
            yield f"{name}-members.csv", _csv(run, ("member",)).encode()


def _csv(run: StoredArrays, along: Sequence[str]) -> str:
    """Attributes as comments, then one row for every time of every member, or every member."""
    text = io.StringIO()
    attributes = _plain(run.attributes)
    first = {name: attributes[name] for name in _NAMING if name in attributes}
    for name, value in (first | attributes).items():
        text.write(f"# {name}: {json.dumps(value, ensure_ascii=False)}\n")
    columns = dict(_columns(run, [axis for axis in along if axis in run.arrays]))
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(_words(values) for values in columns.values()), strict=True))
    return text.getvalue()


def _columns(run: StoredArrays, along: Sequence[str]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Columns of equal length: axes first, then what depends on them."""
    shape = tuple(run.arrays[axis].size for axis in along)
    swept = json.loads(str(run.attributes.get("swept", "[]")))
    others = [name for name in run.arrays if name not in along and name not in swept]
    for name in (*along, *swept, *others):
        axes = run.dimensions[name]
        if name in others and (axes[: len(along)] != tuple(along)):
            continue  # labels of other axes, and what is known of a member as a whole
        if "time" in axes and "time" not in along:
            continue
        values = run.arrays[name]
        # what lies along further axes, such as dof, is a column each
        further = range(len(along), len(axes)) if name in others else range(0)
        for label in np.ndindex(*(values.shape[axis] for axis in further)):
            part = values[(..., *label)] if label else values
            whole = part.reshape([run.arrays[a].size if a in axes else 1 for a in along])
            yield name + "".join(f"_{k}" for k in label), np.broadcast_to(whole, shape).ravel()


def _words(values: NDArray[Any]) -> Sequence[str]:
    """Numbers such that they are read back as the same."""
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
            # text as fixed width: objects would need pickle to be read
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
        # the stubs know of names only
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
