"""The blocks of a report, independent of its format: headings, paragraphs, lists, grids."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class CodeSpan:
    """Words in the type of code: names of files and cases."""

    text: str


@dataclass(frozen=True)
class Equation:
    """A formula in plain text, ``M x'' + sum mu D^gamma x = 0``; typeset in LaTeX."""

    text: str


@dataclass(frozen=True)
class Rough:
    """Words with numbers that depend on round-off, and so differ between machines."""

    text: str


@dataclass(frozen=True)
class Near:
    """Words with numbers that no file has in full digits: the last digit may differ elsewhere."""

    text: str


class RoughEntry(str):
    """An entry of a grid with numbers that depend on round-off, as in :class:`Rough`."""

    __slots__ = ()


Piece = str | CodeSpan | Equation | Rough | Near
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
    # number of columns at the left that identify a row: they are repeated when the grid is split
    key_columns: int = 1
    # sizes of the groups of the other columns that must not be split; empty: every column is one
    groups: tuple[int, ...] = ()
    is_near: bool = False  # whether no file has its numbers in full digits, as in :class:`Near`
    # end of the name of its LaTeX file; empty for the main table of a report
    name: str = ""

    def __post_init__(self) -> None:
        for row in (*self.rows, *self.summary_rows):
            if len(row) != len(self.header):
                raise ValueError(f"rows: {len(row)} entries in {row}; {len(self.header)} columns")
        if self.groups and self.key_columns + sum(self.groups) != len(self.header):
            raise ValueError(
                f"groups: {self.groups} beside {self.key_columns}; {len(self.header)} columns"
            )

    @property
    def lines(self) -> tuple[tuple[str, ...], ...]:
        """Header and all rows."""
        return (self.header, *self.rows, *self.summary_rows)

    def widths(self, letters: Callable[[str], int] = len) -> list[int]:
        """Number of letters in the widest entry of every column."""
        return [max(letters(line[k]) for line in self.lines) for k in range(len(self.header))]

    def justified(self, line: Sequence[str], widths: Sequence[int]) -> list[str]:
        """The entries of a line, padded to their columns; words left, numbers right."""
        return [
            cell.ljust(width) if k < self.text_columns else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ]

    def select(self, columns: Sequence[int]) -> Grid:
        """The grid of the key columns and of the given columns."""
        chosen = [*range(self.key_columns), *columns]

        def cut(line: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(line[k] for k in chosen)

        return Grid(
            header=cut(self.header),
            rows=tuple(cut(row) for row in self.rows),
            summary_rows=tuple(cut(row) for row in self.summary_rows),
            text_columns=min(self.text_columns, len(chosen)),
            key_columns=self.key_columns,
            is_near=self.is_near,
            name=self.name,
        )


COLUMN_GAP = 3
"""Width of the gap between two columns, in letters."""


def split_wide(
    grid: Grid,
    widest: int,
    widest_text: int | None = None,
    letters: Callable[[str], int] = len,
) -> list[Grid]:
    """Grids of at most `widest` letters in a line, as few as possible and of similar width.

    A group that is wider by itself stays whole. The width of text columns counts as `widest_text`
    at most, at which they are wrapped; `letters` returns the width of an entry in letters.
    """
    widths = [
        COLUMN_GAP + (min(width, widest_text or width) if k < grid.text_columns else width)
        for k, width in enumerate(grid.widths(letters))
    ]
    room = widest - sum(widths[: grid.key_columns])
    groups: list[list[int]] = []
    start = grid.key_columns
    for size in grid.groups or (1,) * (len(grid.header) - grid.key_columns):
        groups.append(list(range(start, start + size)))
        start += size
    sizes = [sum(widths[k] for k in group) for group in groups]
    parts = _pack(sizes, room)
    for narrower in range(max(sizes, default=0), room):
        balanced = _pack(sizes, narrower)
        if len(balanced) == len(parts):
            parts = balanced
            break
    if len(parts) <= 1:
        return [grid]
    return [grid.select([k for index in part for k in groups[index]]) for part in parts]


def _pack(sizes: Sequence[int], room: int) -> list[list[int]]:
    """Indices of `sizes` in order, divided into the fewest parts that fit into `room`."""
    parts: list[list[int]] = []
    filled = room
    for index, size in enumerate(sizes):
        if not parts or filled + size > room:
            parts.append([])
            filled = 0
        parts[-1].append(index)
        filled += size
    return parts


Block = Heading | Paragraph | Bullets | Grid


def pieces(words: Words) -> tuple[Piece, ...]:
    """The pieces of running text."""
    return (words,) if isinstance(words, str) else words


def plain_text(words: Words) -> str:
    """The text of all pieces, without markup."""
    return "".join(piece if isinstance(piece, str) else piece.text for piece in pieces(words))


NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def without_numbers(text: str, instead: str = "#") -> str:
    """The text with `instead` for every number; equal results differ in numbers only."""
    return NUMBER.sub(instead, text)


def _marked(text: str, mark: str) -> str:
    """The text with a mark for every letter of its numbers, so that its length stays."""
    return NUMBER.sub(lambda number: mark * len(number[0]), text)


def blank(blocks: Sequence[Block], rough: str, near: str) -> list[Block]:
    """The blocks with the marks `rough` and `near` for letters of rough and of near numbers."""

    def in_words(words: Words) -> Words:
        return tuple(
            _marked(piece.text, rough if isinstance(piece, Rough) else near)
            if isinstance(piece, Rough | Near)
            else piece
            for piece in pieces(words)
        )

    def in_cells(line: tuple[str, ...], first: int = 0) -> tuple[str, ...]:
        return (*line[:first], *(_marked(cell, near) for cell in line[first:]))

    def rough_cells(line: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(_marked(c, rough) if isinstance(c, RoughEntry) else c for c in line)

    found: list[Block] = []
    for block in blocks:
        if isinstance(block, Paragraph | Heading):
            found.append(replace(block, words=in_words(block.words)))
        elif isinstance(block, Bullets):
            found.append(Bullets(items=tuple(map(in_words, block.items))))
        elif block.is_near:
            found.append(replace(block, rows=tuple(in_cells(line, 1) for line in block.rows)))
        else:
            found.append(replace(block, rows=tuple(map(rough_cells, block.rows))))
    return found
