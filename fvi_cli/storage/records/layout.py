"""Where the runs of a file belong: what is requested in its place, the rest beside it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping

from fvi_cli.storage.digests import answered_by_own_code, sha256
from fvi_cli.storage.records.fields import field_named
from fvi_cli.storage.records.record import (
    SWEPT,
    VARIANT_MARK,
    Description,
    Entry,
    GroupKind,
    StoredRecord,
    group_path,
    same_value,
)
from fvi_cli.storage.records.runs import ORIGIN, stored_record
from fvi_cli.studies.experiment import FinishedRun


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
    return Description(changed=changed, without=without)


def layout_of(
    entries: Mapping[str, Entry],
    latest: Mapping[str, Entry],
    requested: Mapping[str, Mapping[str, int]],
    descriptions: Mapping[tuple[str, str], Description],
) -> dict[str, list[Entry]]:
    """Runs, given by identity, by the path of the group where they belong.

    Of those that answer one request the `latest` is kept: what other code has computed again. What
    is `requested` is given by path and identity with the number of its member; it may be described
    anew there.
    """
    found: dict[str, list[Entry]] = {}
    variants: dict[str, str] = {}

    def put(one: Entry, paths: Iterable[str]) -> None:
        for path in paths:
            held = found.get(path, [])
            is_shared = one.kind.swept and not one.kind.has_own_times
            if not held or (is_shared and held[0].kind.group_key == one.kind.group_key):
                found.setdefault(path, []).append(one)
                return

    taken: set[str] = set()
    for path, numbers in requested.items():
        # members in the order of the sweep, whenever they were computed
        for identity in sorted(numbers, key=numbers.__getitem__):
            entry = entries[identity]
            if (path, identity) in descriptions:
                entry = entry.described(descriptions[path, identity])
            variants[path.split("/")[1]] = entry.kind.variant
            put(entry, _from(path, entry.kind))
        taken |= numbers.keys()
    answered = {entries[identity].request for identity in taken}
    for identity, entry in entries.items():
        if identity in taken or entry.request in answered or latest[entry.request] is not entry:
            continue
        kind = entry.kind
        if entry.is_reference:
            continue
        variant = variants.get(kind.experiment)
        is_own = entry.is_of_configuration if variant is None else variant == kind.variant
        put(entry, _from(kind.path, kind) if is_own else _neighbours(kind))
    # in one order, independent of who found them
    for entry in sorted(entries.values(), key=lambda one: one.request):
        if entry.is_reference and entry.identity == answered_by_own_code(entry.request):
            put(entry, _numbered(entry.kind.path))
    return found


def _from(path: str, kind: GroupKind) -> Iterator[str]:
    """Paths for runs that the configuration requests, and for others of their values."""
    if kind.has_own_times:
        yield from _numbered(path)
    yield path
    yield from _neighbours(kind)


def _neighbours(kind: GroupKind) -> Iterator[str]:
    """Paths for runs of other values, the first of which holds all methods."""
    what = [kind.variant, repr(kind.group_key)]
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
