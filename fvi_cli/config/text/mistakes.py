"""Mistakes of a configuration, at their places."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from fvi_cli.config.text.tree import Document, Mistake, inside
from fvi_cli.errors import ConfigError
from fvi_cli.scenes.keys.mistakes import KeyPath, Wrong


@dataclass
class Report:
    """Collects the mistakes below a key path of a document."""

    document: Document
    prefix: KeyPath = ()
    found: list[Mistake] = field(default_factory=list)

    def under(self, *path: str | int) -> Report:
        """The same report for mistakes below another path."""
        return Report(self.document, (*self.prefix, *path), self.found)

    def value(self, *path: str | int) -> Any:
        """What stands at a key path; None where there is nothing."""
        found = self.document.value
        for part in (*self.prefix, *path):
            found = inside(found, part)
        return found

    def add(self, message: str, *path: str | int, of_key: bool = False) -> None:
        """A mistake at a key path."""
        self.extend([Wrong(path, message, of_key=of_key)])

    def extend(self, wrong: Iterable[Wrong], addition: str = "") -> None:
        """Mistakes, each followed by an addition."""
        for one in wrong:
            self.found.append(self.placed(one._replace(message=one.message + addition)))

    def placed(self, wrong: Wrong) -> Mistake:
        """A mistake with its place in the document."""
        path = (*self.prefix, *wrong.path)
        place = self.document.place(path, of_key=wrong.of_key, column=wrong.column)
        return Mistake(place, path, wrong.message)

    def __len__(self) -> int:
        return len(self.found)

    def error(self) -> ConfigError:
        """An error with all mistakes, in the order of the text."""
        return ConfigError(*dict.fromkeys(map(str, sorted(self.found, key=lambda one: one.place))))
