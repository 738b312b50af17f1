"""What may stand under a key: small declarative values that read a node and describe themselves.

``read`` turns a node into plain JSON values with every default filled in; what is wrong is noted
and stands as :data:`INVALID` in the result, so that reading goes on. ``schema`` says the same in
the words of JSON schema.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, Protocol

import numpy as np

from fvi_cli.config.complaints import Complaints, KeyPath, excerpt, listed, suggestion
from fvi_cli.config.document import ListNode, MappingNode, Node, ScalarNode, read_scalar
from fvi_cli.mathematics.expressions import Expression, ExpressionError

Schema = dict[str, Any]


class Missing(Enum):
    """Marks in place of a value."""

    INVALID = "invalid"
    REQUIRED = "required"
    OPTIONAL = "optional"


INVALID: Final = Missing.INVALID
REQUIRED: Final = Missing.REQUIRED
OPTIONAL: Final = Missing.OPTIONAL


def is_complete(value: object) -> bool:
    """Whether nothing in a value that was read is INVALID."""
    if isinstance(value, Mapping):
        return all(is_complete(entry) for entry in value.values())
    if isinstance(value, list):
        return all(is_complete(entry) for entry in value)
    return value is not INVALID


def describe(node: Node) -> str:
    """What stands there, in words."""
    if isinstance(node, ListNode):
        return "a list"
    if isinstance(node, MappingNode):
        return "a mapping"
    if node.value is None:
        return "an empty value"
    if isinstance(node.value, str):
        return f"the text {excerpt(node.text)!r}"
    return excerpt(node.text)


def needed(node: Node, expected: str) -> str:
    """The complaint that something else is needed."""
    if isinstance(node, ScalarNode) and node.value is None:
        return f"nothing stands here; it must be {expected}"
    return f"{describe(node)} is not allowed; it must be {expected}{_number_meant(node)}"


def _number_meant(node: Node) -> str:
    """How a text that looks like a number is written as one."""
    if not isinstance(node, ScalarNode) or not isinstance(node.value, str):
        return ""
    bare = node.text.replace("_", "").replace(",", ".").strip()
    value = read_scalar(bare)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"; as a number it is written {excerpt(bare)}" if is_number else ""


class Shape(Protocol):
    """What may stand under a key."""

    @property
    def expected(self) -> str:
        """What is allowed, to be put after *it must be*."""

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """Plain values, with INVALID where a complaint was noted."""

    def schema(self) -> Schema:
        """The shape in JSON schema."""


@dataclass(frozen=True, kw_only=True)
class Number:
    """A finite real number, possibly in an open interval or from a least value on."""

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

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A float."""
        value = node.value if isinstance(node, ScalarNode) else None
        if isinstance(value, bool) or not isinstance(value, int | float):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        allowed = (
            math.isfinite(number)
            and (self.above is None or number > self.above)
            and (self.below is None or number < self.below)
            and (self.least is None or number >= self.least)
        )
        if not allowed:
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        return number

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        limits = {
            "exclusiveMinimum": self.above,
            "exclusiveMaximum": self.below,
            "minimum": self.least,
        }
        return {"type": "number", **{k: v for k, v in limits.items() if v is not None}}


@dataclass(frozen=True, kw_only=True)
class Integer:
    """An integer in a closed range."""

    least: int
    most: int

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"an integer from {self.least} to {self.most}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """An int."""
        value = node.value if isinstance(node, ScalarNode) else None
        if isinstance(value, bool) or not isinstance(value, int | float):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        if isinstance(value, float):
            hint = f"; write {int(value)}" if value.is_integer() and abs(value) < 1e15 else ""
            complaints.add(node.place, path, needed(node, self.expected) + hint)
            return INVALID
        if not self.least <= value <= self.most:
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        return value

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": "integer", "minimum": self.least, "maximum": self.most}


@dataclass(frozen=True, kw_only=True)
class Flag:
    """True or false."""

    expected: str = "true or false"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A bool."""
        if isinstance(node, ScalarNode) and isinstance(node.value, bool):
            return node.value
        complaints.add(node.place, path, needed(node, self.expected))
        return INVALID

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": "boolean"}


