"""Reports as text for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.reports.document import (
    Block,
    Bullets,
    Grid,
    Heading,
    Paragraph,
    plain,
    split_wide,
)

WIDEST = 120
"""Letters in a line of a table."""


def to_text(blocks: Sequence[Block]) -> str:
    """The blocks as plain text, without a newline at the end."""
    return "\n\n".join(_block(block) for block in blocks)


def _block(block: Block) -> str:
    if isinstance(block, Heading | Paragraph):
        return plain(block.words)
    if isinstance(block, Bullets):
        return "\n".join(f"- {plain(item)}" for item in block.items)
    return "\n\n".join(_grid(part) for part in split_wide(block, WIDEST))


def _grid(grid: Grid) -> str:
    widths = grid.widths()
    lines = []
    for row in grid.lines:
        cells = [
            cell.ljust(width) if k < grid.text_columns else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)
