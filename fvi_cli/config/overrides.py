"""Changes of a configuration by ``--set key.path=value``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from fvi_cli.config.complaints import Complaints, KeyPath, Place, excerpt
from fvi_cli.config.document import (
    Entry,
    ListNode,
    MappingNode,
    Node,
    ScalarNode,
    read_document,
)
from fvi_cli.config.shapes import describe

OPTION: Final = Place(source="--set")
SWEEP: Final = "sweep"
_ALTERNATIVES: Final = {"accuracy": "ladder", "ladder": "accuracy"}
"""Keys of an experiment of which one takes the place of the other."""


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
        written, equals, value = override.partition("=")
        path: KeyPath = tuple(part.strip() for part in written.split("."))
        if not equals or not all(path):
            complaints.add(
                OPTION, (), f"{excerpt(override)!r} is not allowed; it must be key.path=value"
            )
            continue
        if "[" in written:
            meant = re.sub(r"\.?\[\s*(\w+)\s*\]", r".\1", written.strip())
            complaints.add(OPTION, (), f"{excerpt(written)!r} is not allowed; write {meant}")
            continue
        node = read_document(value, OPTION, complaints, path)
        if node is not None:
            root = _changed(root, path, (), node, complaints)
    return root


def _changed(node: Node, path: KeyPath, done: KeyPath, value: Node, complaints: Complaints) -> Node:
    if not path:
        return value
    if done and done[-1] == SWEEP and len(path) > 1:
        path = _swept(node, path)
    key, rest = str(path[0]), path[1:]
    here = (*done, key)
    if isinstance(node, ScalarNode) and node.value is None:
        node = MappingNode(place=OPTION, entries={})
    if isinstance(node, ListNode):
        if not key.isdecimal() or len(key) > 6 or int(key) >= len(node.items):
            complaints.add(
                OPTION, here, f"the list there has the entries 0 to {len(node.items) - 1}"
            )
            return node
        items = list(node.items)
        items[int(key)] = _changed(items[int(key)], rest, here, value, complaints)
        return replace(node, items=tuple(items))
    if not isinstance(node, MappingNode):
        complaints.add(OPTION, here, f"{describe(node)} stands there, which has no keys")
        return node
    if not done and "experiments" in node.entries and key not in ("experiments", "name"):
        complaints.add(
            OPTION, here, f"this file has several experiments; write experiments.0.{key}, ..."
        )
        return node
    old = node.entries.get(key)
    inner: Node = old.node if old is not None else MappingNode(place=OPTION, entries={})
    entry = Entry(key_place=OPTION, node=_changed(inner, rest, here, value, complaints))
    kept = node.entries
    if key == "steps" and done and done[-1] == "ladder":
        # the other form of a ladder would contradict the numbers that are asked for
        kept = {name: old for name, old in kept.items() if name not in ("from", "to", "base")}
    if key in _ALTERNATIVES and (not done or done[0] == "experiments"):
        kept = {name: old for name, old in kept.items() if name != _ALTERNATIVES[key]}
    return replace(node, entries={**kept, key: entry})


def _swept(node: Node, path: KeyPath) -> KeyPath:
    """The path below ``sweep``, whose keys hold dots themselves: the longest one that is there."""
    if isinstance(node, ListNode):
        return (path[0], ".".join(map(str, path[1:]))) if len(path) > 1 else path
    known = node.entries if isinstance(node, MappingNode) else {}
    for count in range(len(path), 0, -1):
        key = ".".join(map(str, path[:count]))
        if key in known:
            return (key, *path[count:])
    return (".".join(map(str, path)),)
