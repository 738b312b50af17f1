"""The tree into which a text is read: words, lists and mappings with their places."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from fvi_cli.keys.complaints import KeyPath, SourcePosition, excerpt, show_path

ScalarValue = bool | int | float | str | None
LONGEST_NUMBER: Final = 400
NOWHERE: Final = SourcePosition(source="")

_INTEGER: Final = re.compile(r"[-+]?[0-9]+")
_OTHER_BASES: Final = ((re.compile(r"0o[0-7]+"), 8), (re.compile(r"0x[0-9a-fA-F]+"), 16))
_FLOAT: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITY: Final = re.compile(r"([-+]?)\.(inf|Inf|INF)")
_WORDS: Final[dict[str, ScalarValue]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class ScalarNode:
    """A word, number or text."""

    place: SourcePosition
    value: ScalarValue  # its value
    text: str  # its text, without quotes
    # place of the first character of `text` if the source contains the text unchanged
    text_place: SourcePosition | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ListNode:
    """A list of nodes."""

    place: SourcePosition
    items: tuple[Node, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class NodeEntry:
    """The place of a key, and the node under it."""

    key_place: SourcePosition
    node: Node


@dataclass(frozen=True, kw_only=True, eq=False)
class MappingNode:
    """Keys, each once, with their nodes."""

    place: SourcePosition
    entries: dict[str, NodeEntry]


Node = ScalarNode | ListNode | MappingNode


def read_scalar(text: str) -> ScalarValue:
    """The value of an unquoted word by the core schema of YAML 1.2."""
    if text in _WORDS:
        return _WORDS[text]
    sign = -1.0 if text.startswith("-") else 1.0
    if _INTEGER.fullmatch(text):
        # reading thousands of digits takes long, and such a number counts as infinite here
        return int(text) if len(text) <= LONGEST_NUMBER else math.copysign(math.inf, sign)
    for pattern, base in _OTHER_BASES:
        if pattern.fullmatch(text):
            return int(text[2:], base) if len(text) <= LONGEST_NUMBER else math.inf
    if _FLOAT.fullmatch(text):
        return float(text)
    return math.copysign(math.inf, sign) if _INFINITY.fullmatch(text) else text


def plain(node: Node) -> Any:
    """The JSON values of a node."""
    if isinstance(node, ListNode):
        return [plain(item) for item in node.items]
    if isinstance(node, MappingNode):
        return {key: plain(entry.node) for key, entry in node.entries.items()}
    return node.value


def node_of(value: Any, place: SourcePosition = NOWHERE) -> Node:
    """JSON values as a tree whose nodes all have the same place."""
    if isinstance(value, Mapping):
        items = value.items()
        entries = {str(k): NodeEntry(key_place=place, node=node_of(v, place)) for k, v in items}
        return MappingNode(place=place, entries=entries)
    if isinstance(value, list | tuple):
        return ListNode(place=place, items=tuple(node_of(one, place) for one in value))
    text = value if isinstance(value, str) else str(value).lower()
    return ScalarNode(place=place, value=value, text=text)


def node_at(node: Node, path: KeyPath) -> tuple[Node, KeyPath]:
    """The node at the longest beginning of `path` that exists, and that beginning."""
    for depth, key in enumerate(path):
        if isinstance(node, MappingNode) and str(key) in node.entries:
            node = node.entries[str(key)].node
        elif isinstance(node, ListNode) and (index := index_in(node, str(key))) is not None:
            node = node.items[index]
        else:
            return node, path[:depth]
    return node, path


def index_in(node: ListNode, part: str) -> int | None:
    """The index of an item that a part of a key path names; None where there is none."""
    is_index = part.isdecimal() and len(part) <= 6 and int(part) < len(node.items)
    return int(part) if is_index else None


class NowhereError(LookupError):
    """A key path does not exist: `path` up to its first missing part, and the reason."""

    def __init__(self, path: KeyPath, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{show_path(path)} does not exist; {reason}")


def with_node(node: Node, path: KeyPath, value: Node, place: SourcePosition) -> Node:
    """The tree with another node at a key path; missing mappings are created, at `place`.

    Raises
    ------
    NowhereError
        If the path leads into a list that is too short, or into a plain value.
    """
    # a loop, since a path may be longer than the recursion limit
    passed: list[tuple[ListNode | MappingNode, str]] = []
    inner: Node | None = node
    for depth, key in enumerate(path):
        part = str(key)
        if inner is None or (isinstance(inner, ScalarNode) and inner.value is None):
            inner = MappingNode(place=place, entries={})
        if isinstance(inner, ScalarNode):
            reason = f"{describe(inner)} stands there, which has no keys"
            raise NowhereError(path[: depth + 1], reason)
        passed.append((inner, part))
        if isinstance(inner, MappingNode):
            inner = inner.entries[part].node if part in inner.entries else None
        elif (index := index_in(inner, part)) is not None:
            inner = inner.items[index]
        else:
            last = len(inner.items) - 1
            reason = f"the list there has the entries 0 to {last}"
            reason = "the list there is empty" if last < 0 else reason
            raise NowhereError(path[: depth + 1], reason)
    for depth in reversed(range(len(passed))):
        outer, part = passed[depth]
        if isinstance(outer, ListNode):
            items = list(outer.items)
            items[int(part)] = value
            value = replace(outer, items=tuple(items))
        else:
            is_kept = part in outer.entries and depth < len(passed) - 1
            key_place = outer.entries[part].key_place if is_kept else place
            entry = NodeEntry(key_place=key_place, node=value)
            value = replace(outer, entries={**outer.entries, part: entry})
    return value


def without_node(node: Node, path: KeyPath) -> Node:
    """The tree without the key of a mapping at the end of a path, if it is there."""
    outer, found = node_at(node, path[:-1])
    key = str(path[-1])
    if found != path[:-1] or not isinstance(outer, MappingNode) or key not in outer.entries:
        return node
    kept = {name: entry for name, entry in outer.entries.items() if name != key}
    changed = replace(outer, entries=kept)
    return with_node(node, found, changed, outer.place) if found else changed


def describe(node: Node) -> str:
    """A node in words, for complaints."""
    if isinstance(node, ListNode):
        return "a list"
    if isinstance(node, MappingNode):
        return "a mapping"
    if node.value is None:
        return "an empty value"
    if isinstance(node.value, str):
        return f"the text {excerpt(node.text)!r}"
    return excerpt(node.text)
