"""Reports as plain text, and as Markdown of GitHub."""

from __future__ import annotations

import re
from collections.abc import Sequence

from fvi_cli.reports.document import (
    Block,
    Bullets,
    CodeSpan,
    Grid,
    Heading,
    Paragraph,
    Words,
    pieces,
    plain_text,
)


def to_text(blocks: Sequence[Block]) -> str:
    """The blocks as plain text, without a newline at the end."""
    return "\n\n".join(_plain(block) for block in blocks)


def _plain(block: Block) -> str:
    if isinstance(block, Heading | Paragraph):
        return plain_text(block.words)
    if isinstance(block, Bullets):
        return "\n".join(f"- {plain_text(item)}" for item in block.items)
    return aligned(block)


def aligned(grid: Grid) -> str:
    """The lines of a grid, without a newline at the end."""
    return "\n".join("  ".join(grid.justified(row, grid.widths)).rstrip() for row in grid.lines)


_ACTIVE = re.compile(r"([\\`*_\[\]<>|~#$&])")


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
    return _grid(block)


def _inline(words: Words) -> str:
    return "".join(
        _code(piece.text) if isinstance(piece, CodeSpan) else escape_markdown(piece)
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
