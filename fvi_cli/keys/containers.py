"""Shapes made of other shapes: lists, names of the user's choice, one of several forms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fvi_cli.keys.complaints import excerpt, listed
from fvi_cli.keys.cursor import PLAIN, Cursor
from fvi_cli.keys.nodes import ListNode, MappingNode, ScalarNode
from fvi_cli.keys.scalars import Schema, Shape, referred


@dataclass(frozen=True, kw_only=True)
class ListOf(Shape):
    """A list whose entries have one shape."""

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
            return at.needs(self.expected)
        items = at.items()
        if not self.least <= len(items) <= self.most:
            number = f"{self.least}" if self.least == self.most else f"{self.least} to {self.most}"
            return at.refuse(f"{len(items)} entries; there must be {number}")
        return [self.shape.read(item) for item in items]

    def build(self, value: Any) -> Any:
        """A tuple."""
        if not isinstance(value, list | tuple):
            return value
        is_plain = type(self.shape).build is Shape.build
        return tuple(value if is_plain else (self.shape.build(one) for one in value))

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"type": "array", "items": self.shape.schema(defs), "minItems": self.least}


@dataclass(frozen=True, kw_only=True)
class OneOrMany(Shape):
    """One value or a list of such values; read as a list, or unchanged if `as_it_stands`."""

    shape: Shape
    most: int = 10_000
    as_it_stands: bool = False

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"{self.shape.expected}, or a list of such"

    def read(self, at: Cursor) -> Any:
        """A list."""
        if isinstance(at.node, ListNode):
            return ListOf(shape=self.shape, most=self.most).read(at)
        found = self.shape.read(at)
        return found if self.as_it_stands else [found]

    def build(self, value: Any) -> Any:
        """A tuple."""
        several = value if isinstance(value, list | tuple) else [value]
        return ListOf(shape=self.shape).build(several)

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [self.shape.schema(defs), ListOf(shape=self.shape).schema(defs)]}


@dataclass(frozen=True, kw_only=True)
class Named(Shape):
    """A mapping from names that the user chooses to values of one shape."""

    shape: Shape  # shape of the value under every name
    names: str = "names"  # what the names mean, in words
    example: str = ""  # an example of such a mapping

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

    def build(self, value: Any) -> Any:
        """A mapping."""
        is_mapping = isinstance(value, Mapping)
        return {k: self.shape.build(one) for k, one in value.items()} if is_mapping else value

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"type": "object", "additionalProperties": self.shape.schema(defs)}


@dataclass(frozen=True, kw_only=True)
class ByForm(Shape):
    """Different shapes for a single value, a list and mappings, distinguished by their keys."""

    single: Shape | None = None
    several: Shape | None = None
    mappings: tuple[Shape, ...] = ()
    example: str = ""
    name: str = ""

    @property
    def expected(self) -> str:
        """What is allowed."""
        example = f"; for example {self.example}" if self.example else ""
        return "; or ".join(shape.expected for shape in self._shapes()) + example

    def _shapes(self) -> list[Shape]:
        return [s for s in (self.single, self.several, *self.mappings) if s is not None]

    def means(self, node: MappingNode) -> Shape | None:
        """The shape of a mapping that has any key of `node`."""
        return next((shape for shape in self.mappings if shape.has_any(node.entries)), None)

    def _unknown_mapping(self, at: Cursor) -> tuple[Cursor, str] | None:
        """A mapping of no known form: an example helps more than complaints about its keys."""
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
        """The plain values that the shape for this form of node reads."""
        shape: Shape | None = self.single
        if isinstance(at.node, ListNode):
            shape = self.several
        elif isinstance(at.node, MappingNode):
            shape = self.means(at.node) or next(iter(self.mappings), None)
        if shape is None or (isinstance(at.node, ScalarNode) and at.node.value is None):
            return at.needs(self.expected)
        astray = self._unknown_mapping(at)
        if astray is None:
            return shape.read(at)
        found, where = astray
        names = listed(name for name, _ in found.entries())
        keys = f" with {excerpt(names)}" if names else ""
        return found.refuse(f"a mapping{keys} is not allowed{where} must be {self.expected}")

    def build(self, value: Any) -> Any:
        """The value that the shape for this form makes."""
        shape: Shape | None = self.single
        if isinstance(value, list | tuple):
            shape = self.several
        elif type(value) not in PLAIN and isinstance(value, Mapping):
            shape = next((one for one in self.mappings if one.has_any(value)), None)
        return value if shape is None else shape.build(value)

    def schema(self, defs: Schema) -> Schema:
        """A reference if the shape has a name; else the whole schema."""

        def whole(defs: Schema) -> Schema:
            return {"anyOf": [shape.schema(defs) for shape in self._shapes()]}

        return referred(self.name, defs, whole) if self.name else whole(defs)
