"""Paths of the runs in a file: requested runs at their own path, others next to it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping

from fvi_cli.storage.digests import SOLVER_VERSION, sha256
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
    """The changes that make the attributes of a record describe the run as it was read back."""
    again = stored_record(finished).attributes
    own = {
        name: value
        for name, value in record.attributes.items()
        # attributes that a later version has added stay
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
    requested: Mapping[str, Mapping[str, int]],
    descriptions: Mapping[tuple[str, str], Description],
) -> dict[str, list[Entry]]:
    """Runs by the path of the group in which they are to be written.

    `entries` are given by identity. `requested` maps path and identity to the number of the member;
    `descriptions` hold new attributes for some of these.
    """
    found: dict[str, list[Entry]] = {}
    variants: dict[str, str] = {}

    def put(one: Entry, preferred: str) -> None:
        is_shared = one.kind.swept and not one.kind.has_own_times
        for path in _numbered(preferred):
            held = found.get(path, [])
            if not held or (is_shared and held[0].kind.group_key == one.kind.group_key):
                found.setdefault(path, []).append(one)
                return

    taken: set[str] = set()
    for path, numbers in requested.items():
        # members in the order of the sweep, not of their computation
        for identity in sorted(numbers, key=numbers.__getitem__):
            entry = entries[identity]
            if (path, identity) in descriptions:
                entry = entry.described(descriptions[path, identity])
            variants[path.split("/")[1]] = entry.kind.variant
            put(entry, path)
        taken |= numbers.keys()
    for identity, entry in entries.items():
        if identity in taken or entry.is_reference:
            continue
        kind = entry.kind
        variant = variants.get(kind.experiment)
        is_own = entry.is_of_configuration if variant is None else variant == kind.variant
        put(entry, kind.path if is_own else _beside(kind))
    # sorted, so that the order does not depend on which run was computed first
    for entry in sorted(entries.values(), key=lambda one: one.identity):
        if entry.is_reference and entry.attributes()["solver_version"] == SOLVER_VERSION:
            put(entry, entry.kind.path)
    return found


def _beside(kind: GroupKind) -> str:
    """The path of a run with other values; runs of all methods share the experiment."""
    name = f"{kind.experiment}{VARIANT_MARK}{sha256(kind.variant)[:8]}"
    return group_path(name, kind.case, kind.n_steps)


def _numbered(path: str) -> Iterator[str]:
    """A path, then the same with numbers, for runs that cannot share its group."""
    return itertools.chain([path], (f"{path}-{number}" for number in itertools.count(2)))
