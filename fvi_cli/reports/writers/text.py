"""Reports as text, plain for files and pipes, ruled on a terminal, and as Markdown of GitHub."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, TextIO

from fvi_cli.reports.document import (
    Block,
    Bullets,
    CodeSpan,
    Equation,
    Grid,
    Heading,
    Paragraph,
    Words,
    pieces,
    plain_text,
    split_wide,
)

if TYPE_CHECKING:
    from rich.console import RenderableType


WIDEST = 120
"""Width of a line of a table, in letters, where there is no terminal."""

WIDEST_TEXT = 40
"""On a terminal texts in a table are wrapped, but not to fewer letters than this."""


def to_text(blocks: Sequence[Block]) -> str:
    """The blocks as plain text, without a newline at the end."""
    return "\n\n".join(_plain(block) for block in blocks)


def _plain(block: Block) -> str:
    if isinstance(block, Heading | Paragraph):
        return plain_text(block.words)
    if isinstance(block, Bullets):
        return "\n".join(f"- {plain_text(item)}" for item in block.items)
    return "\n\n".join(aligned(part) for part in split_wide(block, WIDEST))


def aligned(grid: Grid) -> str:
    """The lines of a grid of any width, without a newline at the end."""
    widths = grid.widths()
    return "\n".join("  ".join(grid.justified(row, widths)).rstrip() for row in grid.lines)


def show(blocks: Sequence[Block], stream: TextIO | None = None) -> None:
    """Print the blocks: on a terminal within its width, elsewhere as :func:`to_text`."""
    stream = stream or sys.stdout
    if not stream.isatty():
        print(to_text(blocks), file=stream)
        return
    from rich.console import Console

    console = Console(file=stream, highlight=False)
    for number, block in enumerate(blocks):
        if number:
            console.print()
        for part in _rich(block, console.width):
            console.print(part)


def _rich(block: Block, width: int) -> list[RenderableType]:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    if isinstance(block, Heading):
        return [Text(plain_text(block.words), style="bold")]
    if isinstance(block, Paragraph):
        return [Text(plain_text(block.words))]
    if isinstance(block, Bullets):
        bullets = Table.grid(padding=(0, 1))
        for item in block.items:
            bullets.add_row("-", Text(plain_text(item)))
        return [bullets]
    found: list[RenderableType] = []
    for part in split_wide(block, width, WIDEST_TEXT):
        table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False)
        for k, title in enumerate(part.header):
            is_text = k < part.text_columns
            table.add_column(
                Text(title), justify="left" if is_text else "right", no_wrap=not is_text
            )
        for row in part.rows:
            table.add_row(*map(Text, row))
        if part.summary_rows:
            table.add_section()
            for row in part.summary_rows:
                table.add_row(*map(Text, row))
        found.append(table)
    return found


_ACTIVE = re.compile(r"([\\`*_\[\]<>|~#$&])")


WIDEST_MARKDOWN = 160
"""Most letters in a line of a table, which fit into a browser window."""


def to_markdown(blocks: Sequence[Block]) -> str:
    """The blocks as Markdown, a blank line between them and a newline at the end."""
    return "\n\n".join(_block(block) for block in blocks) + "\n"


def _block(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {_inline(block.words)}"
    if isinstance(block, Paragraph):
        return _inline(block.words)
    if isinstance(block, Bullets):
        return "\n".join(f"- {_inline(item)}" for item in block.items)
    return "\n\n".join(_grid(part) for part in split_wide(block, WIDEST_MARKDOWN))


def _inline(words: Words) -> str:
    return "".join(
        _code(piece.text)
        if isinstance(piece, CodeSpan | Equation)
        else escape_markdown(plain_text((piece,)))
        for piece in pieces(words)
    )


def escape_markdown(text: str) -> str:
    """Text with markup characters escaped."""
    return _ACTIVE.sub(r"\\\1", " ".join(text.splitlines()))


def _code(text: str) -> str:
    longest = max(map(len, re.findall(r"`+", text)), default=0)
    fence = "`" * (longest + 1)
    padding = " " if longest else ""
    return f"{fence}{padding}{text}{padding}{fence}"


def _grid(grid: Grid) -> str:
    rows = [[escape_markdown(cell) for cell in row] for row in grid.lines]
    widths = [max(3, *(len(row[k]) for row in rows)) for k in range(len(grid.header))]
    rule = [
        "-" * width if k < grid.text_columns else "-" * (width - 1) + ":"
        for k, width in enumerate(widths)
    ]
    lines = (grid.justified(row, widths) for row in (rows[0], rule, *rows[1:]))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
