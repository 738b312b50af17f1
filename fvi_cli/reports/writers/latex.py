r"""Reports as LaTeX to ``\input``: bare tables, or headings, text and tables with four packages."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

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
from fvi_cli.reports.writers.equations import to_mathematics

PACKAGES = ("amsmath", "array", "booktabs", "longtable")

_HEAD = rf"""% To \input; needs \usepackage{{{",".join(PACKAGES)}}}"""

WIDEST = 92
"""Most letters in a line of a table for the text width of the class ``article``, footnote size."""

WIDEST_TEXT = 34
"""Texts in a table are wrapped at so many letters."""

LONGEST = 40
"""Most rows of a table on one page."""

_EM = 0.47
"""Average width of a letter, in em."""

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
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
}

# characters that LaTeX sets without packages: printable ASCII and the letters of Latin-1
_LETTER = re.compile(r"[\x20-\x7e\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u00ff]")

_NUMBER = re.compile(
    r"(?<![\w.^])(?P<mantissa>-?\d+(?:\.\d+)?)(?:e(?P<exponent>[+-]?\d+))?(?![\w.])"
)


def to_latex(blocks: Sequence[Block]) -> str:
    """The blocks as a fragment; every table in it can be used by itself."""
    words = (_block(block) for block in blocks)
    return "\n\n".join([_HEAD, r"{\raggedright\setlength{\parindent}{0pt}", *words, "}"]) + "\n"


def to_tabulars(blocks: Sequence[Block]) -> dict[str, str]:
    r"""Every table by its name, as a bare ``tabular`` in the size of the text around it.

    A wide table is divided into numbered parts, each narrow enough for ``\footnotesize`` with
    columns ``4pt`` apart. Several tables of one name are numbered, too.
    """
    named: dict[str, list[Grid]] = {}
    for block in blocks:
        if isinstance(block, Grid):
            parts = split_wide(block, WIDEST, WIDEST_TEXT, _letters)
            named.setdefault(_file_words(block.name), []).extend(parts)
    return {
        "-".join(filter(None, (name, str(number) if len(parts) > 1 else ""))): f"{_table(part)}\n"
        for name, parts in named.items()
        for number, part in enumerate(parts, start=1)
    }


def _file_words(name: str) -> str:
    """A name with hyphens for characters that a path in LaTeX may not have."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")


def _block(block: Block) -> str:
    if isinstance(block, Heading):
        section = _SECTIONS[min(block.level, len(_SECTIONS)) - 1]
        return f"\\{section}{{{escape_latex(plain_text(block.words))}}}"
    if isinstance(block, Paragraph):
        return rf"{_inline(block.words)}\par\smallskip"
    if isinstance(block, Bullets):
        items = "\n".join(f"\\item {{}}{_inline(item)}" for item in block.items)
        return f"\\begin{{itemize}}\n{items}\n\\end{{itemize}}"
    return "\n\n".join(_grid(part) for part in split_wide(block, WIDEST, WIDEST_TEXT, _letters))


def _letters(cell: str) -> int:
    # powers of ten are wider in LaTeX than the letter e
    return len(cell) + 2 * sum(match["exponent"] is not None for match in _NUMBER.finditer(cell))


def _inline(words: Words) -> str:
    found = []
    for piece in pieces(words):
        if isinstance(piece, Equation):
            found.append(_equation(piece.text))
        elif isinstance(piece, CodeSpan):
            # names of methods may be broken after a hyphen
            found.append(rf"\texttt{{{escape_latex(piece.text)}}}".replace("-", r"-\allowbreak{}"))
        else:
            found.append(_folding(_with_numbers(plain_text((piece,)))))
    return "".join(found)


def _equation(text: str) -> str:
    return "".join(
        f"${part}$" if is_mathematics else escape_latex(part)
        for part, is_mathematics in to_mathematics(text)
    )


def escape_latex(text: str) -> str:
    """Text without LaTeX commands; letters beyond Latin-1 are given by their number."""
    letters = []
    for letter in " ".join(text.splitlines()):
        known = letter if _LETTER.fullmatch(letter) else f"U+{ord(letter):04X}"
        letters.append(_ESCAPES.get(letter, known))
    return "".join(letters)


def _folding(text: str) -> str:
    """Text in which long words may be broken after dots and hyphens between letters."""
    return re.sub(r"(?<=[a-z0-9][-.])(?=[a-z])", r"\\allowbreak{}", text)


def _with_numbers(text: str) -> str:
    """Text with its numbers as mathematics."""
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
    size = "\\footnotesize\\setlength{\\tabcolsep}{4pt}"
    return f"{{{size}\n{_table(grid, is_long=len(grid.rows) > LONGEST)}\n\\par\\medskip}}"


def _table(grid: Grid, *, is_long: bool = False) -> str:
    """The lines of a table, on one page unless it `is_long`."""
    folded = rf">{{\raggedright\arraybackslash}}p{{{WIDEST_TEXT * _EM:.0f}em}}"
    columns = "".join(
        ("l" if width <= WIDEST_TEXT else folded) if k < grid.text_columns else "r"
        for k, width in enumerate(grid.widths())
    )
    header = [_row(grid.header, grid.text_columns), r"\midrule"]
    body = [_row(row, grid.text_columns) for row in grid.rows]
    if grid.summary_rows:
        body.append(r"\midrule")
        body += [_row(row, grid.text_columns) for row in grid.summary_rows]
    end = [r"\bottomrule"]
    if is_long:
        header += [
            r"\endhead",
            rf"\midrule \multicolumn{{{len(grid.header)}}}{{r@{{}}}}{{continued}} \\",
            r"\endfoot",
            r"\bottomrule",
            r"\endlastfoot",
        ]
        end = []
    kind, place = ("longtable", "[l]") if is_long else ("tabular", "")
    begin = rf"\begin{{{kind}}}{place}{{@{{}}{columns}@{{}}}}"
    return "\n".join([begin, r"\toprule", *header, *body, *end, rf"\end{{{kind}}}"])


def _row(cells: Sequence[str], text_columns: int) -> str:
    words = [_folding(escape_latex(cell)) for cell in cells[:text_columns]]
    words += [_with_numbers(cell) for cell in cells[text_columns:]]
    # a bracket at the beginning of a row would be an optional argument of the row end before it
    return " & ".join(f"{{}}{word}" if word.startswith("[") else word for word in words) + r" \\"
