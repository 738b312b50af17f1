"""Mistakes with their places, collected so that all of them are reported at once."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

from fvi_cli.errors import ConfigError

KeyPath = tuple[str | int, ...]
LONGEST_EXCERPT = 60
MOST_COMPLAINTS = 100


@dataclass(frozen=True, kw_only=True, order=True)
class SourcePosition:
    """A position in a source; lines and columns count from 1, line 0 means that there is none."""

    source: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}" if self.line else self.source

    def shifted(self, columns: int) -> SourcePosition:
        """The position `columns` columns further right."""
        if not self.line:
            return self
        return SourcePosition(source=self.source, line=self.line, column=self.column + columns)


ChecksMember = Callable[[int], bool]


def every_member(number: int) -> bool:
    """Check all members of a sweep."""
    return True


def no_member(number: int) -> bool:
    """Check no member of a sweep, since all were checked before."""
    return False


@dataclass(kw_only=True)
class Complaints:
    """Collects complaints about one text; equal complaints are kept once."""

    # folder of relative paths in the text; None: the folder of the process
    folder: Path | None = None
    # says by its number whether a member of a sweep is checked; other members are checked by
    # another command, or were by an earlier one
    checks_member: ChecksMember = every_member
    # contents of files that the text names: each file is read once
    files: dict[Hashable, Any] = field(default_factory=dict)
    _found: dict[tuple[SourcePosition, str], None] = field(default_factory=dict)

    def add(self, place: SourcePosition, path: KeyPath, message: str) -> None:
        """Add a complaint about the key at `path`: what is wrong and what is allowed."""
        where = show_path(path)
        # quotations from the text may contain control codes
        text = printable(f"{where}: {message}" if where else message)
        self._found[place, text] = None

    def __len__(self) -> int:
        return len(self._found)

    def separate(self) -> Complaints:
        """A new collection of complaints about the same text, still empty."""
        return replace(self, _found={})

    def adopt(self, others: Complaints, addition: str = "") -> None:
        """Add the complaints of `others`, each followed by `addition`."""
        for place, message in others._found:
            self._found[place, f"{message}{addition}"] = None

    def raise_if_any(self) -> None:
        """Raise the error with all complaints, if there are any."""
        if self._found:
            raise self.error()

    def error(self) -> ConfigError:
        """An error with all complaints in the order of the text."""
        lines = [f"{place}: {message}" for place, message in sorted(self._found, key=itemgetter(0))]
        if len(lines) > MOST_COMPLAINTS:
            left = len(lines) - MOST_COMPLAINTS
            lines = [*lines[:MOST_COMPLAINTS], f"... and {left} more"]
        return ConfigError(*lines)


def show_path(path: KeyPath) -> str:
    """A path of keys as it is written for ``--set``."""
    return ".".join(excerpt(str(key)) if not str(key).isidentifier() else str(key) for key in path)


def excerpt(text: str, longest: int = LONGEST_EXCERPT) -> str:
    """`text` in one line of printable characters, shortened."""
    if len(text) > longest:
        text = text[: longest - 3] + "..."
    return printable(text)


def printable(text: str) -> str:
    """`text` with escapes in place of unprintable characters."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


ABBREVIATED = {
    "rl": "riemann-liouville",
    "inf": "max",
    "linf": "max",
    "infinity": "max",
    "maximum": "max",
}
"""From words of the literature to words of the keys."""


def suggestion(word: str, known: Iterable[str]) -> str:
    """``; did you mean 'x'?`` for the nearest known word, or an empty text."""
    names = list(known)
    by_case = {name.lower(): name for name in names}
    short = word.lower()[:LONGEST_EXCERPT]
    short = ABBREVIATED.get(short, short)
    nearest = difflib.get_close_matches(short, by_case, n=1)
    if not nearest and len(short) > 3:
        # such as explicit-euler for euler
        nearest = [name for name in by_case if short in name][:1]
    return f"; did you mean {by_case[nearest[0]]!r}?" if nearest else ""


def not_known(name: str, known: Iterable[str]) -> str:
    """The complaint about an unknown key."""
    names = list(known)
    return f"not known{suggestion(name, names)} (known here: {listed(names)})"


def listed(words: Iterable[str]) -> str:
    """Words separated by commas."""
    return ", ".join(words)
