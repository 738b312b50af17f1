"""The groups of a result file as named arrays, whatever they hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.files import reading
from fvi_cli.storage.locations import run_groups


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredArrays:
    """One group of a result file.

    Parameters
    ----------
    experiment, case, name
        Where it lies: ``/<experiment>/<case>/<name>``.
    attributes
        Text, integers, floats, or arrays of numbers.
    arrays
        Numbers or text (dtype object), by name.
    dimensions
        Name of every axis of every array.
    """

    experiment: str
    case: str
    name: str
    attributes: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    dimensions: Mapping[str, tuple[str, ...]]


def stored_arrays(path: Path) -> Iterator[StoredArrays]:
    """Every run of a result file, or batch of runs, one at a time in the order of the file.

    Raises
    ------
    StorageError
        If the file cannot be read or is not ours.
    """
    with reading(path) as file:
        for experiment, case, group in run_groups(file):
            datasets = {n: d for n, d in group.items() if isinstance(d, h5py.Dataset)}
            yield StoredArrays(
                experiment=experiment,
                case=case,
                name=group.name.rpartition("/")[2],
                attributes=dict(group.attrs.items()),
                arrays={name: _values(dataset) for name, dataset in datasets.items()},
                dimensions={name: _axes(name, dataset) for name, dataset in datasets.items()},
            )


def _values(dataset: h5py.Dataset) -> NDArray[Any]:
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()], dtype=object)
    return np.asarray(dataset[()])


def _axes(name: str, dataset: h5py.Dataset) -> tuple[str, ...]:
    """The scale of every axis; a scale is its own axis."""
    if dataset.is_scale:
        return (name,)
    return tuple(dim[0].name.rpartition("/")[2] if len(dim) else "" for dim in dataset.dims)
