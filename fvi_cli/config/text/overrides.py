"""Changes of a configuration by ``--set key.path=value``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from fvi_cli.config.text.document import DEEPEST_NESTING, read_document
from fvi_cli.keys.complaints import Complaints, KeyPath, SourcePosition, excerpt
from fvi_cli.keys.nodes import (
    ListNode,
    MappingNode,
    Node,
    NowhereError,
    ScalarNode,
    node_at,
    with_node,
    without_node,
)

OPTION: Final = SourcePosition(source="--set")
SWEEP: Final = "sweep"
DESIGNS: Final = "designs"
FIT: Final = "fit"
PARAMETERS: Final = "parameters"
ENTRIES: Final = ("start", "from", "to")
"""Keys of a parameter of a fit."""
_DISPLACED: Final[Mapping[str, tuple[str, ...]]] = {
    "accuracy": ("ladder",),
    "ladder": ("accuracy",),
    "ladder.steps": ("from", "to", "base"),
}
"""By key of an experiment the keys that exclude it; an override removes these."""


def apply_overrides(root: Node, overrides: Sequence[str], complaints: Complaints) -> Node:
    """The tree after all overrides ``key.path=value``, in their order.

    The path consists of keys and list indices from 0, joined by dots. The value is YAML; null
    removes the key. Mappings that the path needs and the file lacks are created. The place of
    complaints is ``--set``.
    """
    for override in overrides:
        path = _path(override, root, complaints)
        node = path and read_document(override.partition("=")[2], OPTION, complaints, path)
        if not path or not node:
            continue
        if isinstance(node, ScalarNode) and node.value is None:
            without = without_node(root, path)
            if without is not root:
                root = without
                continue
        try:
            root = with_node(_without_displaced(root, path), path, node, OPTION)
        except NowhereError as error:
            complaints.add(OPTION, error.path, error.reason)
    return root


def _path(override: str, root: Node, complaints: Complaints) -> KeyPath:
    """The keys of an override; empty, with a complaint, if they are not allowed."""

    def refuse(message: str, *path: str) -> KeyPath:
        complaints.add(OPTION, path, message)
        return ()

    written, equals, _ = override.partition("=")
    path = tuple(part.strip() for part in written.split("."))
    if not equals or not all(path):
        return refuse(f"{excerpt(override)!r} is not allowed; it must be key.path=value")
    if len(path) > DEEPEST_NESTING:
        return refuse(f"{excerpt(written)!r} is nested more than {DEEPEST_NESTING} deep")
    several = isinstance(root, MappingNode) and "experiments" in root.entries
    if several and path[0] not in ("experiments", "name"):
        return refuse(
            f"this file has several experiments; write experiments.0.{path[0]}, ...", path[0]
        )
    return _swept(root, path)


def _swept(root: Node, path: tuple[str, ...]) -> KeyPath:
    """The path, with its parts joined to keys that contain dots below ``sweep`` and in fits."""
    depth = _dotted_from(path)
    if depth is None:
        return path
    outer = path[:depth]
    (node, found), rest = node_at(root, outer), path[depth:]
    if isinstance(node, ListNode):
        return (*outer, rest[0], ".".join(rest[1:]))
    known = node.entries if isinstance(node, MappingNode) and found == outer else {}
    keys = (".".join(rest[:count]) for count in range(len(rest), 0, -1))
    new = ".".join(rest[:-1] if rest[-1] in ENTRIES and outer[-1] == PARAMETERS else rest)
    key = next((key for key in keys if key in known), new)
    return (*outer, key, *rest[key.count(".") + 1 :])


def _dotted_from(path: tuple[str, ...]) -> int | None:
    """Index in a path at which a key with dots begins; None: there is none."""
    if DESIGNS in path[:-3]:
        return path.index(DESIGNS) + 2
    if SWEEP in path[:-2]:
        return path.index(SWEEP) + 1
    if FIT in path[:-2]:
        inside = path[path.index(FIT) :]
        for name in (PARAMETERS, "set"):
            if name in inside[:-1]:
                return path.index(FIT) + inside.index(name) + 1
    return None


def _without_displaced(root: Node, path: KeyPath) -> Node:
    """The tree without the keys that exclude the key at `path`."""
    base = path[:2] if path[0] == "experiments" else ()
    for depth in range(len(base), len(path)):
        displaced = _DISPLACED.get(".".join(map(str, path[len(base) : depth + 1])), ())
        node, found = node_at(root, path[:depth])
        if displaced and found == path[:depth] and isinstance(node, MappingNode):
            kept = {name: entry for name, entry in node.entries.items() if name not in displaced}
            root = with_node(root, path[:depth], replace(node, entries=kept), OPTION)
    return root
