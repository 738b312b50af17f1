"""A node with its path and the complaints about it: what is handed to whatever reads it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import Complaints, KeyPath, excerpt
from fvi_cli.keys.nodes import (
    ListNode,
    MappingNode,
    Node,
    ScalarNode,
    describe,
    node_at,
    read_scalar,
)
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import Expression


class Missing(Enum):
    """Marks in place of a value."""

    INVALID = "invalid"
    REQUIRED = "required"
    OPTIONAL = "optional"


INVALID: Final = Missing.INVALID
REQUIRED: Final = Missing.REQUIRED
OPTIONAL: Final = Missing.OPTIONAL


class Built:
    """A value that was made of a mapping."""


def is_complete(value: object) -> bool:
    """Whether nothing in a value that was read is INVALID."""
    # most values are these, and whether something is a mapping takes long to ask
    if type(value) in (float, str, int, bool):
        return True
    if isinstance(value, Built):
        value = vars(value)
    if isinstance(value, Mapping):
        return all(is_complete(entry) for entry in value.values())
    if isinstance(value, list | tuple):
        return all(is_complete(entry) for entry in value)
    return value is not INVALID


@dataclass(frozen=True, kw_only=True, eq=False)
class Cursor:
    """A place in a tree."""

    node: Node
    complaints: Complaints  # receives what is wrong
    path: KeyPath = ()  # keys and indices that lead there
    names: tuple[str, ...] = ()  # names that expressions may hold beside their own variables

    def refuse(self, message: str, *path: str | int) -> Missing:
        """Complain of what stands here, or at the end of a path below as far as it exists."""
        self.complaints.add(self.under(*path).node.place, (*self.path, *path), message)
        return INVALID

    def refuse_key(self, name: str, message: str) -> Missing:
        """Complain of a key of the mapping that stands here, or of the mapping without it."""
        given = self.node.entries.get(name) if isinstance(self.node, MappingNode) else None
        place = self.node.place if given is None else given.key_place
        self.complaints.add(place, (*self.path, name), message)
        return INVALID

    def report_argument(self, error: ArgumentError) -> Missing:
        """Complain of what a check found, where it says."""
        if error.at_key:
            return self.under(*error.path[:-1]).refuse_key(error.path[-1], error.message)
        return self.refuse(error.message, *error.path)

    def needs(self, expected: str, hint: str = "") -> Missing:
        """Complain that something else is needed, and how what stands here would be written."""
        return self.refuse(f"{needed(self.node, expected)}{hint}")

    def items(self) -> list[Cursor]:
        """The entries of the list that stands here; none where there is no list."""
        items = self.node.items if isinstance(self.node, ListNode) else ()
        return [self._at(item, index) for index, item in enumerate(items)]

    def under(self, *path: str | int) -> Cursor:
        """What stands at the end of a path below, as far as that exists."""
        found, there = node_at(self.node, path)
        return self._at(found, *there)

    def _at(self, node: Node, *path: str | int) -> Cursor:
        # `dataclasses.replace` takes several times as long, and sweeps are large
        path = (*self.path, *path)
        return Cursor(node=node, complaints=self.complaints, path=path, names=self.names)

    def entries(self) -> Iterator[tuple[str, Cursor]]:
        """The keys of the mapping that stands here, with what stands under them."""
        for name in self.node.entries if isinstance(self.node, MappingNode) else ():
            yield name, self.under(name)

    def has(self, name: str) -> bool:
        """Whether a mapping with this key stands here."""
        return isinstance(self.node, MappingNode) and name in self.node.entries

    @property
    def scalar(self) -> Any:
        """The value of a word, number or text; None for anything else."""
        return self.node.value if isinstance(self.node, ScalarNode) else None


def _number_before(text: str) -> str:
    """What to write for a fraction, a percentage, or a number with a unit."""
    found = _WITH_MORE.fullmatch(text.strip())
    if found is None:
        return _constant_in(text)
    number, over, unit = found.groups()
    if over is not None:
        return f"; write {float(number) / float(over):.15g}" if float(over) else ""
    if unit == "%":
        return f"; write {float(number) / 100:.15g}"
    if unit in ("°", "deg"):
        return f"; angles are in radians: write {math.radians(float(number)):.15g}"
    return f"; numbers have no unit: write {number}"


def _constant_in(text: str) -> str:
    """What to write for an expression of numbers, such as ``10*pi``."""
    try:
        value = Expression.parse(text, variables=()).evaluate({})
        number = float(value)
    except (ExpressionError, TypeError, ValueError, OverflowError):
        return ""
    return f"; write {number:.15g}" if math.isfinite(number) else ""


_WITH_MORE: Final = re.compile(
    r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:/\s*(\d+\.?\d*)|(%|°|[a-zA-Zµ][\w/^*²³-]*))"
)


def needed(node: Node, expected: str) -> str:
    """The complaint that something else is needed."""
    if isinstance(node, ScalarNode) and node.value is None:
        return f"the value is missing; it must be {expected}"
    return f"{describe(node)} is not allowed; it must be {expected}{_number_meant(node)}"


def _number_meant(node: Node) -> str:
    """How a text that looks like a number is written as one."""
    if not isinstance(node, ScalarNode) or not isinstance(node.value, str):
        return ""
    bare = node.text.replace("_", "").replace(",", ".").strip()
    value = read_scalar(bare)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _number_before(node.text)
    comma = " with a decimal point" if "," in node.text else ""
    return f"; as a number it is written {excerpt(bare)}{comma}"
