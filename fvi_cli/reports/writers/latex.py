r"""The grids of a report as LaTeX to ``\input``: bare tables with the package booktabs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from fvi_cli.reports.document import Block, Grid

_HEAD = r"% To \input; needs \usepackage{booktabs}"

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
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
}

# characters that LaTeX sets without packages: printable ASCII and the letters of Latin-1
_LETTER = re.compile(r"[\x20-\x7e\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u00ff]")

_NUMBER = re.compile(
    r"(?<![\w.^])(?P<mantissa>-?\d+(?:\.\d+)?)(?:e(?P<exponent>[+-]?\d+))?(?![\w.])"
)


def to_latex(blocks: Sequence[Block]) -> str:
    """Every grid of the blocks as a ``tabular``."""
    tables = (_table(block) for block in blocks if isinstance(block, Grid))
    return "\n\n".join([_HEAD, *tables]) + "\n"


def escape_latex(text: str) -> str:
    """Text without LaTeX commands; letters beyond Latin-1 are given by their number."""
    letters = []
    for letter in " ".join(text.splitlines()):
        known = letter if _LETTER.fullmatch(letter) else f"U+{ord(letter):04X}"
        letters.append(_ESCAPES.get(letter, known))
    return "".join(letters)


def _with_numbers(text: str) -> str:
    """Text with its numbers as mathematics."""
    parts = []
    end = 0
    for match in _NUMBER.finditer(text):
        parts.append(escape_latex(text[end : match.start()]))
        exponent = match["exponent"]
        power = "" if exponent is None else rf"\cdot10^{{{int(exponent)}}}"
        parts.append(f"${match['mantissa']}{power}$")
        end = match.end()
    parts.append(escape_latex(text[end:]))
    return "".join(parts)


def _table(grid: Grid) -> str:
    columns = "".join("l" if k < grid.text_columns else "r" for k in range(len(grid.header)))
    body = [_row(row, grid.text_columns) for row in grid.rows]
    if grid.summary_rows:
        body.append(r"\midrule")
        body += [_row(row, grid.text_columns) for row in grid.summary_rows]
    header = _row(grid.header, grid.text_columns)
    begin = rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}"
    lines = [begin, r"\toprule", header, r"\midrule", *body, r"\bottomrule", r"\end{tabular}"]
    return "\n".join(lines)


def _row(cells: Sequence[str], text_columns: int) -> str:
    words = [escape_latex(cell) for cell in cells[:text_columns]]
    words += [_with_numbers(cell) for cell in cells[text_columns:]]
    # a bracket at the beginning of a row would be an optional argument of the row end before it
    return " & ".join(f"{{}}{word}" if word.startswith("[") else word for word in words) + r" \\"
