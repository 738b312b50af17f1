"""Where the runs of a file belong: what is requested in its place, the rest beside it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fvi_cli.storage.digests import answered_by_own_code, sha256, specification_of
from fvi_cli.storage.records.fields import field_named
from fvi_cli.storage.records.record import (
    SWEPT,
    VARIANT_MARK,
    Entry,
    GroupKind,
    StoredRecord,
    group_path,
    same_value,
    swept_by,
    variant_of,
)
from fvi_cli.storage.records.runs import ORIGIN, stored_record
from fvi_cli.studies.experiment import FinishedRun, Run


@dataclass(frozen=True, slots=True, eq=False)
class Description:
    """Attributes of a run that was written in another experiment, sweep or norm."""

    run: Run  # as it is requested
    # attributes that are other ones, and names of those that it has no more
    changed: Mapping[str, Any]
    without: frozenset[str]


def description_of(record: StoredRecord, finished: FinishedRun) -> Description:
    """How the record of a run is to be changed for the run as it was read back."""
    again = stored_record(finished).attributes
    own = {
        name: value
        for name, value in record.attributes.items()
        # what a later version has written stays
        if name not in ORIGIN
        and (field_named(name) is not None or name == SWEPT or name.startswith("problem."))
    }
    changed = {
        name: value
        for name, value in again.items()
        if name not in ORIGIN and (name not in own or not same_value(own[name], value))
    }
    without = frozenset(own) - frozenset(again)
    return Description(run=finished.run, changed=changed, without=without)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A run in the group where it belongs."""

    entry: Entry  # where it is read
    # what it is to be described as, if it was written as another one
    description: Description | None = None

    @property
    def identity(self) -> str:
        """Of the run."""
        return self.entry.identity

    @property
    def request(self) -> str:
        """Of the run."""
        return self.entry.request

    def attributes(self) -> Mapping[str, Any]:
        """Its attributes."""
        return self._described(self.entry.source.attributes(self.entry))

    def shapes(self) -> Sequence[tuple[str, tuple[int, ...], tuple[str, ...]]]:
        """How large its arrays are."""
        return self.entry.source.shapes(self.entry)

    def record(self) -> StoredRecord:
        """All of it, verified."""
        record = self.entry.record()
        return replace(record, attributes=self._described(record.attributes))

    def _described(self, attributes: Mapping[str, Any]) -> Mapping[str, Any]:
        if self.description is None:
            return attributes
        kept = {k: v for k, v in attributes.items() if k not in self.description.without}
        return {**kept, **self.description.changed}

    @property
    def group_key(self) -> tuple[object, ...]:
        """What the members of a group have in common."""
        kind = self.entry.kind
        swept = kind.swept if self.description is None else swept_by(self.description.run)
        return self.variant, kind.method, kind.is_refusal, swept

    @property
    def variant(self) -> str:
        """As of the kind that it will have."""
        if self.description is None:
            return self.entry.kind.variant
        run = self.description.run
        return variant_of(specification_of(run)[0], swept_by(run), run.experiment.norm)


Requested = Mapping[tuple[str, str], tuple[int, Description | None]]
"""By path of a group and identity: number of a member, and how the record is described anew."""


def layout_of(
    entries: Mapping[str, Entry], latest: Mapping[str, Entry], requested: Requested
) -> dict[str, list[Placed]]:
    """Runs, given by identity, by the path of the group where they belong.

    Of those that answer one request the `latest` is kept: what other code has computed again.
    """
    found: dict[str, list[Placed]] = {}
    variants: dict[str, str] = {}

    def put(one: Placed, paths: Iterable[str]) -> None:
        for path in paths:
            held = found.get(path, [])
            is_shared = one.group_key[-1] and not one.entry.kind.has_own_times
            if not held or (is_shared and held[0].group_key == one.group_key):
                found.setdefault(path, []).append(one)
                return

    # members in the order of the sweep, whenever they were computed
    for (path, identity), (_, description) in sorted(requested.items(), key=lambda one: one[1][0]):
        placed = Placed(entries[identity], description)
        variants[path.split("/")[1]] = placed.variant
        put(placed, _from(path, placed.entry.kind))
    taken = {identity for _, identity in requested}
    answered = {entries[identity].request for identity in taken}
    for identity, entry in entries.items():
        if identity in taken or entry.request in answered or latest[entry.request] is not entry:
            continue
        kind = entry.kind
        if entry.is_reference:
            continue
        variant = variants.get(kind.experiment)
        is_own = entry.is_of_configuration if variant is None else variant == kind.variant
        put(Placed(entry), _from(kind.path, kind) if is_own else _neighbours(kind))
    # in one order, independent of who found them
    for entry in sorted(entries.values(), key=lambda one: one.request):
        if entry.is_reference and entry.identity == answered_by_own_code(entry.request):
            put(Placed(entry), _numbered(entry.kind.path))
    return found


def _from(path: str, kind: GroupKind) -> Iterator[str]:
    """Paths for runs that the configuration requests, and for others of their values."""
    if kind.has_own_times:
        yield from _numbered(path)
    yield path
    yield from _neighbours(kind)


def _neighbours(kind: GroupKind) -> Iterator[str]:
    """Paths for runs of other values, the first of which holds all methods."""
    what = [kind.variant, repr((kind.variant, kind.method, kind.is_refusal, kind.swept))]
    paths = [
        group_path(f"{kind.experiment}{VARIANT_MARK}{sha256(one)[:8]}", kind.case, kind.n_steps)
        for one in what
    ]
    if kind.has_own_times:
        yield from _numbered(paths[0])
    yield paths[0]
    yield from _numbered(paths[1])


def _numbered(path: str) -> Iterator[str]:
    """A path, and paths beside it; members that have times of their own share none."""
    return itertools.chain([path], (f"{path}-{number}" for number in itertools.count(2)))
