"""What a report consists of, whatever it is written in: headings, paragraphs, lists, grids."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Code:
    """Words that are to be read letter by letter: names of files and cases, equations."""

    text: str


Words = str | tuple[str | Code, ...]
"""Running text; every piece is literal, nothing in it is markup."""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """A title; level 1 is that of the whole report."""

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
    """A table of words.

    Parameters
    ----------
    header
        One entry per column.
    rows
        Each as long as the header.
    summary_rows
        Rows below a line: what follows from those above.
    text_columns
        Number of columns at the left that hold words; the others hold numbers.

    Raises
    ------
    ValueError
        If a row is longer or shorter than the header.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    summary_rows: tuple[tuple[str, ...], ...] = ()
    text_columns: int = 1

    def __post_init__(self) -> None:
        for row in (*self.rows, *self.summary_rows):
            if len(row) != len(self.header):
                raise ValueError(f"rows: {len(row)} entries in {row}; {len(self.header)} columns")


Block = Heading | Paragraph | Bullets | Grid


def pieces(words: Words) -> tuple[str | Code, ...]:
    """The pieces of running text."""
    return (words,) if isinstance(words, str) else words


def plain(words: Words) -> str:
    """The text without the distinction of :class:`Code`."""
    return "".join(piece.text if isinstance(piece, Code) else piece for piece in pieces(words))


def column_texts(grid: Grid) -> Iterator[Sequence[str]]:
    """Header and all rows, as they stand."""
    yield grid.header
    yield from grid.rows
    yield from grid.summary_rows
