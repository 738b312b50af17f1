"""Mappings with known keys: each key declared once, with its shape, meaning, unit and default."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

from fvi_cli.keys.complaints import listed, suggestion
from fvi_cli.keys.cursor import INVALID, OPTIONAL, REQUIRED, Cursor, Missing
from fvi_cli.keys.nodes import MappingNode, ScalarNode
from fvi_cli.keys.scalars import Choice, Schema, Shape
from fvi_cli.mathematics.algebra.syntax import difference_of_sides

Refusal = str | Callable[[Cursor], str]


@dataclass(frozen=True)
class Key:
    """A key of a record.

    Parameters
    ----------
    name
        As it is written.
    shape
        What may stand under it.
    meaning
        For readers of the schema and of starter files.
    unit
        Of the numbers under it, in words, such as ``mass per time^2``; empty: said in `meaning`.
    default
        The plain value of an absent key, REQUIRED, or OPTIONAL for none.
    build
        What a builder gets in place of the plain value; None: that value.
    """

    name: str
    shape: Shape = field(hash=False)
    meaning: str
    _: KW_ONLY
    unit: str = ""
    default: Any = field(default=REQUIRED, hash=False)
    build: Callable[[Any], Any] | None = field(default=None, hash=False)

    @property
    def description(self) -> str:
        """The meaning with the unit."""
        return f"{self.meaning.removesuffix('.')} ({self.unit})." if self.unit else self.meaning


def optional(name: str, shape: Shape, meaning: str, *, unit: str = "") -> Key:
    """A key that may be absent, and has no value then."""
    return Key(name, shape, meaning, unit=unit, default=OPTIONAL)


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
    declares
        Key whose names the expressions under all keys may hold; empty: there is none.
    of_word
        What to write in place of a word where the mapping should stand; empty: nobody knows.
    """

    keys: tuple[Key, ...]
    refused: Mapping[str, Refusal] = field(default_factory=dict, hash=False)
    alternatives: tuple[str, ...] = ()
    declares: str = ""
    of_word: Callable[[str], str] = field(default=lambda word: "", hash=False)

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"a mapping with {listed(self.names)}"

    @property
    def names(self) -> list[str]:
        """The keys as they are written."""
        return [key.name for key in self.keys]

    def is_meant(self, node: MappingNode) -> bool:
        """Whether a mapping has any of the keys."""
        return any(name in node.entries for name in self.names)

    def read(self, at: Cursor) -> Any:
        """A dict with every key that is given or has a default."""
        if not isinstance(at.node, MappingNode):
            return at.needs(self.expected, self._meant(at))
        for name, under in at.entries():
            if name not in self.names:
                at.refuse_key(name, self._unknown(name, under, at.node))
        values: dict[str, Any] = {}
        if self.declares and at.has(self.declares):
            at = replace(at, names=tuple(name for name, _ in at.under(self.declares).entries()))
        for key in self.keys:
            if at.has(key.name):
                values[key.name] = key.shape.read(at.under(key.name))
            elif key.default is REQUIRED:
                message = f"missing; it must be {key.shape.expected}"
                values[key.name] = at.refuse(message, key.name)
            elif key.default is not OPTIONAL:
                values[key.name] = copied(key.default)
        return values

    def _meant(self, at: Cursor) -> str:
        """How a number or word is written where it fits under the first key; else nothing."""
        if isinstance(at.scalar, str) and (written := self.of_word(at.scalar)):
            return f"; write {written}"
        first = self.keys[0]
        word = at.word_for(first.shape)
        # an equation is refused there: an expression that is 0 says the same
        word = difference_of_sides(word) or word
        return f"; write {{{first.name}: {word}}}" if word else ""

    def filled(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Plain values with the defaults of absent keys, in mappings below as well."""
        full = {
            key.name: copied(key.default)
            for key in self.keys
            if key.name not in values and not isinstance(key.default, Missing)
        }
        for key in self.keys:
            if key.name in values:
                given, inner = values[key.name], key.shape
                is_record = isinstance(inner, Record) and isinstance(given, Mapping)
                full[key.name] = inner.filled(given) if is_record else given  # type: ignore[attr-defined]
        return {**values, **full}

    def _unknown(self, name: str, under: Cursor, node: MappingNode) -> str:
        reason = self.refused.get(name)
        if reason is not None:
            return reason if isinstance(reason, str) else reason(under)
        if name.isdecimal() and (number := _with_comma(name, node)):
            return f"not known; numbers have a decimal point, no comma: write {number}"
        return f"not known{suggestion(name, self.names)} (known here: {listed(self.names)})"

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        properties = {}
        for key in self.keys:
            described = {"description": key.description, **key.shape.schema()}
            if not isinstance(key.default, Missing):
                described["default"] = copied(key.default)
            properties[key.name] = described
        one_of = {"oneOf": [{"required": [name]} for name in self.alternatives]}
        return {
            "type": "object",
            "properties": properties,
            "required": [key.name for key in self.keys if key.default is REQUIRED],
            **(one_of if self.alternatives else {}),
            "additionalProperties": False,
        }


def _with_comma(name: str, node: MappingNode) -> str:
    """``1.5``, where ``{order: 1,5}`` was read as a key ``order`` and a key ``5``."""
    names = list(node.entries)
    before = node.entries[names[names.index(name) - 1]].node if name != names[0] else None
    alone = node.entries[name].node
    if not (isinstance(before, ScalarNode) and isinstance(alone, ScalarNode)):
        return ""
    is_number = isinstance(before.value, int) and not isinstance(before.value, bool)
    return f"{before.text}.{name}" if is_number and not alone.text else ""


def copied(value: Any) -> Any:
    """Plain values that nobody else holds."""
    if isinstance(value, Mapping):
        return {key: copied(entry) for key, entry in value.items()}
    return [copied(entry) for entry in value] if isinstance(value, list | tuple) else value


@dataclass(frozen=True, kw_only=True)
class ByKind:
    """Records that differ by the word under a key of theirs.

    Parameters
    ----------
    kinds
        The records by their words.
    word
        The key.
    meaning
        What the word says.
    default
        The word where none stands; what is read then is without the key, as it is where this word
        stands.
    meant
        What to write in place of words that are not known here, in small letters.
    """

    kinds: Mapping[str, Record] = field(hash=False)
    word: str = "kind"
    meaning: str = "which equation"
    default: str = ""
    meant: Mapping[str, str] = field(default_factory=dict, hash=False)

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"a mapping with {self.word} and the keys of that {self.word}"

    def read(self, at: Cursor) -> Any:
        """A dict that begins with the key, unless the default stands there."""
        if not isinstance(at.node, MappingNode):
            return at.needs(self.expected)
        choice = Choice(words=tuple(self.kinds))
        kind: Any = self.default
        word = at.under(self.word).scalar if at.has(self.word) else None
        plain = re.sub(r"[\s_]+", "-", word.lower()) if isinstance(word, str) else ""
        if plain in self.meant:
            # the keys beside it are those of what is not known
            return at.refuse(f"{plain}: {self.meant[plain]}", self.word)
        if at.has(self.word):
            kind = choice.read(at.under(self.word))
        elif not self.default:
            kind = at.refuse(f"missing; it must be {choice.expected}", self.word)
        record = self.kinds[kind] if kind is not INVALID else self._of_any_kind()
        rest = {name: entry for name, entry in at.node.entries.items() if name != self.word}
        node = MappingNode(place=at.node.place, entries=rest)
        values = record.read(Cursor(node=node, complaints=at.complaints, path=at.path))
        is_default = self.default and kind == self.default
        return values if is_default or values is INVALID else {self.word: kind, **values}

    def _of_any_kind(self) -> Record:
        """Every key of every kind, none of them required."""
        keys: dict[str, Key] = {}
        refused: dict[str, Refusal] = {"type": f"not a key: write {self.word}"}
        for record in self.kinds.values():
            refused.update(record.refused)
            for key in record.keys:
                keys.setdefault(key.name, Key(key.name, key.shape, key.meaning, default=OPTIONAL))
        return Record(keys=tuple(keys.values()), refused=refused)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        variants = []
        for kind, record in self.kinds.items():
            variant = record.schema()
            word: Schema = {"const": kind, "description": self.meaning}
            if self.default:
                word["default"] = self.default
            variant["properties"] = {self.word: word, **variant["properties"]}
            if kind != self.default:
                variant["required"] = [self.word, *variant["required"]]
            variants.append(variant)
        return {"oneOf": variants}
