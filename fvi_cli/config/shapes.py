"""What may stand under a key: small declarative values that read a node and describe themselves.

``read`` turns a node into plain JSON values with every default filled in; what is wrong is noted
and stands as :data:`INVALID` in the result, so that reading goes on. ``schema`` says the same in
the words of JSON schema.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
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
        return "nothing"
    if isinstance(node.value, str):
        return f"the text {excerpt(node.text)!r}"
    return excerpt(node.text)


def needed(node: Node, expected: str) -> str:
    """The complaint that something else is needed."""
    return f"{describe(node)} is not allowed; it must be {expected}{_hint(node)}"


def _hint(node: Node) -> str:
    if isinstance(node, ScalarNode) and isinstance(node.value, str):
        bare = node.text.replace("_", "").replace(",", ".").strip()
        if isinstance(read_scalar(bare), int | float) and bare not in ("true", "false"):
            return f"; write {excerpt(bare)}"
        if node.text.lower() in ("yes", "on", "no", "off"):
            return "; write true or false" if node.text.lower() else ""
    return ""


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
            if error.column is not None and node.text_place is not None and node.text == text:
                place, message = node.text_place.shifted(error.column - 1), error.message
            complaints.add(place, path, message)
            return INVALID

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
            rows.append(ListOf(shape=Number()).read(row, (*path, index), complaints))
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
        example = f", such as {self.example}" if self.example else ""
        return f"a list{example}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A list."""
        if not isinstance(node, ListNode):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        if not self.least <= len(node.items) <= self.most:
            complaints.add(
                node.place,
                path,
                f"{len(node.items)} entries; there must be {self.least} to {self.most}",
            )
            return INVALID
        return [
            self.shape.read(item, (*path, index), complaints)
            for index, item in enumerate(node.items)
        ]

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

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A list."""
        if isinstance(node, ListNode):
            return ListOf(shape=self.shape, most=self.most).read(node, path, complaints)
        return [self.shape.read(node, path, complaints)]

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        one = self.shape.schema()
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1}]}


@dataclass(frozen=True, kw_only=True)
class ByForm:
    """Different shapes for a single value, a list and a mapping."""

    single: Shape | None = None
    several: Shape | None = None
    mapping: Shape | None = None

    @property
    def expected(self) -> str:
        """What is allowed."""
        return "; or ".join(shape.expected for shape in self._shapes())

    def _shapes(self) -> list[Shape]:
        return [s for s in (self.single, self.several, self.mapping) if s is not None]

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """What the shape for this form of node reads."""
        shape = self.single
        if isinstance(node, ListNode):
            shape = self.several
        elif isinstance(node, MappingNode):
            shape = self.mapping
        if shape is None or (isinstance(node, ScalarNode) and node.value is None):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        return shape.read(node, path, complaints)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [shape.schema() for shape in self._shapes()]}


Refusal = str | Callable[[Node], str]


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key of a record.

    Parameters
    ----------
    name
        As it is written.
    shape
        What may stand under it.
    meaning
        For readers of the schema and of starter files; names the unit.
    default
        The plain value of an absent key, REQUIRED, or OPTIONAL for none.
    """

    name: str
    shape: Shape
    meaning: str
    default: Any = REQUIRED


@dataclass(frozen=True, kw_only=True)
class Record:
    """A mapping with known keys.

    Parameters
    ----------
    keys
        The keys, in the order in which they are filled in and shown.
    refused
        Keys that deserve a reason, with it, or a function of what stands under the key.
    """

    keys: tuple[Key, ...]
    refused: Mapping[str, Refusal] = field(default_factory=dict, hash=False)

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"a mapping with {listed(key.name for key in self.keys)}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A dict with every key that is given or has a default."""
        if not isinstance(node, MappingNode):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        known = [key.name for key in self.keys]
        for name, entry in node.entries.items():
            if name in known:
                continue
            complaints.add(entry.key_place, (*path, name), self._unknown(name, entry.node))
        values: dict[str, Any] = {}
        for key in self.keys:
            if key.name in node.entries:
                under = node.entries[key.name].node
                values[key.name] = key.shape.read(under, (*path, key.name), complaints)
            elif key.default is REQUIRED:
                complaints.add(
                    node.place, (*path, key.name), f"missing; it must be {key.shape.expected}"
                )
                values[key.name] = INVALID
            elif key.default is not OPTIONAL:
                values[key.name] = _copied(key.default)
        return values

    def _unknown(self, name: str, node: Node) -> str:
        reason = self.refused.get(name)
        if reason is not None:
            return reason if isinstance(reason, str) else reason(node)
        known = [key.name for key in self.keys]
        return f"not known{suggestion(name, known)} (known here: {listed(known)})"

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        properties = {}
        for key in self.keys:
            described = {"description": key.meaning, **key.shape.schema()}
            if not isinstance(key.default, Missing):
                described["default"] = _copied(key.default)
            properties[key.name] = described
        return {
            "type": "object",
            "properties": properties,
            "required": [key.name for key in self.keys if key.default is REQUIRED],
            "additionalProperties": False,
        }


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _copied(entry) for key, entry in value.items()}
    return [_copied(entry) for entry in value] if isinstance(value, list | tuple) else value


@dataclass(frozen=True, kw_only=True)
class ByKind:
    """Records that differ by the word under ``kind``."""

    kinds: Mapping[str, Record] = field(hash=False)

    @property
    def expected(self) -> str:
        """What is allowed."""
        return "a mapping with kind and the keys of that kind"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A dict that begins with ``kind``."""
        if not isinstance(node, MappingNode):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        choice = Choice(words=tuple(self.kinds))
        if "kind" not in node.entries:
            complaints.add(node.place, (*path, "kind"), f"missing; it must be {choice.expected}")
            kind = INVALID
        else:
            kind = choice.read(node.entries["kind"].node, (*path, "kind"), complaints)
        rest = MappingNode(
            place=node.place, entries={k: e for k, e in node.entries.items() if k != "kind"}
        )
        record = self.kinds[kind] if isinstance(kind, str) else self._of_any_kind()
        return {"kind": kind, **record.read(rest, path, complaints)}

    def _of_any_kind(self) -> Record:
        """Every key of every kind, none of them required."""
        keys: dict[str, Key] = {}
        refused: dict[str, Refusal] = {}
        for record in self.kinds.values():
            refused.update(record.refused)
            for key in record.keys:
                keys.setdefault(
                    key.name,
                    Key(name=key.name, shape=key.shape, meaning=key.meaning, default=OPTIONAL),
                )
        return Record(keys=tuple(keys.values()), refused=refused)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        variants = []
        for kind, record in self.kinds.items():
            variant = record.schema()
            variant["properties"] = {
                "kind": {"const": kind, "description": "which equation"},
                **variant["properties"],
            }
            variant["required"] = ["kind", *variant["required"]]
            variants.append(variant)
        return {"oneOf": variants}


def node_at(node: Node, path: KeyPath) -> tuple[Node, KeyPath]:
    """The node at the longest beginning of `path` that exists, and that beginning."""
    for depth, key in enumerate(path):
        if isinstance(node, MappingNode) and str(key) in node.entries:
            node = node.entries[str(key)].node
        elif isinstance(node, ListNode) and str(key).isdecimal() and int(key) < len(node.items):
            node = node.items[int(key)]
        else:
            return node, path[:depth]
    return node, path
