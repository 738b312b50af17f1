"""Reading a group of a result file: one run, or the members of a sweep in common arrays.

Values that all runs of a group share are attributes of the group. Values in which members of a
sweep differ are datasets along ``member``, and ``member`` is the first axis of their arrays. There
nan fills the end of a trajectory that stopped early; ``points`` is its number of points.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.groups.columns import ABSENT, Columns, attributes_in_row, read_column
from fvi_cli.storage.records.fields import MESH, OCCURRENCE, TIME
from fvi_cli.storage.records.record import SWEPT, Shapes

MEMBER: Final = "member"
INDEX, INPUTS = "@index", "@inputs"
"""Groups at the level of experiments: the index of runs, and long lists of numbers by digest."""
SUBGROUPS: Final = ("quantities", "events")
"""Groups inside the group of a run."""

IDENTITY, POINTS, ARRAYS, MESH_POINTS = LAYOUT = "identity", "points", "arrays", "mesh_points"
"""Attributes on the layout of runs: identity, number of points, names and axes of arrays.

Members with requested output times and steps of their own also have their number of mesh points.
"""

COUNTS: Final = "event_counts"

MOST_ROWS: Final = 256
"""Most runs in memory at a time; of short runs the attributes take more than the arrays."""

BLOCK_BYTES = 2**25
"""Most bytes of trajectories of members that are read at a time."""

Axes = Mapping[str, tuple[str, ...]]


def axes_in_words(axes: Axes) -> str:
    """``time(time) position(time,dof)``."""
    return " ".join(f"{name}({','.join(own)})" for name, own in axes.items())


@functools.lru_cache(maxsize=256)
def axes_from_words(text: str) -> Axes:
    """The inverse of :func:`axes_in_words`."""
    pairs = (one.rstrip(")").split("(") for one in text.split())
    return {name: tuple(own.split(",")) for name, own in pairs}


def scale_of(axis: str, *, of_members: bool) -> str:
    """The dataset with the values of an axis; for an event of a single run its times."""
    if not of_members and axis.endswith(f"/{OCCURRENCE}"):
        return f"{axis.removesuffix(OCCURRENCE)}{TIME}"
    return axis


def is_shared(name: str, axes: Axes) -> bool:
    """Whether members of a sweep share an array, since it holds the values of an axis."""
    return axes[name] == (name,)


def count_along(axis: str, attributes: Mapping[str, Any]) -> int | None:
    """Length of a member's data on the first axis of an array: points, or times of an event.

    None: the whole axis; so for mesh points in files that do not store their number.
    """
    if axis == MESH:
        return int(attributes[MESH_POINTS]) if MESH_POINTS in attributes else None
    if axis.endswith(f"/{OCCURRENCE}"):
        return int(json.loads(attributes[COUNTS])[axis.split("/")[1]]["count"])
    return int(attributes[POINTS])


def datasets_below(group: h5py.Group, above: str = "") -> Iterator[tuple[str, h5py.Dataset]]:
    """The datasets in the group of a run by name."""
    for name in group:
        node = group[name]
        if isinstance(node, h5py.Dataset):
            yield f"{above}{name}", node
        elif above or name in SUBGROUPS:
            yield from datasets_below(node, f"{above}{name}/")


def json_value(value: Any) -> Any:
    """A value that h5py returns as a JSON value."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _is_kept(value: Any) -> bool:
    """Whether an attribute is of a kind that this program writes: text, a number, or numbers."""
    if isinstance(value, list):
        return bool(value) and all(type(one) in (int, float) for one in value)
    return type(value) in (str, int, float)


Block = dict[str, NDArray[Any]]


