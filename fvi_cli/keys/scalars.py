"""Shapes of single values and of matrices.

A shape describes the allowed values of a key. It reads the node at a cursor into plain JSON values;
for a wrong value it adds a complaint and puts :data:`INVALID` into the result, so that reading goes
on. ``schema`` describes the same values as a JSON schema.
"""

from __future__ import annotations

import logging
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Container
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvi_cli.keys.complaints import listed, suggestion
from fvi_cli.keys.cursor import INVALID, Cursor, is_complete
from fvi_cli.keys.nodes import ListNode, ScalarNode, describe, plain
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.definite import singular_words
from fvi_cli.mathematics.expressions import MOST_LISTED, Expression

_logger = logging.getLogger(__name__)
Schema = dict[str, Any]


class Shape(ABC):
    """The allowed values of a key."""

    @property
    @abstractmethod
    def expected(self) -> str:
        """What is allowed, in words that continue *it must be*."""

    @abstractmethod
    def read(self, at: Cursor) -> Any:
        """Plain values, with INVALID where there is a complaint."""

    def build(self, value: Any) -> Any:
        """The value that plain values, which were read, make."""
        return value

    def has_any(self, names: Container[str]) -> bool:
        """Whether any key of this shape (of mappings) is among `names`."""
        return False

    @abstractmethod
    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema; definitions that it refers to are added to `defs`."""


def referred(name: str, defs: Schema, schema: Callable[[Schema], Schema]) -> Schema:
    """A reference to a schema that is written into `defs` once."""
    if name not in defs:
        defs[name] = {}
        defs[name] = schema(defs)
    return {"$ref": f"#/$defs/{name}"}


def _number(at: Cursor) -> int | float | None:
    """The number at a cursor; None for any other node, also for true and false."""
    value = at.scalar
    return None if isinstance(value, bool) or not isinstance(value, int | float) else value


@dataclass(frozen=True, kw_only=True)
class Number(Shape):
    """A finite real number, optionally within an open interval or at least `least`."""

    above: float | None = None
    below: float | None = None
    least: float | None = None

    @property
    def expected(self) -> str:
        """What is allowed."""
        if self.above is not None and self.below is not None:
            return f"a number between {self.above:g} and {self.below:g}, both excluded"
        if self.above is not None:
            return f"a finite number greater than {self.above:g}"
        if self.least is not None:
            return f"a finite number, {self.least:g} or greater"
        return "a finite number"

    def read(self, at: Cursor) -> Any:
        """A float."""
        value = _number(at)
        try:
            number = math.nan if value is None else float(value)
        except OverflowError:
            number = math.inf
        allowed = (
            math.isfinite(number)
            and (self.above is None or number > self.above)
            and (self.below is None or number < self.below)
            and (self.least is None or number >= self.least)
        )
        return number if allowed else at.needs(self.expected)

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        limits = {
            "exclusiveMinimum": self.above,
            "exclusiveMaximum": self.below,
            "minimum": self.least,
        }
        return {"type": "number", **{k: v for k, v in limits.items() if v is not None}}


@dataclass(frozen=True, kw_only=True)
class Integer(Shape):
    """An integer in a closed range."""

    least: int
    most: int

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"an integer from {self.least} to {self.most}"

    def read(self, at: Cursor) -> Any:
        """An int."""
        value = _number(at)
        if isinstance(value, int) and self.least <= value <= self.most:
            return value
        return at.needs(self.expected)

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"type": "integer", "minimum": self.least, "maximum": self.most}


def _anything(defs: Schema) -> Schema:
    return {}


@dataclass(frozen=True, kw_only=True)
class AsWritten(Shape):
    """Any value, not read here but later, when its meaning is known."""

    expected: str = "what may stand under that key"
    described: Callable[[Schema], Schema] = _anything

    def read(self, at: Cursor) -> Any:
        """Plain values."""
        return plain(at.node)

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return self.described(defs)


@dataclass(frozen=True, kw_only=True)
class Flag(Shape):
    """True or false."""

    expected: str = "true or false"

    def read(self, at: Cursor) -> Any:
        """A bool."""
        return at.scalar if isinstance(at.scalar, bool) else at.needs(self.expected)

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"type": "boolean"}


@dataclass(frozen=True, kw_only=True)
class Choice(Shape):
    """One word of several."""

    words: tuple[str, ...]  # what is allowed
    # advice for words that earlier versions allowed

    @property
    def expected(self) -> str:
        """What is allowed."""
        if len(self.words) == 1:
            return self.words[0]
        return f"{listed(self.words[:-1])} or {self.words[-1]}"

    def read(self, at: Cursor) -> Any:
        """The word."""
        text = at.node.text if isinstance(at.node, ScalarNode) else ""
        if text in self.words:
            return text
        # suggest only for text: numbers and true are not near any word
        hint = suggestion(text, self.words) if text and isinstance(at.scalar, str) else ""
        return at.refuse(f"{describe(at.node)} is not allowed; it must be {self.expected}{hint}")

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"enum": list(self.words)}


@dataclass(frozen=True, kw_only=True)
class FormulaText(Shape):
    """An expression or a number, read as the text of the expression; or one of a few words."""

    variables: tuple[str, ...] = ("t",)
    words: tuple[str, ...] = ()

    @property
    def expected(self) -> str:
        """What is allowed."""
        words = "".join(f"{word}, " for word in self.words)
        return f"{words}a number or an expression in {listed(self.variables)}"

    def read(self, at: Cursor) -> Any:
        """The text of the expression."""
        value, node = at.scalar, at.node
        if not isinstance(node, ScalarNode) or value is None or isinstance(value, bool):
            return at.needs(self.expected)
        if node.text in self.words:
            return node.text
        try:
            return Expression.parse(value, variables=(*self.variables, *at.names)).text
        except ExpressionError as error:
            exact = node.text_place if node.text == value else None
            hint, message = "", error.message
            if error.unknown and at.path[:1] in (("problem",), ("quantities",), ("events",)):
                known = (*self.variables, *at.names)
                if not suggestion(error.unknown, known):
                    hint = f"; to define it write problem.parameters: {{{error.unknown}: 1.0}}"
                if len(error.known) > MOST_LISTED:
                    hint += "; fvi check -v lists all names"
                    _logger.debug("%s: names here: %s", node.place, listed(error.known))
            if error.column is None or exact is None or not exact.line:
                column = "" if error.column is None else f"column {error.column}: "
                return at.refuse(column + message + hint)
            at.complaints.add(exact.shifted(error.column - 1), at.path, message + hint)
            return INVALID

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"type": ["number", "string"]}


@dataclass(frozen=True, kw_only=True)
class Text(Shape):
    """A text; names in it are checked later."""

    what: str = "a text"  # what is allowed, in words
    pattern: str | None = None  # regular expression for the whole text; None: any text
    longest: int | None = None  # most characters; None: no limit

    @property
    def expected(self) -> str:
        """What is allowed."""
        return self.what

    def allows(self, text: str) -> bool:
        """Whether a text is of this shape."""
        is_short = self.longest is None or len(text) <= self.longest
        return is_short and (self.pattern is None or bool(re.fullmatch(self.pattern, text)))

    def read(self, at: Cursor) -> Any:
        """The text as written, also of a number."""
        value = at.scalar
        if not isinstance(at.node, ScalarNode) or value is None or isinstance(value, bool):
            return at.needs(self.expected)
        text = value if isinstance(value, str) else at.node.text
        if self.allows(text):
            return text
        if self.longest is not None and len(text) > self.longest:
            return at.refuse(f"{len(text)} characters; at most {self.longest} are allowed")
        return at.refuse(f"{describe(at.node)} is not allowed; it must be {self.expected}")

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        limits = {"pattern": self.pattern and f"^{self.pattern}$", "maxLength": self.longest}
        given = {name: value for name, value in limits.items() if value is not None}
        return {"type": "string" if given else ["number", "string"], **given}


def _diagonal(texts: list[str]) -> str:
    """How to write a diagonal matrix."""
    if len(texts) > 4:
        texts = ["m1", "m2", "m3"]
    rows = [
        "[" + ", ".join(text if i == j else "0" for j in range(len(texts))) + "]"
        for i, text in enumerate(texts)
    ]
    return f"for a diagonal matrix write [{', '.join(rows)}]"


@dataclass(frozen=True, kw_only=True)
class Matrix(Shape):
    """A symmetric matrix as a list of rows; with `positive` it must be positive definite."""

    positive: bool = False

    @property
    def expected(self) -> str:
        """What is allowed."""
        kind = "symmetric positive definite" if self.positive else "symmetric"
        return f"a {kind} matrix: a list of rows of equal length, such as [[2, -1], [-1, 2]]"

    def read(self, at: Cursor) -> Any:
        """A list of lists of floats."""
        numbers = [item.scalar for item in at.items()]
        if len(numbers) > 1 and all(type(one) in (int, float) for one in numbers):
            return at.refuse(
                f"{len(numbers)} numbers where {len(numbers)} rows are needed; "
                + _diagonal([item.node.text for item in at.items() if hasattr(item.node, "text")])
            )
        rows = [self._row(row, len(at.items())) for row in at.items()]
        if not rows:
            return at.needs(self.expected)
        return self._checked(rows, at) if is_complete(rows) else INVALID

    def _row(self, at: Cursor, size: int) -> Any:
        items = at.items()
        if isinstance(at.node, ListNode) and len(items) == size:
            return [Number().read(item) for item in items]
        found = f"{len(items)} entries" if isinstance(at.node, ListNode) else describe(at.node)
        return at.refuse(f"{found} where a row of {size} numbers is needed")

    def _checked(self, rows: list[list[float]], at: Cursor) -> Any:
        matrix = np.array(rows, dtype=float)
        scale = float(np.abs(matrix).max())
        for i, j in np.argwhere(np.abs(matrix - matrix.T) > 1e-12 * scale).tolist():
            if i > j:
                return at.refuse(
                    f"{matrix[i, j]:g} differs from the entry {matrix[j, i]:g} at {j}, {i}; "
                    "the matrix must be symmetric",
                    i,
                    j,
                )
        if not self.positive:
            return rows
        wrong = singular_words(matrix)
        return at.refuse(f"the {wrong}") if wrong else rows

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}
