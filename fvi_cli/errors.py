"""Errors that carry what a person needs to mend them, as fields.

Wrong arguments raise :class:`ValueError`; the others are raised for requests and files.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class ArgumentError(ValueError):
    """An argument, or a value of a configuration, that is not allowed.

    Parameters
    ----------
    key
        Its key path, such as ``damping.0.order``; empty: all that was given.
    message
        What is wrong with it.
    at_key
        The key itself should not be there: complaints point at the key and not at its value.
    """

    def __init__(self, key: str, message: str, *, at_key: bool = False) -> None:
        super().__init__(key, message)
        self.key = key
        self.message = message
        self.at_key = at_key

    @property
    def path(self) -> tuple[str, ...]:
        """The parts of the key path."""
        return tuple(self.key.split(".")) if self.key else ()

    def below(self, key: str) -> ArgumentError:
        """The same error with its key path below `key`, the argument that contains this one."""
        return ArgumentError(".".join((key, *self.path)), self.message, at_key=self.at_key)

    def __str__(self) -> str:
        return f"{self.key}: {self.message}" if self.key else self.message


class FviError(Exception):
    """Base of every error that the command line shows without a traceback."""


class RequestError(FviError):
    """A request or configuration that cannot be carried out (exit code 2).

    Parameters
    ----------
    complaints
        One line per mistake, all of them at once.
    """

    def __init__(self, *complaints: str) -> None:
        self.complaints = complaints
        super().__init__("\n".join(complaints))


class ConfigError(RequestError):
    """Mistakes in a configuration, each as ``file:line:column: key.path: message``."""


class StorageError(FviError):
    """A result file that cannot be read or written (exit code 2)."""


LONGEST_EXCERPT = 60


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


def suggestion(word: str, known: Iterable[str]) -> str:
    """``; did you mean 'x'?`` for the nearest known word, or an empty text."""
    by_case = {name.lower(): name for name in known}
    found = difflib.get_close_matches(word.lower()[:LONGEST_EXCERPT], by_case, n=1)
    return f"; did you mean {by_case[found[0]]!r}?" if found else ""


def listed(words: Iterable[str]) -> str:
    """Words separated by commas."""
    return ", ".join(words)
