"""Settings: frozen values whose annotated fields are the keys of a mapping.

A field says what may stand under its key, what that means, its unit and its default::

    class Pendulum(Setting):
        omega: NotNegative = key("Angular frequency.", unit="1/time", default=1.0)

The same declaration reads YAML with complaints at their places, checks what Python gives, fills in
defaults, builds the value, and describes the key in the JSON schema and in the reference.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import FrozenInstanceError, replace
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_origin

from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import Complaints, KeyPath, SourcePosition
from fvi_cli.keys.containers import ListOf, Named
from fvi_cli.keys.cursor import OPTIONAL, REQUIRED, Built, Cursor
from fvi_cli.keys.nodes import node_of
from fvi_cli.keys.records import Key, Record
from fvi_cli.keys.scalars import Choice, Flag, Number, Shape, Text

Positive = Annotated[float, Number(above=0.0)]
NotNegative = Annotated[float, Number(least=0.0)]
Fraction = Annotated[float, Number(above=0.0, below=1.0)]


class _Field:
    """What a field says beside its annotation."""

    def __init__(self, meaning: str, unit: str, default: Any) -> None:
        self.meaning, self.unit, self.default = meaning, unit, default


def key(meaning: str, *, unit: str = "", default: Any = REQUIRED) -> Any:
    """A field that is a key; `default` is the plain value of an absent one, None: there is none."""
    return _Field(meaning, unit, OPTIONAL if default is None else default)


@typing.dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(key,))
class Setting(Built):
    """A mapping with known keys, and the value that it makes.

    A name that Python has taken stands with ``_`` behind it. Class arguments are fields of
    :class:`Record`: `refused` keys with reasons, `forms`, groups of keys of which exactly one is
    given (``?`` behind those that it can do without), the key whose names the expressions under
    all keys may hold (`declares`), and `words` in place of *a mapping with ...*.
    """

    options: ClassVar[Mapping[str, Any]] = {}
    keys: ClassVar[tuple[Key, ...]] = ()
    plan: ClassVar[tuple[tuple[str, str, Any, Callable[[Any], Any] | None], ...]] = ()

    def __init_subclass__(cls, **options: Any) -> None:
        cls.options = {**cls.options, **options}

    def __init__(self, **given: Any) -> None:
        names = {one.attribute: one.name for one in keys_of(type(self))}
        if unknown := [name for name in given if name not in names]:
            raise TypeError(f"{type(self).__name__} has no {unknown[0]}")
        values = {names[name]: as_plain(one) for name, one in given.items() if one is not None}
        read = record_of(type(self)).read(
            Cursor(node=node_of(values), complaints=RaisingComplaints())
        )
        self._fill(read)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """The value of plain ones that were read, with the defaults of absent keys.

        What is not valid stands as INVALID in it.
        """
        made = object.__new__(cls)
        made._fill(values)
        return made

    def _fill(self, values: Mapping[str, Any]) -> None:
        keys_of(type(self))
        found = self.__dict__
        for name, attribute, default, build in self.plan:
            value = values.get(name, default)
            if value is OPTIONAL:
                value = None
            elif value is REQUIRED:
                (wanted,) = (one.shape for one in self.keys if one.name == name)
                raise ArgumentError(name, f"missing; it must be {wanted.expected}")
            elif build is not None:
                value = build(value)
            found[attribute] = value

    def value(self) -> Any:
        """What stands where this is built."""
        return self

    def replaced(self, **changes: Any) -> Self:
        """The same value with other fields, which are not checked."""
        made = object.__new__(type(self))
        made.__dict__.update(self.__dict__, **changes)
        return made

    @classmethod
    def check_presence(cls, at: Cursor) -> None:
        """Complain of keys that must be there, or must not, whatever stands under them."""

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The plain values that stand for what was read, once every key is well by itself."""
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
    """A mapping that stays one where it is built: it travels with results."""

    def value(self) -> Any:
        """The plain values."""
        return as_plain(self)


class RaisingComplaints(Complaints):
    """Raises the first complaint as an ArgumentError."""

    def add(self, place: SourcePosition, path: KeyPath, message: str) -> None:
        """Raise it."""
        raise ArgumentError(".".join(map(str, path)), message)


def keys_of(setting: type[Setting]) -> tuple[Key, ...]:
    """The keys of a setting, its own before those that it shares with others."""
    if "keys" in vars(setting):
        return setting.keys
    hints = typing.get_type_hints(setting, include_extras=True)
    found: dict[str, Key] = {}
    # what a class sets to something else is no key of its
    gone: set[str] = set()
    for owner in setting.__mro__:
        for name, one in vars(owner).items():
            if not isinstance(one, _Field):
                gone.add(name)
            elif name not in found and name not in gone:
                word, shape = name.rstrip("_"), shape_of(hints[name])
                more = {"unit": one.unit, "default": one.default, "attribute": name}
                found[name] = Key(word, shape, one.meaning, **more)
    setting.keys = tuple(found.values())
    setting.plan = tuple(
        (one.name, one.attribute, one.default, one.shape.build)
        if type(one.shape).build is not Shape.build
        else (one.name, one.attribute, one.default, None)
        for one in found.values()
    )
    return setting.keys


def record_of(setting: type[Setting], **defaults: Any) -> Record:
    """The mapping of a setting, with other defaults for some of its keys."""
    keys = tuple(
        replace(one, default=defaults[one.name]) if one.name in defaults else one
        for one in keys_of(setting)
    )
    variant = "".join(f"-{name}-{value}" for name, value in defaults.items())
    check = None if setting.check is Setting.check else setting.check
    return Record(keys=keys, of=setting, variant=variant, check=check, **setting.options)


def shape_of(hint: Any) -> Shape:
    """What may stand under a key, by the annotation of its field."""
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
    """A value as JSON ones: what would be written in a configuration."""
    if isinstance(value, Setting):
        given = ((one.name, getattr(value, one.attribute)) for one in keys_of(type(value)))
        return {name: as_plain(one) for name, one in given if one is not None}
    if isinstance(value, Mapping):
        return {name: as_plain(one) for name, one in value.items()}
    return [as_plain(one) for one in value] if isinstance(value, list | tuple) else value
