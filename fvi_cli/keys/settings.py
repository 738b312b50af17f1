"""Settings: frozen values whose annotated fields are the keys of a mapping.

A field declares the allowed values of its key, their meaning, unit and default::

    class Pendulum(Setting):
        omega: NotNegative = key("Angular frequency.", unit="1/time", default=1.0)

The same declaration reads YAML with complaints at their places, checks arguments in Python, fills
in defaults, builds the value, and describes the key in the JSON schema and in the reference.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import FrozenInstanceError, dataclass, field, replace
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_origin

from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import (
    Complaints,
    KeyPath,
    SourcePosition,
    listed,
    not_known,
)
from fvi_cli.keys.containers import ListOf, Named
from fvi_cli.keys.cursor import INVALID, OPTIONAL, REQUIRED, Built, Cursor, Missing, is_complete
from fvi_cli.keys.nodes import MappingNode, node_of
from fvi_cli.keys.scalars import Choice, Flag, Number, Schema, Shape, Text, referred

Positive = Annotated[float, Number(above=0.0)]
NotNegative = Annotated[float, Number(least=0.0)]
Fraction = Annotated[float, Number(above=0.0, below=1.0)]


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key of a setting: its allowed values, and for readers their meaning."""

    name: str
    attribute: str  # the field of the setting
    shape: Shape = field(hash=False)
    meaning: str
    unit: str = ""  # such as ``mass per time^2``
    # the plain value of an absent key; REQUIRED; or OPTIONAL: an absent key has no value
    default: Any = field(hash=False)

    @property
    def description(self) -> str:
        """The meaning with the unit."""
        return f"{self.meaning.removesuffix('.')} ({self.unit})." if self.unit else self.meaning


def key(meaning: str, *, unit: str = "", default: Any = REQUIRED) -> Any:
    """A field that is a key; `default` is the plain value if it is absent, None: it has none."""
    return partial(
        Key, meaning=meaning, unit=unit, default=OPTIONAL if default is None else default
    )


