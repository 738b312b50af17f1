"""Where the runs of a file belong: what is requested in its place, the rest beside it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping

from fvi_cli.storage.identity import answered_by_own_code, sha256
from fvi_cli.storage.records.placed import Description, Placed
from fvi_cli.storage.records.record import (
    VARIANT_MARK,
    Entry,
    GroupKind,
    group_path,
)

Requested = Mapping[tuple[str, str], tuple[int, Description | None]]
"""By path of a group and identity: number of a member, and how the record is described anew."""


def layout_of(
    entries: Mapping[str, Entry], latest: Mapping[str, Entry], requested: Requested
) -> dict[str, list[Placed]]:
    """Runs by the path of the group where they belong.

    Parameters
    ----------
    entries
        Every run by identity.
    latest
        By request; what was computed again by other code goes before what it replaces.
    requested
        What the configuration asks for.
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
    # in one order, whoever has found them first
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
