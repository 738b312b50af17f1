"""What a report consists of, whatever it is written in: headings, paragraphs, lists, grids."""

from __future__ import annotations

from collections.abc import Sequence
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
    key_columns
        Number of columns at the left that are needed to read the others: they are repeated when
        the grid is split.
    groups
        Sizes of the groups of the other columns that belong together; empty: every column by
        itself.

    Raises
    ------
    ValueError
        If a row is longer or shorter than the header, or the groups do not fill the header.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    summary_rows: tuple[tuple[str, ...], ...] = ()
    text_columns: int = 1
    key_columns: int = 1
    groups: tuple[int, ...] = ()

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

    def widths(self) -> list[int]:
        """Letters in the widest entry of every column."""
        return [max(len(line[k]) for line in self.lines) for k in range(len(self.header))]

    def select(self, columns: Sequence[int]) -> Grid:
        """The grid of the key columns and these groups' columns."""
        chosen = [*range(self.key_columns), *columns]

        def cut(line: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(line[k] for k in chosen)

        return Grid(
            header=cut(self.header),
            rows=tuple(cut(row) for row in self.rows),
            summary_rows=tuple(cut(row) for row in self.summary_rows),
            text_columns=min(self.text_columns, len(chosen)),
            key_columns=self.key_columns,
        )


COLUMN_GAP = 3
"""Letters between two columns."""


def split_wide(grid: Grid, widest: int) -> list[Grid]:
    """Grids of at most `widest` letters in a line, as few as possible and of similar width.

    A group that is wider by itself stays whole.
    """
    widths = [width + COLUMN_GAP for width in grid.widths()]
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
    """Indices of `sizes` in order, in as few parts as fit into `room`."""
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


def pieces(words: Words) -> tuple[str | Code, ...]:
    """The pieces of running text."""
    return (words,) if isinstance(words, str) else words


def plain(words: Words) -> str:
    """The text without the distinction of :class:`Code`."""
    return "".join(piece.text if isinstance(piece, Code) else piece for piece in pieces(words))