@typing.dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(key,))
class Setting(Built):
    """A mapping with known keys, and the value that it makes.

    A field whose key is a word of Python has ``_`` at the end of its name. Class variables can be
    given as arguments of the class.
    """

    refused: ClassVar[Mapping[str, str]] = {}
    """Wrong keys that get a complaint of their own, with this complaint."""
    forms: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Groups of keys; exactly one group must be given. Optional keys of a group end in ``?``."""
    declares: ClassVar[str] = ""
    """A key with a mapping; expressions under all keys may use the names of this mapping."""
    expected: ClassVar[str] = ""
    """What is allowed, in words that replace *a mapping with ...*."""

    keys: ClassVar[Mapping[str, Key]] = {}
    """The keys by their names; those of the class come before inherited ones."""

    def __init_subclass__(cls, **variables: Any) -> None:
        for name, value in variables.items():
            setattr(cls, name, value)
        hints = typing.get_type_hints(cls, include_extras=True)
        found: dict[str, Key] = {}
        # an inherited key that a class sets to another value is no key of that class
        known: set[str] = set()
        for owner in cls.__mro__:
            for name, one in vars(owner).items():
                if isinstance(one, partial) and name not in known:
                    word, shape = name.rstrip("_"), shape_of(hints[name])
                    found[word] = one(name=word, attribute=name, shape=shape)
                known.add(name)
        cls.keys = found

    def __init__(self, **given: Any) -> None:
        names = {one.attribute: one.name for one in self.keys.values()}
        if unknown := [name for name in given if name not in names]:
            raise TypeError(f"{type(self).__name__} has no {unknown[0]}")
        values = {names[name]: as_plain(one) for name, one in given.items() if one is not None}
        self._fill(
            record_of(type(self)).read(Cursor(node=node_of(values), complaints=RaisingComplaints()))
        )

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """The value of plain values that were read, with the defaults of absent keys.

        It contains INVALID where the plain values do.
        """
        made = object.__new__(cls)
        made._fill(values)
        return made

    def with_values(self, values: Mapping[str, Any], names: Iterable[str]) -> Self:
        """A copy of the value in which the keys `names` are built again from plain values."""
        made = self.replaced()
        made._fill(values, [self.keys[name] for name in names])
        return made

    def _fill(self, values: Mapping[str, Any], keys: Iterable[Key] | None = None) -> None:
        for one in self.keys.values() if keys is None else keys:
            value = values.get(one.name, one.default)
            if value is REQUIRED:
                raise ArgumentError(one.name, f"missing; it must be {one.shape.expected}")
            self.__dict__[one.attribute] = None if value is OPTIONAL else one.shape.build(value)

    def value(self) -> Any:
        """The value that replaces the mapping in the setting around it."""
        return self

    def replaced(self, **changes: Any) -> Self:
        """A copy of the value with other fields, which are not checked."""
        made = object.__new__(type(self))
        made.__dict__.update(self.__dict__, **changes)
        return made

    @classmethod
    def check_presence(cls, at: Cursor) -> None:
        """Complain of missing or superfluous keys, whatever their values are."""

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """Check valid values of all keys together; returns plain values to replace them."""
        return values

    def __setattr__(self, name: str, value: Any) -> None:
        raise FrozenInstanceError(f"cannot assign to {name}")

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash(repr(self))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in vars(self).items())})"


class PlainSetting(Setting):
    """A setting whose value is its plain mapping, which is sent along with results."""

    def value(self) -> Any:
        """The plain values."""
        return as_plain(self)


class RaisingComplaints(Complaints):
    """Raises the first complaint as an ArgumentError."""

    def add(self, place: SourcePosition, path: KeyPath, message: str) -> None:
        """Raise the complaint."""
        raise ArgumentError(".".join(map(str, path)), message)


@dataclass(frozen=True, kw_only=True)
class Record(Shape):
    """The shape of the mapping of a setting, with keys in the order in which they are shown.

    `variant` is appended to its name in the schema if its keys differ from those of the setting.
    """

    of: type[Setting] = field(hash=False)
    keys: Mapping[str, Key] = field(hash=False)
    variant: str = ""

    @property
    def expected(self) -> str:
        """What is allowed."""
        return self.of.expected or f"a mapping with {listed(self.keys)}"

    def has_any(self, names: Container[str]) -> bool:
        """Whether any of the keys is among `names`."""
        return any(name in names for name in self.keys)

    def read(self, at: Cursor) -> Any:
        """A dict with every key that is given or has a default."""
        if not isinstance(at.node, MappingNode):
            return at.needs(self.expected)
        for name, _ in at.entries():
            if name not in self.keys:
                reason = self.of.refused.get(name) or not_known(name, self.keys)
                at.refuse_key(name, reason)
        values: dict[str, Any] = {}
        declares = self.of.declares
        if declares and at.has(declares):
            at = replace(at, names=tuple(name for name, _ in at.under(declares).entries()))
        for name, one in self.keys.items():
            if at.has(name):
                values[name] = one.shape.read(at.under(name))
            elif one.default is REQUIRED:
                values[name] = at.refuse(f"missing; it must be {one.shape.expected}", name)
            elif one.default is not OPTIONAL:
                values[name] = as_plain(one.default)
        self.of.check_presence(at)
        if self.of.check is Setting.check:
            return values
        return self.of.of(values).check(at, values) if is_complete(values) else INVALID

    def build(self, value: Any) -> Any:
        """The value that a mapping makes."""
        return self.of.of(value).value() if isinstance(value, Mapping) else value

    def schema(self, defs: Schema) -> Schema:
        """A reference."""
        return referred(self.of.__name__ + self.variant, defs, self.whole)

    def whole(self, defs: Schema) -> Schema:
        """The whole schema."""
        properties = {}
        for name, one in self.keys.items():
            described = {"description": one.description, **one.shape.schema(defs)}
            if not isinstance(one.default, Missing):
                described["default"] = as_plain(one.default)
            properties[name] = described
        return {
            "type": "object",
            "properties": properties,
            "required": [name for name, one in self.keys.items() if one.default is REQUIRED],
            **({"allOf": [{"oneOf": list(self._one_form())}]} if self.of.forms else {}),
            "additionalProperties": False,
        }

    def _one_form(self) -> Iterator[Schema]:
        every = [name.rstrip("?") for form in self.of.forms for name in form]
        for form in self.of.forms:
            names = [name.rstrip("?") for name in form]
            others = [{"required": [name]} for name in every if name not in names]
            needed = [name for name in form if not name.endswith("?")]
            yield {"required": needed, "not": {"anyOf": others}}


def record_of(setting: type[Setting], **defaults: Any) -> Record:
    """The shape of the mapping of a setting, with other defaults for some of its keys."""
    changed = {name: replace(setting.keys[name], default=one) for name, one in defaults.items()}
    variant = "".join(f"-{name}-{value}" for name, value in defaults.items())
    return Record(of=setting, keys={**setting.keys, **changed}, variant=variant)


def shape_of(hint: Any) -> Shape:
    """The shape of a key, by the annotation of its field."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return next(one for one in inner[1:] if isinstance(one, Shape))
    if origin in (typing.Union, types.UnionType):
        (only,) = (one for one in inner if one is not type(None))
        return shape_of(only)
    if origin is Literal:
        return Choice(words=inner)
    if origin in (tuple, Sequence):
        return ListOf(shape=shape_of(inner[0]))
    if origin in (dict, Mapping):
        return Named(shape=shape_of(inner[1]))
    if isinstance(hint, type) and issubclass(hint, Setting):
        return record_of(hint)
    return {float: Number(), bool: Flag(), str: Text()}[hint]


def as_plain(value: Any) -> Any:
    """A value as the JSON values that a configuration has for it."""
    if isinstance(value, Setting):
        given = ((one.name, getattr(value, one.attribute)) for one in value.keys.values())
        return {name: as_plain(one) for name, one in given if one is not None}
    if isinstance(value, Mapping):
        return {name: as_plain(one) for name, one in value.items()}
    return [as_plain(one) for one in value] if isinstance(value, list | tuple) else value