@dataclass(frozen=True, kw_only=True)
class Choice:
    """One word of several."""

    words: tuple[str, ...]

    @property
    def expected(self) -> str:
        """What is allowed."""
        if len(self.words) == 1:
            return self.words[0]
        return f"{listed(self.words[:-1])} or {self.words[-1]}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """The word."""
        if isinstance(node, ScalarNode) and node.text in self.words:
            return node.text
        # a word such as `none` is text anyway; numbers and true have no near word
        text = node.text if isinstance(node, ScalarNode) and isinstance(node.value, str) else ""
        hint = suggestion(text, self.words) if text else ""
        complaints.add(
            node.place, path, f"{describe(node)} is not allowed; it must be {self.expected}{hint}"
        )
        return INVALID

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"enum": list(self.words)}


@dataclass(frozen=True, kw_only=True)
class Formula:
    """An expression or a number, read as the text of the expression; or one of a few words."""

    variables: tuple[str, ...] = ("t",)
    words: tuple[str, ...] = ()

    @property
    def expected(self) -> str:
        """What is allowed."""
        words = "".join(f"{word}, " for word in self.words)
        return f"{words}a number or an expression in {listed(self.variables)}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """The text of the expression."""
        if not isinstance(node, ScalarNode) or node.value is None or isinstance(node.value, bool):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        text: str | float = node.value
        if node.text in self.words:
            return node.text
        try:
            return Expression.parse(text, variables=self.variables).text
        except ExpressionError as error:
            place = node.place
            message = str(error)
            exact = node.text_place if node.text == text else None
            if error.column is not None and exact is not None and exact.line:
                place, message = exact.shifted(error.column - 1), error.message
            complaints.add(place, path, message)
            return INVALID

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": ["number", "string"]}


@dataclass(frozen=True, kw_only=True)
class Text:
    """A text that is read later, when the names in it are known."""

    what: str = "a text"

    @property
    def expected(self) -> str:
        """What is allowed."""
        return self.what

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """The text as written; a number stands for itself."""
        if not isinstance(node, ScalarNode) or node.value is None or isinstance(node.value, bool):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        return node.value if isinstance(node.value, str) else repr(node.value)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": ["number", "string"]}


@dataclass(frozen=True, kw_only=True)
class Matrix:
    """A symmetric matrix as a list of rows, positive definite if asked for."""

    positive: bool = False
    largest: int = 1000

    @property
    def expected(self) -> str:
        """What is allowed."""
        kind = "symmetric positive definite" if self.positive else "symmetric"
        return f"a {kind} matrix: a list of rows of equal length, such as [[2, -1], [-1, 2]]"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A list of lists of floats."""
        if not isinstance(node, ListNode) or not node.items:
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        size = len(node.items)
        rows: list[Any] = []
        for index, row in enumerate(node.items):
            if not isinstance(row, ListNode) or len(row.items) != size:
                found = f"{len(row.items)} entries" if isinstance(row, ListNode) else describe(row)
                complaints.add(
                    row.place, (*path, index), f"{found} where a row of {size} numbers is needed"
                )
                rows.append(INVALID)
                continue
            rows.append(
                [
                    Number().read(item, (*path, index, column), complaints)
                    for column, item in enumerate(row.items)
                ]
            )
        if not is_complete(rows):
            return INVALID
        matrix = np.array(rows, dtype=float)
        scale = float(np.abs(matrix).max())
        for i, j in np.argwhere(np.abs(matrix - matrix.T) > 1e-12 * scale):
            row = node.items[int(i)]
            if i > j and isinstance(row, ListNode):
                complaints.add(
                    row.items[int(j)].place,
                    (*path, int(i), int(j)),
                    f"{matrix[i, j]:g} is not the entry {matrix[j, i]:g} at {j}, {i}; "
                    "the matrix must be symmetric",
                )
                return INVALID
        # scaled, so that the squares of huge entries stay finite
        if self.positive:
            smallest = float(np.linalg.eigvalsh(matrix / scale)[0]) * scale if scale else 0.0
            if not smallest > 0:
                complaints.add(
                    node.place,
                    path,
                    f"the smallest eigenvalue is {smallest:g}; it must be positive (definite)",
                )
                return INVALID
        return rows

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}
