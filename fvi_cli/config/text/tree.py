"""YAML text to plain values, with the place of every value and of every key.

Words are read by the core schema of YAML 1.2: ``1e-3`` is a number, ``no`` and ``on`` are text,
``0o17`` is 15 and ``017`` is 17. There are limits on sizes, because the text may be hostile.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any, Final

import yaml

from fvi_cli.errors import printable
from fvi_cli.scenes.keys.mistakes import KeyPath

LARGEST_TEXT: Final = 1_000_000  # characters
DEEPEST_NESTING: Final = 50
MOST_VALUES: Final = 50_000  # with those that aliases repeat
LONGEST_NUMBER: Final = 400  # digits; longer ones count as infinite
TOO_DEEP: Final = f"nested more than {DEEPEST_NESTING} deep"

_PLAIN: Final = [f"tag:yaml.org,2002:{word}" for word in ("str", "seq", "map")]
"""Tags of values without a tag of their own."""

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

    def place(self, path: KeyPath, *, of_key: bool = False, column: int | None = None) -> Place:
        """The place of a value, or of its key; where it is missing, of what should hold it.

        `column` counts from 1 in a text that stands there.
        """
        if of_key and path in self.key_places:
            return self.key_places[path]
        if column and path in self.places and path not in self.quoted:
            place = self.places[path]
            return Place(place.source, place.line, place.column + column - 1)
        while path and path not in self.places:
            path = path[:-1]
        return self.places.get(path, Place(self.source))

    def forget(self, path: KeyPath) -> None:
        """Forget the places at a path and below."""
        for known in (self.places, self.key_places):
            for inside in [one for one in known if one[: len(path)] == path]:
                del known[inside]


def inside(value: Any, part: str | int) -> Any:
    """The value under a key or number; None where there is none."""
    if isinstance(value, dict):
        return value.get(part)
    is_there = isinstance(value, list) and isinstance(part, int) and part < len(value)
    return value[part] if is_there else None


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

    Anchors and aliases are understood; tags, repeated keys, and keys that are not words are
    mistakes.

    Raises
    ------
    MistakesError
        If the text is not YAML or too large, with all repeated keys and tags.
    """
    if len(text) > LARGEST_TEXT:
        message = f"more than {LARGEST_TEXT} characters: too large"
        raise MistakesError(Mistake(Place(source, 1, 1), (), message))
    reader, node = _Reader(source), _composed(text, source)
    if node is not None:
        reader.found.value = reader.value(node, ())
    if reader.found.value is None:
        message = "the configuration is empty; `fvi new` writes one"
        reader.mistakes.append(Mistake(Place(source, 1, 1), (), message))
    if reader.mistakes:
        raise MistakesError(*reader.mistakes)
    return reader.found


def _composed(text: str, source: str) -> yaml.Node | None:
    """The node of a document."""
    # the parser in C is far faster, where it is there
    loader: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    place, depth = Place(source, 1, 1), 0
    try:
        for event in yaml.parse(text, loader):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST_NESTING:
                raise MistakesError(Mistake(_place(event, source), (), TOO_DEEP))
        return yaml.compose(text, loader)
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        place = Place(source, before.count("\n") + 1, error.position - before.rfind("\n"))
        message = "a character that YAML does not allow"
    except yaml.MarkedYAMLError as error:
        if mark := error.problem_mark or error.context_mark:
            place = Place(source, mark.line + 1, mark.column + 1)
        message = f"not YAML: {error.problem}; is the indentation right, does a text need quotes?"
    except (ValueError, OverflowError, IndexError, yaml.YAMLError):
        message = "not YAML: a wrong escape"
    raise MistakesError(Mistake(place, (), message))


def _place(node: Any, source: str) -> Place:
    return Place(source, node.start_mark.line + 1, node.start_mark.column + 1)


class _Reader:
    """Builds the values from nodes, which aliases may repeat."""

    def __init__(self, source: str) -> None:
        self.found, self.mistakes, self.size = Document(source), list[Mistake](), 0

    def value(self, node: Any, path: KeyPath) -> Any:
        """The value of a node."""
        self.found.places[path] = _place(node, self.found.source)
        self.size += 1
        if self.size > MOST_VALUES:
            self.give_up(node, path, f"more than {MOST_VALUES} values, with repeated ones")
        if len(path) > DEEPEST_NESTING:
            self.give_up(node, (), TOO_DEEP)
        if node.tag not in _PLAIN:
            self.add(node, path, f"the tag {node.tag!r} is not allowed; write the plain value")
        if isinstance(node, yaml.SequenceNode):
            return [self.value(one, (*path, n)) for n, one in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode):
            return self.mapping(node, path)
        is_plain = not node.style
        if not is_plain or node.start_mark.line != node.end_mark.line:
            self.found.quoted.add(path)
        return read_scalar(node.value) if is_plain else node.value

    def mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key_node, inner in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self.give_up(key_node, path, "a key must be a word")
            key = (*path, key_node.value)
            if key_node.value in values:
                line = self.found.key_places[key].line
                self.add(key_node, key, f"given twice, first in line {line}")
            self.found.key_places.setdefault(key, _place(key_node, self.found.source))
            values[key_node.value] = self.value(inner, key)
        return values

    def add(self, node: Any, path: KeyPath, message: str) -> None:
        self.mistakes.append(Mistake(_place(node, self.found.source), path, message))

    def give_up(self, node: Any, path: KeyPath, message: str) -> None:
        self.add(node, path, message)
        raise MistakesError(*self.mistakes)
