"""Changes of a configuration by ``--set key.path=value``."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, Final

from fvi_cli.config.text.tree import (
    DEEPEST_NESTING,
    Document,
    Mistake,
    MistakesError,
    Place,
    inside,
    read_document,
)
from fvi_cli.errors import excerpt
from fvi_cli.scenes.keys.mistakes import KeyPath
from fvi_cli.studies.members import replaced

OPTION: Final = Place("--set")
_DISPLACED: Final[Mapping[KeyPath, tuple[str, ...]]] = {
    ("accuracy",): ("ladder",),
    ("ladder",): ("accuracy",),
    ("ladder", "steps"): ("from", "to", "base"),
}
"""By key of an experiment the keys next to it that exclude it; an override removes these."""


def apply_overrides(document: Document, overrides: Sequence[str]) -> list[Mistake]:
    """Apply ``key.path=value`` in their order; returns what is wrong with them.

    The path consists of keys and list indices from 0, joined by dots. The value is YAML; null
    removes the key. Mappings that the path needs and the file lacks are made.
    """
    mistakes: list[Mistake] = []
    for override in overrides:
        written, equals, text = override.partition("=")
        parts = [part.strip() for part in written.split(".")]
        if not equals or not all(parts) or len(parts) > DEEPEST_NESTING:
            message = f"{excerpt(override)!r} is not allowed; it must be key.path=value"
            mistakes.append(Mistake(OPTION, (), message))
            continue
        path = key_path(parts, document.value)
        try:
            _apply(document, path, text)
        except LookupError as error:
            mistakes.append(Mistake(OPTION, path, str(error)))
        except MistakesError as error:
            mistakes += [Mistake(OPTION, path, one.message) for one in error.mistakes]
    return mistakes


def _apply(document: Document, path: KeyPath, text: str) -> None:
    is_null = text.strip() in ("null", "~")
    new = None if is_null else read_document(text, OPTION.source).value
    base = path[:2] if path[0] == "experiments" else ()
    if is_null and functools.reduce(inside, path, document.value) is None:
        if path[len(base) :] in _DISPLACED:
            return
        raise LookupError("there is no such key")
    for depth in range(len(base) + 1, len(path) + 1):
        for name in () if is_null else _DISPLACED.get(path[len(base) : depth], ()):
            other = (*path[: depth - 1], name)
            document.value = replaced(document.value, other, None)
    document.value = replaced(document.value, path, new)
    document.forget(path)
    for depth in range(1, len(path) + 1):
        # also of mappings that were made
        document.places.setdefault(path[:depth], OPTION)
        document.key_places.setdefault(path[:depth], OPTION)


def key_path(parts: Sequence[str], values: Any) -> KeyPath:
    """The key path of some values that texts between dots mean.

    Keys may hold dots themselves: what is there is found, and what is new below ``sweep``,
    ``designs`` and in a fit begins with ``problem``.
    """
    path: list[str | int] = []
    left = list(parts)
    while left:
        first, length = left[0], 1
        if isinstance(values, dict):
            joined = (n for n in range(len(left), 0, -1) if ".".join(left[:n]) in values)
            length = next(joined, 0) or _new_length(path, left)
            part: str | int = ".".join(left[:length])
        else:
            is_new = values is None or not first.isdecimal()
            length = _new_length(path, left) if is_new else 1
            part = ".".join(left[:length]) if is_new else int(first)
        path.append(part)
        values, left = inside(values, part), left[length:]
    return tuple(path)


def _new_length(path: Sequence[str | int], left: Sequence[str]) -> int:
    """How many parts are the next key, which is not there yet."""
    is_swept = left[0] == "problem" and len(path) > (2 if path[:1] == ["experiments"] else 0)
    return len(left) if is_swept else 1
