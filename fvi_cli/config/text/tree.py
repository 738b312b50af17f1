"""YAML text to plain values, with the place of every value and of every key.

Words are read by the core schema of YAML 1.2: ``1e-3`` is a number, ``no`` and ``on`` are text,
``0o17`` is 15 and ``017`` is 17. The values are built from the parser's events with limits on
their size, because the text may be hostile.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import yaml

from fvi_cli.errors import printable
from fvi_cli.scenes.keys.values import KeyPath, Wrong

LARGEST_TEXT: Final = 1_000_000  # characters
DEEPEST_NESTING: Final = 50
MOST_VALUES: Final = 50_000  # with those that aliases repeat
LONGEST_NUMBER: Final = 400  # digits; longer ones count as infinite

_INTEGER: Final = re.compile(r"[-+]?[0-9]+")
_OTHER_BASE: Final = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS: Final[dict[str, Any]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan),
    **{
        sign + word: float(sign + "inf")
        for sign in ("", "+", "-")
        for word in (".inf", ".Inf", ".INF")
    },
}


@dataclass(frozen=True, order=True)
class Place:
    """A position in a source, counted from 1; line 0: none, as for what the command line gives."""

    source: str = ""
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}" if self.line else self.source


@dataclass(frozen=True, order=True)
class Mistake:
    """What is wrong, at which place and key."""

    place: Place
    path: KeyPath = field(compare=False)
    message: str = ""

    def __str__(self) -> str:
        words = f"{shown(self.path)}: {self.message}" if self.path else self.message
        return printable(f"{self.place}: {words}")


def shown(path: KeyPath) -> str:
    """A key path as it is written for ``--set``."""
    return ".".join(map(str, path))


@dataclass
class Document:
    """Plain values, and their places in a text if they stand in one."""

    source: str
    value: Any = None
    places: dict[KeyPath, Place] = field(default_factory=dict)  # of values
    key_places: dict[KeyPath, Place] = field(default_factory=dict)
    quoted: set[KeyPath] = field(default_factory=set)  # texts whose columns are not the file's
    aliases: dict[KeyPath, KeyPath] = field(default_factory=dict)  # to what they repeat

    def origin(self, path: KeyPath) -> KeyPath:
        """The path at which something is written that aliases may repeat elsewhere."""
        for depth in range(len(path), 0, -1):
            if path[:depth] in self.aliases:
                return self.origin((*self.aliases[path[:depth]], *path[depth:]))
        return path

    def place(self, path: KeyPath, *, of_key: bool = False, column: int | None = None) -> Place:
        """The place of a value, or of its key; where it is missing, of what should hold it.

        `column` counts from 1 in a text that stands there.
        """
        path = self.origin(path)
        if of_key and path in self.key_places:
            return self.key_places[path]
        if column and path in self.places and path not in self.quoted:
            place = self.places[path]
            return Place(place.source, place.line, place.column + column - 1)
        while path and path not in self.places:
            path = path[:-1]
        return self.places.get(path, Place(self.source))

    def placed(self, wrong: Wrong) -> Mistake:
        """A mistake with its place."""
        place = self.place(wrong.path, of_key=wrong.of_key, column=wrong.column)
        return Mistake(place, wrong.path, wrong.message)

    def move(self, path: KeyPath, other: KeyPath) -> None:
        """Give what stands at a path the places of another path."""
        origin, depth = self.origin(other), len(self.origin(other))
        self.forget(path)
        for known in (self.places, self.key_places):
            inner = {one: at for one, at in known.items() if one[:depth] == origin}
            known.update({(*path, *one[depth:]): at for one, at in inner.items()})
        self.quoted |= {(*path, *one[depth:]) for one in self.quoted if one[:depth] == origin}

    def forget(self, path: KeyPath) -> None:
        """Forget the places at a path and below."""
        path = self.origin(path)
        for known in (self.places, self.key_places):
            for inside in [one for one in known if one[: len(path)] == path]:
                del known[inside]


class MistakesError(Exception):
    """All mistakes of a text."""

    def __init__(self, *mistakes: Mistake) -> None:
        super().__init__(*mistakes)
        self.mistakes = list(mistakes)


def read_scalar(text: str) -> Any:
    """The value of an unquoted word by the core schema of YAML 1.2."""
    if text in _WORDS:
        return _WORDS[text]
    is_integer = _INTEGER.fullmatch(text) or _OTHER_BASE.fullmatch(text)
    if is_integer and len(text) > LONGEST_NUMBER:
        return -math.inf if text.startswith("-") else math.inf
    if is_integer:
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
    return float(text) if _FLOAT.fullmatch(text) else text


def read_document(text: str, source: str) -> Document:
    """Read the single YAML document of a text.

    Anchors and aliases are understood; tags, repeated keys, a second document, and keys that are
    not words are mistakes.

    Raises
    ------
    MistakesError
        If the text is not YAML or too large, with all repeated keys and tags.
    """
    if len(text) > LARGEST_TEXT:
        message = f"more than {LARGEST_TEXT} characters: too large"
        raise MistakesError(Mistake(Place(source, 1, 1), (), message))
    return _Reader(text, source).document()


class _Reader:
    """Builds the values from events."""

    def __init__(self, text: str, source: str) -> None:
        self.source, self.found = source, Document(source)
        self.mistakes: list[Mistake] = []
        self.events = _events(text, source)
        # path, value and number of values; None: the end of the anchor has not been read
        self.anchors: dict[str, tuple[KeyPath, Any, int] | None] = {}
        self.size = 0

    def document(self) -> Document:
        documents = 0
        for event in self.events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if event.version not in (None, (1, 2)) or event.tags:
                    self.add(self.place(event), (), "directives other than %YAML 1.2 are not read")
                if documents > 1:
                    self.give_up(event, (), "a second document begins here; one file holds one")
                self.found.value = self.value(next(self.events), ())
        if self.found.value is None:
            message = "the configuration is empty; `fvi new` writes one"
            self.add(Place(self.source, 1, 1), (), message)
        if self.mistakes:
            raise MistakesError(*self.mistakes)
        return self.found

    def value(self, event: Any, path: KeyPath) -> Any:
        """The value that begins with an event."""
        self.found.places[path] = place = self.place(event)
        if isinstance(event, yaml.AliasEvent):
            return self.repeated(event, path)
        if len(path) > DEEPEST_NESTING:
            self.give_up(event, (), f"nested more than {DEEPEST_NESTING} deep")
        self.count(event, path, 1)
        if event.tag is not None:
            self.add(place, path, f"the tag {event.tag!r} is not allowed; write the plain value")
        before, value = self.size, None
        if event.anchor is not None:
            self.anchors[event.anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            value = self.scalar(event, path)
        elif isinstance(event, yaml.SequenceStartEvent):
            value = [self.value(one, (*path, n)) for n, one in enumerate(self.until_end())]
        else:
            value = self.mapping(path)
        if event.anchor is not None:
            self.anchors[event.anchor] = path, value, self.size - before + 1
        return value

    def until_end(self) -> Iterator[Any]:
        """The events with which entries of a list or mapping begin."""
        for event in self.events:
            if isinstance(event, yaml.CollectionEndEvent):
                return
            yield event

    def scalar(self, event: Any, path: KeyPath) -> Any:
        is_plain = event.style in (None, "")
        value = read_scalar(event.value) if is_plain else event.value
        if not is_plain or event.start_mark.line != event.end_mark.line:
            self.found.quoted.add(path)
        return value

    def mapping(self, path: KeyPath) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for event in self.until_end():
            place = self.place(event)
            if not isinstance(event, yaml.ScalarEvent):
                self.give_up(event, path, "a key must be a word")
            key = event.value
            if key in values:
                line = self.found.key_places[*path, key].line
                self.add(place, (*path, key), f"given twice, first in line {line}")
            self.found.key_places.setdefault((*path, key), place)
            values[key] = self.value(next(self.events), (*path, key))
        return values

    def repeated(self, event: Any, path: KeyPath) -> Any:
        """The value of an alias: that of its anchor."""
        known = self.anchors.get(event.anchor)
        if known is None:
            message = f"there is no complete anchor &{event.anchor} before it"
            return self.give_up(event, path, message)
        origin, value, size = known
        self.found.aliases[path] = origin
        self.count(event, path, size)
        return value

    def count(self, event: Any, path: KeyPath, values: int) -> None:
        self.size += values
        if self.size > MOST_VALUES:
            self.give_up(event, path, f"more than {MOST_VALUES} values, with repeated ones")

    def place(self, event: Any) -> Place:
        return Place(self.source, event.start_mark.line + 1, event.start_mark.column + 1)

    def add(self, place: Place, path: KeyPath, message: str) -> None:
        self.mistakes.append(Mistake(place, path, message))

    def give_up(self, event: Any, path: KeyPath, message: str) -> Any:
        self.add(self.place(event), path, message)
        raise MistakesError(*self.mistakes)


def _events(text: str, source: str) -> Iterator[yaml.Event]:
    """Events of the fast parser in C; if it finds a mistake, those of the one in Python.

    The messages of the latter are better, and it is always there.
    """
    fast = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    with contextlib.suppress(yaml.YAMLError):
        return iter(list(yaml.parse(text, fast)))
    return _slow_events(text, source)


def _slow_events(text: str, source: str) -> Iterator[yaml.Event]:
    place = Place(source, 1, 1)
    try:
        yield from yaml.parse(text, yaml.SafeLoader)
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        place = Place(source, before.count("\n") + 1, error.position - before.rfind("\n"))
        raise MistakesError(Mistake(place, (), "a character that YAML does not allow")) from None
    except yaml.MarkedYAMLError as error:
        if mark := error.problem_mark or error.context_mark:
            place = Place(source, mark.line + 1, mark.column + 1)
        message = f"not YAML: {error.problem}; is the indentation right, does a text need quotes?"
        raise MistakesError(Mistake(place, (), message)) from None
    except (ValueError, OverflowError, IndexError, yaml.YAMLError):
        raise MistakesError(Mistake(place, (), "not YAML: a wrong escape")) from None
