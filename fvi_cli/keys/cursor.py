"""A cursor: a node with its path and its complaints, from which shapes read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import Complaints, KeyPath
from fvi_cli.keys.nodes import ListNode, MappingNode, Node, ScalarNode, describe, node_at


class Missing(Enum):
    """Marks that replace a value."""

    INVALID = "invalid"
    REQUIRED = "required"
    OPTIONAL = "optional"


INVALID: Final = Missing.INVALID
REQUIRED: Final = Missing.REQUIRED
OPTIONAL: Final = Missing.OPTIONAL


PLAIN: Final = (float, str, int, bool, type(None))
"""Types of values that contain no other values."""


class Built:
    """A value that was made from a mapping."""


def is_complete(value: object) -> bool:
    """Whether a value that was read contains no INVALID."""
    # most values are plain, and isinstance with Mapping is slow
    if type(value) in PLAIN:
        return True
    if value is INVALID:
        return False
    if isinstance(value, list | tuple):
        return all(map(is_complete, value))
    if isinstance(value, Built):
        return all(map(is_complete, vars(value).values()))
    return not isinstance(value, Mapping) or all(map(is_complete, value.values()))


@dataclass(frozen=True, kw_only=True, eq=False)
class Cursor:
    """A place in a tree."""

    node: Node
    complaints: Complaints  # receives complaints
    path: KeyPath = ()  # keys and indices from the root to the node
    names: tuple[str, ...] = ()  # names that expressions may hold besides their own variables

    def refuse(self, message: str, *path: str | int) -> Missing:
        """Complain about this node, or about the node at a path below as far as that exists."""
        self.complaints.add(self.under(*path).node.place, (*self.path, *path), message)
        return INVALID

    def refuse_key(self, name: str, message: str) -> Missing:
        """Complain about a key of this mapping, at the place of the key or else of the mapping."""
        given = self.node.entries.get(name) if isinstance(self.node, MappingNode) else None
        place = self.node.place if given is None else given.key_place
        self.complaints.add(place, (*self.path, name), message)
        return INVALID

    def report_argument(self, error: ArgumentError) -> Missing:
        """Add the error of a check as a complaint at the path that it names."""
        if error.at_key:
            return self.under(*error.path[:-1]).refuse_key(error.path[-1], error.message)
        return self.refuse(error.message, *error.path)

    def needs(self, expected: str, hint: str = "") -> Missing:
        """Complain that another value is needed, with a hint how to write the present one."""
        return self.refuse(f"{needed(self.node, expected)}{hint}")

    def items(self) -> list[Cursor]:
        """The entries of this list; empty where the node is no list."""
        items = self.node.items if isinstance(self.node, ListNode) else ()
        return [self._at(item, index) for index, item in enumerate(items)]

    def under(self, *path: str | int) -> Cursor:
        """The cursor at the end of a path below, as far as that exists."""
        found, there = node_at(self.node, path)
        return self._at(found, *there)

    def _at(self, node: Node, *path: str | int) -> Cursor:
        # not `dataclasses.replace`, which is several times slower: sweeps are large
        path = (*self.path, *path)
        return Cursor(node=node, complaints=self.complaints, path=path, names=self.names)

    def entries(self) -> Iterator[tuple[str, Cursor]]:
        """The keys of this mapping, each with the cursor at its value."""
        for name in self.node.entries if isinstance(self.node, MappingNode) else ():
            yield name, self.under(name)

    def has(self, name: str) -> bool:
        """Whether the node is a mapping with this key."""
        return isinstance(self.node, MappingNode) and name in self.node.entries

    @property
    def scalar(self) -> Any:
        """The value of a word, number or text; None for anything else."""
        return self.node.value if isinstance(self.node, ScalarNode) else None


def needed(node: Node, expected: str) -> str:
    """The complaint that another value is needed."""
    if isinstance(node, ScalarNode) and node.value is None:
        return f"the value is missing; it must be {expected}"
    return f"{describe(node)} is not allowed; it must be {expected}"
