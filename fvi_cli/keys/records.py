"""Mappings with known keys: each key declared once, with its shape, meaning, unit and default."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Protocol

from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.keys.containers import MappingShape
from fvi_cli.keys.cursor import INVALID, OPTIONAL, REQUIRED, Cursor, Missing, is_complete
from fvi_cli.keys.nodes import MappingNode, ScalarNode
from fvi_cli.keys.scalars import Choice, Schema, Shape, referred
from fvi_cli.mathematics.algebra.syntax import difference_of_sides

_logger = logging.getLogger(__name__)
Refusal = str | Callable[[Cursor], str]


@dataclass(frozen=True)
class Key:
    """A key of a record: what may stand under it, and for readers what that means.

    `unit` is in words, such as ``mass per time^2``; `default` the plain value of an absent key,
    REQUIRED, or OPTIONAL for none; `attribute` the field of the setting.
    """

    name: str
    shape: Shape = field(hash=False)
    meaning: str
    _: KW_ONLY
    unit: str = ""
    default: Any = field(default=REQUIRED, hash=False)
    attribute: str = ""

    @property
    def description(self) -> str:
        """The meaning with the unit."""
        return f"{self.meaning.removesuffix('.')} ({self.unit})." if self.unit else self.meaning


class Made(Protocol):
    """A value that a mapping makes."""

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Made:
        """The value of plain ones that were read."""

    def value(self) -> Any:
        """What stands where this is built."""

    @classmethod
    def check_presence(cls, at: Cursor) -> None:
        """Complain of keys that must be there, or must not."""


@dataclass(frozen=True, kw_only=True)
class Record(MappingShape):
    """A mapping with known keys, in the order in which they are filled in and shown.

    The fields are those of :class:`fvi_cli.keys.settings.Setting`, the value `of` which is made;
    `variant` stands behind its name in the schema where its defaults are others, and `check` gives
    the plain values that stand for what was read.
    """

    keys: tuple[Key, ...]
    refused: Mapping[str, Refusal] = field(default_factory=dict, hash=False)
    forms: tuple[tuple[str, ...], ...] = ()
    declares: str = ""
    words: str = ""
    of: type[Made] | None = field(default=None, hash=False)
    variant: str = ""
    check: Callable[[Any, Cursor, dict[str, Any]], Any] | None = field(default=None, hash=False)

    @property
    def expected(self) -> str:
        """What is allowed."""
        return self.words or f"a mapping with {listed(self.names)}"

    @property
    def names(self) -> list[str]:
        """The keys as they are written."""
        return [key.name for key in self.keys]

    def has_any(self, names: Container[str]) -> bool:
        """Whether any of the keys is among those of a mapping."""
        return any(name in names for name in self.names)

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
        if self.of is not None:
            self.of.check_presence(at)
        if self.of is None or self.check is None:
            return values
        return self.check(self.of.of(values), at, values) if is_complete(values) else INVALID

    def build(self, value: Any) -> Any:
        """The value that a mapping makes."""
        return self.of.of(value).value() if self.of and isinstance(value, Mapping) else value

    def _meant(self, at: Cursor) -> str:
        """How a number or word is written where it fits under the first key; else nothing."""
        first = self.keys[0]
        word = at.word_for(first.shape)
        # an equation is refused there: an expression that is 0 says the same
        word = difference_of_sides(word) or word
        return f"; write {{{first.name}: {word}}}" if word else ""

    def _unknown(self, name: str, under: Cursor, node: MappingNode) -> str:
        reason = self.refused.get(name)
        if reason is not None:
            return reason if isinstance(reason, str) else reason(under)
        if name.isdecimal() and (number := _with_comma(name, node)):
            return f"not known; numbers have a decimal point, no comma: write {number}"
        return f"not known{suggestion(name, self.names)} (known here: {listed(self.names)})"

    def schema(self, defs: Schema) -> Schema:
        """A reference, where the mapping makes a value; else all of it."""
        if self.of is None:
            return self.whole(defs)
        return referred(self.of.__name__ + self.variant, defs, self.whole)

    def whole(self, defs: Schema) -> Schema:
        """All of it."""
        properties = {}
        for key in self.keys:
            described = {"description": key.description, **key.shape.schema(defs)}
            if not isinstance(key.default, Missing):
                described["default"] = copied(key.default)
            properties[key.name] = described
        return {
            "type": "object",
            "properties": properties,
            "required": [key.name for key in self.keys if key.default is REQUIRED],
            **({"allOf": [{"oneOf": list(self._one_form())}]} if self.forms else {}),
            "additionalProperties": False,
        }

    def _one_form(self) -> Iterator[Schema]:
        for form in self.forms:
            needed = [name for name in form if not name.endswith("?")]
            names = [one.rstrip("?") for one in form]
            others = [n for n in (o.rstrip("?") for f in self.forms for o in f) if n not in names]
            yield {"required": needed, "not": {"anyOf": [{"required": [n]} for n in others]}}


def _with_comma(name: str, node: MappingNode) -> str:
    """``1.5``, where ``{order: 1,5}`` was read as a key ``order`` and a key ``5``."""
    names = list(node.entries)
    before = node.entries[names[names.index(name) - 1]].node if name != names[0] else None
    single = node.entries[name].node
    if not (isinstance(before, ScalarNode) and isinstance(single, ScalarNode)):
        return ""
    is_number = isinstance(before.value, int) and not isinstance(before.value, bool)
    return f"{before.text}.{name}" if is_number and not single.text else ""


def copied(value: Any) -> Any:
    """Plain values, as copies."""
    if isinstance(value, Mapping):
        return {key: copied(entry) for key, entry in value.items()}
    return [copied(entry) for entry in value] if isinstance(value, list | tuple) else value


@dataclass(frozen=True, kw_only=True)
class ByKind(Shape):
    """Records that differ by the word under a key of theirs.

    Where the `default` stands, what is read is without the key, as where none stands. `aliases` are
    other words for kinds, `meant` says what to write in place of words that are not known here, all
    in small letters; `name` is that in the schema.
    """

    kinds: Mapping[str, Record] = field(hash=False)
    word: str = "kind"
    meaning: str = "which equation"
    default: str = ""
    meant: Mapping[str, str] = field(default_factory=dict, hash=False)
    aliases: Mapping[str, str] = field(default_factory=dict, hash=False)
    name: str = ""

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
        if plain in self.aliases or (plain != word and plain in self.kinds):
            kind = self.aliases.get(plain, plain)
            _logger.info("%s: %s: %s is read as %s", at.node.place, self.word, word, kind)
        elif plain not in self.kinds and (inside := [k for k in self.kinds if k in plain]):
            message = f"{excerpt(plain)!r} is not known; did you mean {inside[0]!r}?"
            kind = at.refuse(message, self.word)
        elif at.has(self.word):
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

    def build(self, value: Any) -> Any:
        """What the mapping of its kind makes."""
        if not isinstance(value, Mapping):
            return value
        record = self.kinds.get(value.get(self.word, self.default))
        return value if record is None else record.build(value)

    def schema(self, defs: Schema) -> Schema:
        """A reference, where there is a name for it; else all of it."""
        return referred(self.name, defs, self._whole) if self.name else self._whole(defs)

    def _whole(self, defs: Schema) -> Schema:
        variants = []
        for kind, record in self.kinds.items():
            variant = record.whole(defs)
            also = [alias for alias, meant in self.aliases.items() if meant == kind]
            word: Schema = {"description": self.meaning}
            word |= {"enum": [kind, *also]} if also else {"const": kind}
            if self.default:
                word["default"] = self.default
            variant["properties"] = {self.word: word, **variant["properties"]}
            if kind != self.default:
                variant["required"] = [self.word, *variant["required"]]
            variants.append(variant)
        return {"oneOf": variants}