class StoredGroup:
    """A group of a file, to which others may have added attributes and datasets."""

    def __init__(self, group: h5py.Group) -> None:
        self.group = group
        found = {name: json_value(value) for name, value in group.attrs.items()}
        self.attributes = {name: value for name, value in found.items() if _is_kept(value)}
        self.keys: tuple[str, ...] = tuple(json.loads(self.attributes.get(SWEPT, "[]")))

    @functools.cached_property
    def datasets(self) -> dict[str, h5py.Dataset]:
        """The datasets by name."""
        return dict(datasets_below(self.group))

    def __len__(self) -> int:
        """Number of runs."""
        return int(self.datasets[MEMBER].shape[0]) if self.keys else 1

    @functools.cached_property
    def columns(self) -> Columns:
        """Attributes in which members differ, by name."""
        found = {}
        for name, node in self.datasets.items():
            is_text = h5py.check_string_dtype(node.dtype) is not None
            is_column = node.shape == (len(self),) and (is_text or node.dtype.kind in "if")
            if self.keys and name not in self._axes_of_all and is_column and name != MEMBER:
                values = node.asstr()[()] if is_text else node[()]
                found[name] = read_column(values, is_json="encoding" in node.attrs)
        return found

    @functools.cached_property
    def _axes_of_all(self) -> Axes:
        """Axes by the name of the array, for all arrays of any run and for the axes themselves."""
        texts = dict.fromkeys(self._arrays_of_all)
        found: dict[str, tuple[str, ...]] = {}
        for text in texts:
            found |= axes_from_words(text)
        return found | {axis: (axis,) for own in found.values() for axis in own}

    @property
    def _arrays_of_all(self) -> Iterator[str]:
        if ARRAYS in self.datasets:
            return iter(self.datasets[ARRAYS].asstr()[()])
        return iter([str(self.attributes[ARRAYS])])

    def column(self, name: str) -> Sequence[Any]:
        """The value of an attribute for each run."""
        return self.columns.get(name) or [self.attributes.get(name, ABSENT)] * len(self)

    def attributes_of(self, row: int) -> dict[str, Any]:
        """All attributes of a run."""
        found = {**self.attributes, **attributes_in_row(self.columns, row)}
        return {name: value for name, value in found.items() if name not in LAYOUT}

    def _layout_of(self, row: int) -> tuple[Axes, Mapping[str, Any]]:
        """The axes of the arrays of a run, and the attributes that hold their lengths."""
        own = {**self.attributes, **attributes_in_row(self.columns, row)}
        return axes_from_words(own[ARRAYS]), own

    def shapes(self, row: int) -> Shapes:
        """Name, shape and axes of the arrays of a run."""
        axes, own = self._layout_of(row)
        found = []
        for name, along in axes.items():
            shape = tuple(self.datasets[name].shape)
            if self.keys:
                count = count_along(along[0], own)
                rest = shape[1 if is_shared(name, axes) else 2 :]
                shape = (shape[0] if count is None else count, *rest)
            found.append((name, shape, along))
        return found

    @functools.cached_property
    def rows_at_a_time(self) -> int:
        """How many runs are read at a time."""
        held = sum(int(node.nbytes) for node in self.datasets.values())
        return max(1, min(len(self), MOST_ROWS, BLOCK_BYTES * len(self) // max(held, 1)))

    def block(self, row: int) -> tuple[int, Block]:
        """The number of the first run of the block around `row`, and the arrays of the block."""
        start = row - row % self.rows_at_a_time
        whole = slice(start, min(start + self.rows_at_a_time, len(self)))
        shared = {n for n in self._axes_of_all if not self.keys or is_shared(n, self._axes_of_all)}
        held = {n: self.datasets[n] for n in self._axes_of_all if n in self.datasets}
        return start, {n: node[()] if n in shared else node[whole] for n, node in held.items()}

    def arrays_of(self, row: int, start: int, block: Block) -> tuple[Block, Axes]:
        """The arrays of a run and their axes, from a block whose first run is `start`."""
        axes, own = self._layout_of(row)
        mine = {}
        for name, along in axes.items():
            values = block[name]
            if self.keys:
                values = values if is_shared(name, axes) else values[row - start]
                values = values[: count_along(along[0], own)]
            mine[name] = values
        return mine, axes
