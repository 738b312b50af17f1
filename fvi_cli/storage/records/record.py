"""What is stored of one run, and where it lies."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import StorageError
from fvi_cli.storage.digests import Inputs, canonical_json, sha256
from fvi_cli.studies.experiment import Run

SWEPT: Final = "swept"
"""Attribute of a member of a sweep: a JSON list of the keys in which members differ."""

VARIANT_MARK: Final = "@"
"""Behind the name of an experiment in a group that holds runs of other values."""

REFERENCES: Final = "@references"
"""In place of an experiment: what errors are measured against, which every reader may skip."""

RUN_KEYS: Final = ("method", "n_steps")
"""Keys of a run's specification in which runs of one variant of an experiment may differ."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredRecord:
    """What is stored under an identity."""

    identity: str  # by which code what is asked for was answered, and what is asked for
    request: str
    # numbers, texts, lists of numbers; of a member of a sweep also its swept values (JSON)
    attributes: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]  # by name, float64 or int64, with the names of their axes
    axes: Mapping[str, tuple[str, ...]]
    inputs: Inputs = field(default_factory=dict)  # what the specification names by digest

    @functools.cached_property
    def checksum(self) -> str:
        """SHA-256 of all attributes and of every number, wherever and however it lies."""
        words = [self.identity, self.request, self.attributes]
        digest = hashlib.sha256(json.dumps(words, sort_keys=True).encode())
        for name in sorted(self.arrays):
            values = self.arrays[name]
            head = f"{name}{self.axes[name]}{values.dtype.str}{values.shape}"
            digest.update(head.encode())
            digest.update(np.ascontiguousarray(values).data)
        return digest.hexdigest()

    @property
    def size(self) -> int:
        """Bytes of the arrays."""
        return sum(values.nbytes for values in self.arrays.values())


def same_value(one: Any, other: Any) -> bool:
    """Whether two attributes are of one type and equal; nan is nan."""
    return type(one) is type(other) and bool(one == other or (one != one and other != other))


class GroupKind(NamedTuple):
    """What runs that lie in one group have in common; digests distinguish their values."""

    experiment: str
    case: str
    n_steps: int
    norm: str
    swept: tuple[str, ...]
    variant: str
    method: str
    is_refusal: bool
    has_own_times: bool

    @property
    def path(self) -> str:
        """Of the group, if the file's configuration asks for these runs."""
        return group_path(self.experiment, self.case, self.n_steps)

    @property
    def group_key(self) -> tuple[object, ...]:
        """What members of one path have in common that may share a group."""
        return self.variant, self.method, self.is_refusal, self.swept


def group_path(experiment: str, case: str, n_steps: int) -> str:
    """``/<experiment>/<case>/n000016``."""
    return f"/{experiment}/{case}/n{n_steps:06d}"


def kind_of(attributes: Mapping[str, Any]) -> GroupKind:
    """The kind of a run with these attributes."""
    a = attributes
    refused = a["status"] == "refused" and a["predicted"] == "unstable"
    return _kind(
        str(a["experiment"]), str(a["case"]), int(a["n_steps"]), str(a["norm"]),
        str(a.get(SWEPT, "[]")), str(a["specification"]), refused,
    )  # fmt: skip


@functools.lru_cache(maxsize=1024)
def _kind(
    experiment: str,
    case: str,
    n_steps: int,
    norm: str,
    swept: str,
    specification: str,
    refused: bool,
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
        is_refusal=refused,
        has_own_times="accuracy" in values,
    )


def variant_of(specification: str, swept: tuple[str, ...], norm: str) -> str:
    """What the runs of an experiment that belong together have in common, as a digest."""
    shared = {k: v for k, v in json.loads(specification).items() if k not in RUN_KEYS}
    return sha256(canonical_json([shared, sorted(swept), norm]))


def swept_by(run: Run) -> tuple[str, ...]:
    """The keys in which a member of a sweep differs from others; none of a run that is none.

    They are sorted: a file's own configuration has them in that order, whatever was written.
    """
    return () if run.member is None else tuple(sorted(run.member.values))


Shapes = Sequence[tuple[str, tuple[int, ...], tuple[str, ...]]]
"""Name, shape and axes of arrays."""


class RecordSource(Protocol):
    """What records are read from."""

    path: Path

    def attributes(self, entry: Entry) -> Mapping[str, Any]:
        """Attributes of a run."""

    def read(self, entry: Entry) -> StoredRecord:
        """The run, not verified."""

    def shapes(self, entry: Entry) -> Shapes:
        """How large the arrays of a run are."""

    def read_input(self, digest: str) -> NDArray[Any] | None:
        """A list of numbers by its digest; None: it is not here."""


@dataclass(frozen=True, slots=True, eq=False)
class Description:
    """Attributes of a run that was written in another experiment, sweep or norm."""

    changed: Mapping[str, Any]
    without: frozenset[str]  # names of those that it has no more

    def of(self, attributes: Mapping[str, Any]) -> Mapping[str, Any]:
        """The attributes, with these changes."""
        kept = {name: value for name, value in attributes.items() if name not in self.without}
        return {**kept, **self.changed}


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """Where a record lies: a row of a group of a file, or of a frame of a journal."""

    identity: str  # of the record
    request: str
    checksum: str
    # what it is read from, the path of its group there (of a journal where it belongs) and its
    # number
    source: RecordSource
    path: str
    row: int
    kind: GroupKind  # of its group
    is_unstable: bool  # whether it was predicted to blow up
    place: int = 0  # of a journal, where the frame begins
    description: Description | None = None  # what it is to be described as, if it was another one

    def attributes(self) -> Mapping[str, Any]:
        """Its attributes, not verified."""
        own = self.source.attributes(self)
        return own if self.description is None else self.description.of(own)

    def described(self, description: Description) -> Entry:
        """The same run, to be written as another one."""
        kind = kind_of(description.of(self.source.attributes(self)))
        return replace(self, description=description, kind=kind)

    def record(self) -> StoredRecord:
        """All of it, verified."""
        record = self.source.read(self)
        if record.checksum != self.checksum:
            raise StorageError(
                f"{self.source.path}: is damaged or not a result file ({self.path} is not what was "
                "written); it is left as it is: move it away, and its runs are computed again"
            )
        if self.description is None:
            return record
        return replace(record, attributes=self.description.of(record.attributes))

    @property
    def is_reference(self) -> bool:
        """Whether it is no run, but what errors of runs are measured against."""
        return self.kind.experiment == REFERENCES

    @property
    def is_of_configuration(self) -> bool:
        """Whether it lies where the runs lie that the file's configuration asks for."""
        return VARIANT_MARK not in self.path


def has_same_numbers(one: Entry, other: Entry) -> bool:
    """Whether two runs have the same arrays to the last bit."""
    mine, theirs = one.record(), other.record()
    return mine.arrays.keys() == theirs.arrays.keys() and all(
        np.array_equal(values, theirs.arrays[name], equal_nan=True)
        for name, values in mine.arrays.items()
    )
