"""Shapes made of other shapes: lists, names of the user's choice, one of several forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from fvi_cli.keys.complaints import excerpt, listed
from fvi_cli.keys.cursor import INVALID, Cursor, is_complete
from fvi_cli.keys.nodes import ListNode, MappingNode, ScalarNode
from fvi_cli.keys.scalars import Schema, Shape


@dataclass(frozen=True, kw_only=True)
class ListOf:
    """A list of equal things."""

    shape: Shape
    least: int = 1
    most: int = 10_000
    example: str = ""

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"a list, such as {self.example}" if self.example else "a list"

    def read(self, at: Cursor) -> Any:
        """A list."""
        if not isinstance(at.node, ListNode):
            return at.needs(self.expected, self._meant(at))
        items = at.items()
        if not self.least <= len(items) <= self.most:
            return at.refuse(f"{len(items)} entries; there must be {self.least} to {self.most}")
        return [self.shape.read(item) for item in items]

    def _meant(self, at: Cursor) -> str:
        """How something that would do as an entry is written; else nothing."""
        word = at.word_for(self.shape)
        return f"; write [{word}]" if word and f"[{word}]" != self.example else ""

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": "array", "items": self.shape.schema(), "minItems": self.least}


@dataclass(frozen=True, kw_only=True)
class OneOrMany:
    """One thing or a list of them; read as a list."""

    shape: Shape
    most: int = 10_000

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"{self.shape.expected}, or a list of such"

    def read(self, at: Cursor) -> Any:
        """A list."""
        if isinstance(at.node, ListNode):
            return ListOf(shape=self.shape, most=self.most).read(at)
        return [self.shape.read(at)]

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [self.shape.schema(), ListOf(shape=self.shape).schema()]}


@dataclass(frozen=True, kw_only=True)
class Named:
    """A mapping from names that the user chooses to equal things.

    Parameters
    ----------
    shape
        What stands under every name.
    names
        What the names are, in words.
    example
        One of such mappings.
    """

    shape: Shape
    names: str = "names"
    example: str = ""

    @property
    def expected(self) -> str:
        """What is allowed."""
        example = f", such as {self.example}" if self.example else ""
        return f"a mapping from {self.names} to {self.shape.expected}{example}"

    def read(self, at: Cursor) -> Any:
        """A dict."""
        if not isinstance(at.node, MappingNode):
            return at.needs(self.expected)
        return {name: self.shape.read(under) for name, under in at.entries()}

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": "object", "additionalProperties": self.shape.schema()}


class MappingShape(Shape, Protocol):
    """What may stand under a key as a mapping."""

    def is_meant(self, node: MappingNode) -> bool:
        """Whether a mapping has any key of this shape."""


@dataclass(frozen=True, kw_only=True)
class Checked:
    """A mapping whose values must fit together.

    Parameters
    ----------
    shape
        The mapping.
    check
        Gets what was read, complete, and where it stands; gives what shall stand in its place.
    words
        What is allowed, in words; empty: what the shape says.
    """

    shape: MappingShape
    check: Callable[[Any, Cursor], Any] = field(hash=False)
    words: str = ""
    described: Schema | None = field(default=None, hash=False)

    @property
    def expected(self) -> str:
        """What is allowed."""
        return self.words or self.shape.expected

    def is_meant(self, node: MappingNode) -> bool:
        """Whether a mapping has any key of this shape."""
        return self.shape.is_meant(node)

    def read(self, at: Cursor) -> Any:
        """What the check makes of what is read."""
        if not isinstance(at.node, MappingNode):
            return at.needs(self.expected)
        values = self.shape.read(at)
        return self.check(values, at) if is_complete(values) else INVALID

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return self.shape.schema() if self.described is None else self.described


@dataclass(frozen=True, kw_only=True)
class ByForm:
    """Different shapes for a single value, a list and mappings, which their keys tell apart."""

    single: Shape | None = None
    several: Shape | None = None
    mappings: tuple[MappingShape, ...] = ()
    example: str = ""

    @property
    def expected(self) -> str:
        """What is allowed."""
        example = f"; for example {self.example}" if self.example else ""
        return "; or ".join(shape.expected for shape in self._shapes()) + example

    def _shapes(self) -> list[Shape]:
        return [s for s in (self.single, self.several, *self.mappings) if s is not None]

    def means(self, node: MappingNode) -> MappingShape | None:
        """The mapping of which a key stands there."""
        return next((shape for shape in self.mappings if shape.is_meant(node)), None)

    def _astray(self, at: Cursor) -> tuple[Cursor, str] | None:
        """A mapping of which the example says more than complaints about what is inside of it."""
        if not self.example:
            return None
        if isinstance(at.node, MappingNode) and self.mappings and self.means(at.node) is None:
            return at, "; it"
        entry = self.several.shape if isinstance(self.several, ListOf) else None
        for item in at.items():
            if isinstance(item.node, MappingNode) and not (
                isinstance(entry, ByForm) and entry.means(item.node)
            ):
                return item, " in a list; the whole"
        return None

    def read(self, at: Cursor) -> Any:
        """What the shape for this form of node reads."""
        shape: Shape | None = self.single
        if isinstance(at.node, ListNode):
            shape = self.several
        elif isinstance(at.node, MappingNode):
            shape = self.means(at.node) or next(iter(self.mappings), None)
        if shape is None or (isinstance(at.node, ScalarNode) and at.node.value is None):
            return at.needs(self.expected)
        astray = self._astray(at)
        if astray is None:
            return shape.read(at)
        found, where = astray
        names = listed(name for name, _ in found.entries())
        keys = f" with {excerpt(names)}" if names else ""
        return found.refuse(f"a mapping{keys} is not allowed{where} must be {self.expected}")

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [shape.schema() for shape in self._shapes()]}
