"""A group of a result file: one run, or the members of a sweep side by side.

A single run is a batch of one. What the runs of a group have in common is an attribute; what
members of a sweep differ in is a dataset along ``member``, and their arrays have that axis in
front. A trajectory that stopped early ends in nan there; ``points`` says how much of it counts.

The attribute ``checksum`` is the SHA-256 of everything that is said of the runs. Among that are the
checksums of their arrays, so that a listing is verified without reading them.
"""

from __future__ import annotations

import itertools
import json
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.fields.observed import OCCURRENCE, ROOMS
from fvi_cli.storage.provenance import CHECKSUM, checksum
from fvi_cli.storage.records import (
    FIELDS,
    POINTS,
    SHARED,
    SWEPT,
    Record,
    digest_of,
    dimensions_of,
    has_points,
    rows_of,
)

COMPLETE = "complete"
"""Attribute of a group that is written last."""

PACKED = "attributes"
"""Attribute of a group in a part: all that is said of its runs, as one text of JSON."""

CONVERGENCE = "convergence"
"""Group of a case that holds no run."""

MEMBER = "member"

_RESIDUALS = "newton_worst_residuals"

MOST_ROWS = 256
"""Runs that are in memory at a time, at most: what is said of short ones is more than they are."""

Columns = dict[str, Sequence[Any]]
"""The attributes of runs by name, a value for each of them."""


@dataclass(frozen=True, eq=False)
class Repeated(Sequence[Any]):
    """The column of what all runs have in common."""

    value: Any
    number: int

    def __len__(self) -> int:
        """Number of runs."""
        return self.number

    def __getitem__(self, at: Any) -> Any:
        """The value, or a column of it."""
        if isinstance(at, slice):
            return Repeated(self.value, len(range(self.number)[at]))
        range(self.number)[at]
        return self.value

    def __iter__(self) -> Iterator[Any]:
        """The value for each of the runs."""
        return itertools.repeat(self.value, self.number)


