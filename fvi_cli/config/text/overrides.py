"""Changes of a configuration by ``--set key.path=value``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from fvi_cli.config.text.document import DEEPEST_NESTING, read_document
from fvi_cli.keys.complaints import Complaints, KeyPath, SourcePosition, excerpt
from fvi_cli.keys.nodes import ListNode, MappingNode, Node, NowhereError, node_at, with_node

OPTION: Final = SourcePosition(source="--set")
SWEEP: Final = "sweep"
_DISPLACED: Final[Mapping[str, tuple[str, ...]]] = {
    "accuracy": ("ladder",),
    "ladder": ("accuracy",),
    "ladder.steps": ("from", "to", "base"),
}
"""Keys that would contradict another one, below an experiment."""


def apply_overrides(root: Node, overrides: Sequence[str], complaints: Complaints) -> Node:
    """The tree with every override in place, in their order.

    Parameters
    ----------
    root
        Tree of the file.
    overrides
        ``key.path=value``; the path is keys and list indices from 0, joined by dots, and the
        value is YAML. Mappings that the path needs and the file lacks are made.
    complaints
        Receives what is wrong, at the place ``--set``.
    """
    for override in overrides:
        path = _path(override, root, complaints)
        node = path and read_document(override.partition("=")[2], OPTION, complaints, path)
        if not path or not node:
            continue
        try:
            root = with_node(_without_displaced(root, path), path, node, OPTION)
        except NowhereError as error:
            complaints.add(OPTION, error.path, error.reason)
    return root


def _path(override: str, root: Node, complaints: Complaints) -> KeyPath:
    """The keys that a change names; none, with a complaint, where they are not allowed."""

    def refuse(message: str, *path: str) -> KeyPath:
        complaints.add(OPTION, path, message)
        return ()

    written, equals, _ = override.partition("=")
    path = tuple(part.strip() for part in written.split("."))
    if not equals or not all(path):
        return refuse(f"{excerpt(override)!r} is not allowed; it must be key.path=value")
    if "[" in written:
        meant = re.sub(r"\.?\[\s*(\w+)\s*\]", r".\1", written.strip())
        return refuse(f"{excerpt(written)!r} is not allowed; write {meant}")
    if len(path) > DEEPEST_NESTING:
        return refuse(f"{excerpt(written)!r} leads more than {DEEPEST_NESTING} deep")
    several = isinstance(root, MappingNode) and "experiments" in root.entries
    if several and path[0] not in ("experiments", "name"):
        return refuse(
            f"this file has several experiments; write experiments.0.{path[0]}, ...", path[0]
        )
    return _swept(root, path)


def _swept(root: Node, path: tuple[str, ...]) -> KeyPath:
    """The path, of which keys below ``sweep`` hold dots: there the longest one that exists."""
    if SWEEP not in path[:-2]:
        return path
    outer = path[: path.index(SWEEP) + 1]
    (node, found), rest = node_at(root, outer), path[len(outer) :]
    if isinstance(node, ListNode):
        return (*outer, rest[0], ".".join(rest[1:]))
    known = node.entries if isinstance(node, MappingNode) and found == outer else {}
    keys = (".".join(rest[:count]) for count in range(len(rest), 0, -1))
    key = next((key for key in keys if key in known), ".".join(rest))
    return (*outer, key, *rest[key.count(".") + 1 :])


def _without_displaced(root: Node, path: KeyPath) -> Node:
    """The tree without what would contradict the key at `path`."""
    base = path[:2] if path[0] == "experiments" else ()
    for depth in range(len(base), len(path)):
        displaced = _DISPLACED.get(".".join(map(str, path[len(base) : depth + 1])), ())
        node, found = node_at(root, path[:depth])
        if displaced and found == path[:depth] and isinstance(node, MappingNode):
            kept = {name: entry for name, entry in node.entries.items() if name not in displaced}
            root = with_node(root, path[:depth], replace(node, entries=kept), OPTION)
    return root
