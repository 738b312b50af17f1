"""The blocks of a report, independent of its format: headings, paragraphs, lists, grids.

Running text is literal, but for words between backticks, which Markdown sets as code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Heading:
    """A title; the title of the whole report has level 1."""

    level: int
    words: str


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    words: str


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    items: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table of words."""

    header: tuple[str, ...]  # one entry per column
    rows: tuple[tuple[str, ...], ...]  # each as long as the header
    foot: tuple[tuple[str, ...], ...] = ()  # rows below a line
    text_columns: int = 1  # number of columns at the left that hold words; the others hold numbers

    @property
    def lines(self) -> tuple[tuple[str, ...], ...]:
        """Header and all rows."""
        return (self.header, *self.rows, *self.foot)

    def aligned(self, lines: Sequence[Sequence[str]], least: int = 0) -> list[list[str]]:
        """The entries of lines, padded to their columns; words left, numbers right."""
        widths = [max(least, *map(len, column)) for column in zip(*lines, strict=True)]
        return [
            [
                cell.ljust(width) if k < self.text_columns else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ]
            for line in lines
        ]


Block = Heading | Paragraph | Bullets | Grid