@dataclass(frozen=True)
class StoredGroup:
    """A group that holds a run, or members of a sweep; what is read of it is verified.

    What is not as it was written raises ValueError, KeyError or TypeError.
    """

    group: h5py.Group

    @property
    def is_complete(self) -> bool:
        """Whether it was written to its end."""
        return COMPLETE in self.group.attrs

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """What members of a sweep differ in; nothing where one run stands alone."""
        return tuple(json.loads(self.said[SWEPT])) if SWEPT in self.said else ()

    @cached_property
    def said(self) -> Mapping[str, Any]:
        """What is said of the runs, not verified."""
        packed = self.group.attrs.get(PACKED)
        if packed is None:
            # read one by one as they are asked for
            return self.group.attrs  # type: ignore[no-any-return]
        return {name: attribute(value) for name, value in json.loads(packed).items()}

    @cached_property
    def nodes(self) -> dict[str, h5py.Dataset]:
        """The datasets by name; nothing else may be there, and nothing outside of the file."""
        found: dict[str, h5py.Dataset] = {}
        for name, node in datasets_below(self.group):
            if not isinstance(node, h5py.Dataset):
                raise TypeError(f"{self.group.name}/{name} is no dataset")
            _refuse_strange(node)
            found[name] = node
        return found

    @cached_property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the group."""
        last = (COMPLETE, CHECKSUM)
        said = {name: value for name, value in self.said.items() if name not in last}
        columns = {f"{name}[member]": values for name, values in self.by_member.items()}
        if checksum({**said, **columns}) != self.group.attrs[CHECKSUM]:
            raise ValueError(f"what is said in {self.group.name} is not what was written")
        return said

    @cached_property
    def by_member(self) -> Columns:
        """What members differ in, by name."""
        names = [n for n in self.nodes if n != MEMBER and dimensions_of(n) is None]
        return {name: _read_column(self.nodes[name]) for name in names}

    @cached_property
    def columns(self) -> Columns:
        """The attributes of all runs, as they were given to :func:`write_group`.

        The specification is what they have in common, swept values stand beside it.
        """
        count = len(self)
        own: Columns = {n: Repeated(value, count) for n, value in self.attributes.items()}
        own |= self.by_member
        del own["shared_sha256"]
        return own

    @property
    def values(self) -> Iterator[dict[str, Any]]:
        """The swept values of every member."""
        found = [self.by_member[key] for key in self.keys]
        return (dict(zip(self.keys, one, strict=True)) for one in zip(*found, strict=True))

    def __len__(self) -> int:
        """Number of runs."""
        return int(self.nodes[MEMBER].shape[0]) if self.keys else 1

    @cached_property
    def shared(self) -> dict[str, NDArray[Any]]:
        """Times, and labels of other axes."""
        found = {name: np.asarray(self.nodes[name][()]) for name in SHARED if name in self.nodes}
        longest = {
            name: values[: np.count_nonzero(np.isfinite(values))] if self.keys else values
            for name, values in found.items()
        }
        self._verify(longest, self.attributes["shared_sha256"])
        return found

    def _verify(self, arrays: Mapping[str, NDArray[Any]], digest: str) -> None:
        if digest_of(arrays) != digest:
            raise ValueError(f"the numbers in {self.group.name} are not those that were written")

    def records(self, start: int, stop: int) -> list[Record]:
        """The runs from `start` up to `stop`, as they were written."""
        rows: Any = (slice(start, stop),) if self.keys else (None,)
        names = [
            name
            for name in self.nodes
            if dimensions_of(name) is not None
            and name not in SHARED
            and not name.endswith(f"/{OCCURRENCE}")
        ]
        data = {
            name: np.asarray(self.nodes[name][rows[0]] if self.keys else self.nodes[name][()][None])
            for name in names
        }
        records = []
        for row in range(start, stop):
            attributes = {name: values[row] for name, values in self.columns.items()}
            points = int(attributes[POINTS])
            fields = [name for name in attributes[FIELDS].split(",") if name]
            own = {
                name: data[name][row - start, : rows_of(name, attributes)]
                if self.keys or has_points(name)
                else data[name][row - start]
                for name in fields
            }
            self._verify(own, attributes["data_sha256"])
            datasets = {**self.shared, "time": self.shared["time"][:points], **own}
            residuals = attributes.pop(_RESIDUALS, "")
            if len(residuals):
                attributes[_RESIDUALS] = np.asarray(residuals, dtype=float)
            records.append(Record(attributes=attributes, datasets=datasets))
        return records

    def rows_at_a_time(self, most_bytes: int) -> int:
        """How many runs are read at a time."""
        within = most_bytes * len(self) // max(self._bytes, 1)
        return max(1, min(len(self), MOST_ROWS, within))

    @cached_property
    def _bytes(self) -> int:
        return sum(int(node.nbytes) for node in self.nodes.values())


def axes_of(name: str, *, of_members: bool) -> tuple[str, ...]:
    """Names of the axes of a dataset in the group of a run, or of members of a sweep."""
    own = dimensions_of(name, of_members=of_members)
    if not of_members or own == (name,):
        return own or ()
    return (MEMBER, *(own or ()))


def attribute(value: Any) -> Any:
    """A value as other readers of HDF5 expect it: text, float64, int64, or an array of these.

    Raises
    ------
    TypeError
        For anything else; bool and None have no counterpart in netCDF.
    """
    if isinstance(value, str):
        return value
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return np.int64(value)
    if isinstance(value, float | np.floating):
        return np.float64(value)
    if isinstance(value, np.ndarray | list):
        values = np.asarray(value)
        if values.dtype.kind in "if" and values.size:
            return values
    raise TypeError(f"attribute: {value!r} is not text, a number or an array of numbers")


def children(group: h5py.Group) -> dict[str, Any]:
    """What lies in a group; links that lead elsewhere are refused."""
    found = {}
    for name in group:
        if group.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
            raise TypeError(f"{group.name}/{name} is a link that leads elsewhere")
        found[name] = group[name]
    return found


def datasets_below(group: h5py.Group) -> Iterator[tuple[str, Any]]:
    """What lies in the group of a run by name, and in the groups of what was observed."""
    for name, node in children(group).items():
        if name in ROOMS and isinstance(node, h5py.Group):
            for inner, one in children(node).items():
                if isinstance(one, h5py.Group):
                    below = children(one).items()
                    yield from ((f"{name}/{inner}/{last}", found) for last, found in below)
                else:
                    yield f"{name}/{inner}", one
        else:
            yield name, node


def _refuse_strange(dataset: h5py.Dataset) -> None:
    """Only what this program writes: numbers and texts that lie in the file itself."""
    is_text = h5py.check_string_dtype(dataset.dtype) is not None
    held = dataset.id.get_storage_size() == dataset.size * dataset.dtype.itemsize or is_text
    if dataset.external is not None or dataset.is_virtual or dataset.chunks is not None or not held:
        raise TypeError(f"{dataset.name} does not lie in the file as it was written")
    if not is_text and dataset.dtype.str not in ("<f8", "<i8"):
        raise TypeError(f"{dataset.name} holds {dataset.dtype}, not numbers or texts")


def run_groups(file: h5py.File) -> Iterator[tuple[str, str, StoredGroup]]:
    """Every group of runs of a file, with the names of the groups that it lies in."""
    for experiment, cases in children(file).items():
        for case, groups in children(cases).items():
            for name, group in children(groups).items():
                if name != CONVERGENCE:
                    yield experiment, case, StoredGroup(group)


def _read_column(dataset: h5py.Dataset) -> Sequence[Any]:
    if dataset.ndim != 1:
        raise TypeError(f"{dataset.name} has {dataset.ndim} axes in place of one along members")
    if h5py.check_string_dtype(dataset.dtype) is None:
        # a number takes 8 bytes here, 32 in a list
        return array("q" if dataset.dtype.kind == "i" else "d", dataset[()].tobytes())
    # most are the same for many members
    known: dict[str, str] = {}
    texts = [known.setdefault(text, text) for text in dataset.asstr()[()]]
    return [json.loads(t) for t in texts] if "encoding" in dataset.attrs else texts
