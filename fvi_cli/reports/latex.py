"""Reports as LaTeX that needs the class ``article`` and no package."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from fvi_cli.reports.document import (
    Block,
    Bullets,
    Code,
    Grid,
    Heading,
    Paragraph,
    Words,
    pieces,
    split_wide,
)

_PREAMBLE = r"""\documentclass{article}
\setlength{\oddsidemargin}{0in}
\setlength{\textwidth}{6.5in}
\setlength{\topmargin}{-0.5in}
\setlength{\textheight}{9in}
\setlength{\parindent}{0pt}
\setlength{\parskip}{6pt}
\setlength{\tabcolsep}{4pt}
\raggedright
\begin{document}"""

WIDEST = 118
"""Letters in a line of a table that fit into the width of the text in footnote size."""

_SECTIONS = ("section*", "subsection*", "subsubsection*")

_ESCAPES: Mapping[str, str] = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"$<$",
    ">": r"$>$",
    "|": r"$|$",
    "`": r"{\char96}",
}

# what every LaTeX sets without a package: printable ASCII and the letters of Latin-1
_LETTER = re.compile(r"[\x20-\x7e\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u00ff]")

_NUMBER = re.compile(
    r"(?<![\w.^])(?P<mantissa>-?\d+(?:\.\d+)?)(?:e(?P<exponent>[+-]?\d+))?(?![\w.])"
)


def to_latex(blocks: Sequence[Block]) -> str:
    """The blocks as one document; every ``tabular`` in it can be taken out by itself."""
    return "\n\n".join([_PREAMBLE, *(_block(block) for block in blocks), r"\end{document}"]) + "\n"


def _block(block: Block) -> str:
    if isinstance(block, Heading):
        section = _SECTIONS[min(block.level, len(_SECTIONS)) - 1]
        return f"\\{section}{{{_inline(block.words)}}}"
    if isinstance(block, Paragraph):
        return _inline(block.words)
    if isinstance(block, Bullets):
        items = "\n".join(f"\\item {{}}{_inline(item)}" for item in block.items)
        return f"\\begin{{itemize}}\n{items}\n\\end{{itemize}}"
    return "\n\n".join(_grid(part) for part in split_wide(block, WIDEST))


def _inline(words: Words) -> str:
    return "".join(
        rf"\texttt{{{escape_latex(piece.text)}}}"
        if isinstance(piece, Code)
        else escape_latex(piece)
        for piece in pieces(words)
    )


def escape_latex(text: str) -> str:
    """Text in which nothing is taken for a command; letters beyond Latin-1 by their number."""
    letters = []
    for letter in " ".join(text.splitlines()):
        if not _LETTER.fullmatch(letter):
            letters.append(f"U+{ord(letter):04X}")
        else:
            letters.append(_ESCAPES.get(letter, letter))
    return "".join(letters)


def _cell(text: str) -> str:
    """A cell with its numbers in mathematical type."""
    parts = []
    end = 0
    for match in _NUMBER.finditer(text):
        parts.append(escape_latex(text[end : match.start()]))
        parts.append(_number(match))
        end = match.end()
    parts.append(escape_latex(text[end:]))
    return "".join(parts)


def _number(match: re.Match[str]) -> str:
    if match["exponent"] is None:
        return f"${match['mantissa']}$"
    return rf"${match['mantissa']}\cdot10^{{{int(match['exponent'])}}}$"


def _grid(grid: Grid) -> str:
    columns = "l" * grid.text_columns + "r" * (len(grid.header) - grid.text_columns)
    lines = [rf"\begin{{tabular}}{{{columns}}}", r"\hline"]
    lines.append(_row([escape_latex(cell) for cell in grid.header]))
    lines.append(r"\hline")
    lines += [_cells(row, grid.text_columns) for row in grid.rows]
    if grid.summary_rows:
        lines.append(r"\hline")
        lines += [_cells(row, grid.text_columns) for row in grid.summary_rows]
    lines += [r"\hline", r"\end{tabular}"]
    return "{\\footnotesize\n" + "\n".join(lines) + "\n\n}"


def _cells(row: Sequence[str], text_columns: int) -> str:
    words = [escape_latex(cell) for cell in row[:text_columns]]
    return _row([*words, *(_cell(cell) for cell in row[text_columns:])])


def _row(cells: Sequence[str]) -> str:
    # a bracket after the end of a row would be its optional argument
    return " & ".join(f"{{}}{cell}" if cell.startswith("[") else cell for cell in cells) + r" \\"
