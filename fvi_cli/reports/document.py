"""The blocks of a report, independent of its format: headings, paragraphs, lists, grids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class CodeSpan:
    """Words in the type of code: names of files, equations."""

    text: str


Piece = str | CodeSpan
Words = str | tuple[Piece, ...]
"""Running text; every piece is literal, without markup."""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """A title; the title of the whole report has level 1."""

    level: int
    words: Words


@dataclass(frozen=True, kw_only=True)
class Paragraph:
    """Running text."""

    words: Words


@dataclass(frozen=True, kw_only=True)
class Bullets:
    """A list of sentences."""

    items: tuple[Words, ...]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table of words."""

    header: tuple[str, ...]  # one entry per column
    rows: tuple[tuple[str, ...], ...]  # each as long as the header
    # rows below a line, which summarise those above
    summary_rows: tuple[tuple[str, ...], ...] = ()
    text_columns: int = 1  # number of columns at the left that hold words; the others hold numbers

    def __post_init__(self) -> None:
        for row in (*self.rows, *self.summary_rows):
            if len(row) != len(self.header):
                raise ValueError(f"rows: {len(row)} entries in {row}; {len(self.header)} columns")

    @property
    def lines(self) -> tuple[tuple[str, ...], ...]:
        """Header and all rows."""
        return (self.header, *self.rows, *self.summary_rows)

    @property
    def widths(self) -> list[int]:
        """Number of letters in the widest entry of every column."""
        return [max(len(line[k]) for line in self.lines) for k in range(len(self.header))]

    def justified(self, line: Sequence[str], widths: Sequence[int]) -> list[str]:
        """The entries of a line, padded to their columns; words left, numbers right."""
        return [
            cell.ljust(width) if k < self.text_columns else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ]


Block = Heading | Paragraph | Bullets | Grid


def pieces(words: Words) -> tuple[Piece, ...]:
    """The pieces of running text."""
    return (words,) if isinstance(words, str) else words


def plain_text(words: Words) -> str:
    """The text of all pieces, without markup."""
    return "".join(piece if isinstance(piece, str) else piece.text for piece in pieces(words))
