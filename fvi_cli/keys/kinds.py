"""Mappings of several kinds, distinguished by the word under one key."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fvi_cli.keys.cursor import INVALID, Cursor
from fvi_cli.keys.nodes import MappingNode
from fvi_cli.keys.scalars import Choice, Schema, Shape, referred
from fvi_cli.keys.settings import Record


@dataclass(frozen=True, kw_only=True)
class ByKind(Shape):
    """Records that are distinguished by the word under the key `word`.

    For the `default` kind the values that are read lack the key, whether it was written or not.
    `meant` has advice for words that are no kinds; `name` is the name in the schema.
    """

    kinds: Mapping[str, Record] = field(hash=False)
    word: str = "kind"
    meaning: str = "which equation"
    default: str = ""
    meant: Mapping[str, str] = field(default_factory=dict, hash=False)
    name: str = ""

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"a mapping with {self.word} and the keys of that {self.word}"

    def read(self, at: Cursor) -> Any:
        """A dict that begins with the key, unless the kind is the default."""
        if not isinstance(at.node, MappingNode):
            return at.needs(self.expected)
        choice = Choice(words=tuple(self.kinds))
        kind: Any = self.default
        word = at.under(self.word).scalar if at.has(self.word) else None
        if isinstance(word, str) and word in self.meant:
            return at.refuse(f"{word}: {self.meant[word]}", self.word)
        if at.has(self.word):
            kind = choice.read(at.under(self.word))
        elif not self.default:
            kind = at.refuse(f"missing; it must be {choice.expected}", self.word)
        if kind is INVALID:
            # do not read the other keys: they belong to the unknown kind
            return INVALID
        record = self.kinds[kind]
        rest = {name: entry for name, entry in at.node.entries.items() if name != self.word}
        node = MappingNode(place=at.node.place, entries=rest)
        values = record.read(Cursor(node=node, complaints=at.complaints, path=at.path))
        is_default = self.default and kind == self.default
        return values if is_default or values is INVALID else {self.word: kind, **values}

    def build(self, value: Any) -> Any:
        """The value that the record of its kind makes."""
        if not isinstance(value, Mapping):
            return value
        record = self.kinds.get(value.get(self.word, self.default))
        return value if record is None else record.build(value)

    def schema(self, defs: Schema) -> Schema:
        """A reference if the shape has a name; else the whole schema."""
        return referred(self.name, defs, self._whole) if self.name else self._whole(defs)

    def _whole(self, defs: Schema) -> Schema:
        variants = []
        for kind, record in self.kinds.items():
            variant = record.whole(defs)
            word: Schema = {"description": self.meaning, "const": kind}
            if self.default:
                word["default"] = self.default
            variant["properties"] = {self.word: word, **variant["properties"]}
            if kind != self.default:
                variant["required"] = [self.word, *variant["required"]]
            variants.append(variant)
        return {"oneOf": variants}
