"""Shapes made of other shapes: lists, mappings with known keys, mappings that differ by kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from fvi_cli.config.complaints import Complaints, KeyPath, excerpt, listed, suggestion
from fvi_cli.config.document import ListNode, MappingNode, Node, ScalarNode
from fvi_cli.config.shapes import (
    INVALID,
    OPTIONAL,
    REQUIRED,
    Choice,
    Missing,
    Schema,
    Shape,
    needed,
)


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


class MappingShape(Shape, Protocol):
    """What may stand under a key as a mapping."""

    def is_meant(self, node: MappingNode) -> bool:
        """Whether a mapping has any key of this shape."""


@dataclass(frozen=True, kw_only=True)
class ByForm:
    """Different shapes for a single value, a list and a mapping."""

    single: Shape | None = None
    several: Shape | None = None
    mapping: MappingShape | None = None
    example: str = ""

    @property
    def expected(self) -> str:
        """What is allowed."""
        example = f"; for example {self.example}" if self.example else ""
        return "; or ".join(shape.expected for shape in self._shapes()) + example

    def _astray(self, node: Node) -> tuple[MappingNode, KeyPath] | None:
        """A mapping of which the example says more than complaints about what is inside of it."""
        if not self.example:
            return None
        if isinstance(node, ListNode):
            entry = self.several.shape if isinstance(self.several, ListOf) else None
            allowed = entry.mapping if isinstance(entry, ByForm) else None
            for index, item in enumerate(node.items):
                if isinstance(item, MappingNode) and not (allowed and allowed.is_meant(item)):
                    return item, (index,)
        elif isinstance(node, MappingNode) and self.mapping and not self.mapping.is_meant(node):
            return node, ()
        return None

    def _shapes(self) -> list[Shape]:
        return [s for s in (self.single, self.several, self.mapping) if s is not None]

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """What the shape for this form of node reads."""
        shape = self.single
        if isinstance(node, ListNode):
            shape = self.several
        elif isinstance(node, MappingNode):
            shape = self.mapping
        is_empty = isinstance(node, ScalarNode) and node.value is None
        astray = self._astray(node)
        if astray is not None and shape is not None:
            found, key = astray
            keys = f" with {excerpt(listed(found.entries))}" if found.entries else ""
            where = " in a list; the whole" if key else "; it"
            message = f"a mapping{keys} is not allowed{where} must be {self.expected}"
            complaints.add(found.place, (*path, *key), message)
            return INVALID
        if shape is None or is_empty:
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        return shape.read(node, path, complaints)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [shape.schema() for shape in self._shapes()]}


@dataclass(frozen=True, kw_only=True)
class Named:
    """A mapping from names that the user chooses to equal things."""

    shape: Shape
    example: str = ""

    @property
    def expected(self) -> str:
        """What is allowed."""
        example = f", such as {self.example}" if self.example else ""
        return f"a mapping from names to values, each {self.shape.expected}{example}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A dict."""
        if not isinstance(node, MappingNode):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        return {
            name: self.shape.read(entry.node, (*path, name), complaints)
            for name, entry in node.entries.items()
        }

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": "object", "additionalProperties": self.shape.schema()}


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
    alternatives
        Keys of which one must be given and no other; the schema says so, who reads checks it.
    """

    keys: tuple[Key, ...]
    refused: Mapping[str, Refusal] = field(default_factory=dict, hash=False)
    alternatives: tuple[str, ...] = ()

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"a mapping with {listed(key.name for key in self.keys)}"

    def is_meant(self, node: MappingNode) -> bool:
        """Whether a mapping has any of the keys."""
        return any(key.name in node.entries for key in self.keys)

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
            **self._one_of(),
            "additionalProperties": False,
        }

    def _one_of(self) -> Schema:
        if not self.alternatives:
            return {}
        return {"oneOf": [{"required": [name]} for name in self.alternatives]}


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
