"""The record of one run, and its place in a file or journal."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from numpy.typing import NDArray

from fvi_cli.storage.digests import Inputs, canonical_json, sha256
from fvi_cli.studies.experiment import Run

SWEPT: Final = "swept"
"""Attribute of a member of a sweep: a JSON list of the keys in which members differ."""

VARIANT_MARK: Final = "@"
"""Separates the name of an experiment from a digest in groups of runs with other values."""

REFERENCES: Final = "@references"
"""Group of references (in place of an experiment's), which readers of runs may skip."""

RUN_KEYS: Final = ("method", "n_steps")
"""Keys of a run's specification in which runs of one variant of an experiment may differ."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredRecord:
    """Attributes and arrays that are stored under an identity."""

    identity: str  # digest of what was asked
    # numbers, texts, lists of numbers; for a member of a sweep also its swept values (JSON)
    attributes: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]  # by name, float64 or int64
    axes: Mapping[str, tuple[str, ...]]  # names of the axes of every array
    inputs: Inputs = field(default_factory=dict)  # lists that the specification names by digest

    @property
    def size(self) -> int:
        """Bytes of the arrays."""
        return sum(values.nbytes for values in self.arrays.values())


def same_value(one: Any, other: Any) -> bool:
    """Whether two attributes are of one type and equal; nan is nan."""
    return type(one) is type(other) and bool(one == other or (one != one and other != other))


class GroupKind(NamedTuple):
    """Properties that all runs of one group share; `variant` and `method` are digests."""

    experiment: str
    case: str
    n_steps: int
    norm: str
    swept: tuple[str, ...]
    variant: str
    method: str
    has_own_times: bool

    @property
    def path(self) -> str:
        """Path of the group if the file's configuration requests these runs."""
        return group_path(self.experiment, self.case, self.n_steps)

    @property
    def group_key(self) -> tuple[object, ...]:
        """Runs of one path may share a group if these properties are equal."""
        return self.variant, self.method, self.swept


def group_path(experiment: str, case: str, n_steps: int) -> str:
    """``/<experiment>/<case>/n000016``."""
    return f"/{experiment}/{case}/n{n_steps:06d}"


def kind_of(attributes: Mapping[str, Any]) -> GroupKind:
    """The kind of the group of a run with these attributes."""
    a = attributes
    return _kind(
        str(a["experiment"]), str(a["case"]), int(a["n_steps"]), str(a["norm"]),
        str(a.get(SWEPT, "[]")), str(a["specification"]),
    )  # fmt: skip


@functools.lru_cache(maxsize=1024)
def _kind(
    experiment: str,
    case: str,
    n_steps: int,
    norm: str,
    swept: str,
    specification: str,
) -> GroupKind:
    keys, values = tuple(json.loads(swept)), json.loads(specification)
    return GroupKind(
        experiment=experiment,
        case=case,
        n_steps=n_steps,
        norm=norm,
        swept=keys,
        variant=variant_of(specification, keys, norm),
        method=sha256(canonical_json(values["method"])),
        has_own_times="accuracy" in values,
    )


def variant_of(specification: str, swept: tuple[str, ...], norm: str) -> str:
    """Digest of all that the runs of one variant of an experiment share."""
    shared = {k: v for k, v in json.loads(specification).items() if k not in RUN_KEYS}
    return sha256(canonical_json([shared, sorted(swept), norm]))


def swept_by(run: Run) -> tuple[str, ...]:
    """The keys in which a member of a sweep differs from others; empty for a single run.

    They are sorted, since the stored configuration of a file has sorted keys.
    """
    return () if run.member is None else tuple(sorted(run.member.values))


Shapes = Sequence[tuple[str, tuple[int, ...], tuple[str, ...]]]
"""(Name, shape, axes) of arrays."""


class RecordSource(Protocol):
    """A file or journal from which records are read."""

    path: Path

    def attributes(self, entry: Entry) -> Mapping[str, Any]:
        """Attributes of a run."""

    def read(self, entry: Entry) -> StoredRecord:
        """The run."""

    def shapes(self, entry: Entry) -> Shapes:
        """Name, shape and axes of the arrays of a run."""

    def read_input(self, digest: str) -> NDArray[Any] | None:
        """A list of numbers by its digest; None: this source does not have it."""


@dataclass(frozen=True, slots=True, eq=False)
class Description:
    """Changes of attributes for a run that was written for another experiment, sweep or norm."""

    changed: Mapping[str, Any]
    without: frozenset[str]  # names of attributes to remove

    def of(self, attributes: Mapping[str, Any]) -> Mapping[str, Any]:
        """The attributes, with these changes."""
        kept = {name: value for name, value in attributes.items() if name not in self.without}
        return {**kept, **self.changed}


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """The place of a record: a row of a group of a file, or of a frame of a journal."""

    identity: str  # identity of the record
    # file or journal, path of the group in it (for a journal the path to which it will be written)
    # and number in the group or frame
    source: RecordSource
    path: str
    row: int
    kind: GroupKind  # kind of its group
    place: int = 0  # for a journal the byte at which the frame begins
    description: Description | None = None  # changes of its attributes, if any

    def attributes(self) -> Mapping[str, Any]:
        """The attributes of the record."""
        own = self.source.attributes(self)
        return own if self.description is None else self.description.of(own)

    def described(self, description: Description) -> Entry:
        """The same record with changes of its attributes."""
        kind = kind_of(description.of(self.source.attributes(self)))
        return replace(self, description=description, kind=kind)

    def record(self) -> StoredRecord:
        """The whole record."""
        record = self.source.read(self)
        if self.description is None:
            return record
        return replace(record, attributes=self.description.of(record.attributes))

    @property
    def is_reference(self) -> bool:
        """Whether the record is a reference for errors, not a run."""
        return self.kind.experiment == REFERENCES

    @property
    def is_of_configuration(self) -> bool:
        """Whether its path is that of a run which the file's configuration requests."""
        return VARIANT_MARK not in self.path
