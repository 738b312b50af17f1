"""The forms of a report: CSV, plain text, Markdown of GitHub, and LaTeX with booktabs."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence

from fvi_cli.reports.document import Block, Bullets, Grid, Heading, Paragraph
from fvi_cli.reports.table import Column, Report, Sheet, Value


def csv_name(report: Report, sheet: Sheet) -> str:
    """Name of the CSV file of a sheet."""
    is_first = sheet is report.sheets[0]
    return f"{report.name}.csv" if is_first else f"{report.name}-{sheet.name}.csv"


def rendered(report: Report) -> dict[str, str]:
    """The text of every file, by its name: CSV, Markdown, and LaTeX where the report has it."""
    texts = {csv_name(report, sheet): to_csv(sheet) for sheet in report.sheets if sheet.is_file}
    texts[f"{report.name}.md"] = to_markdown(report.blocks)
    if report.has_latex:
        texts[f"{report.name}.tex"] = to_latex(report.blocks)
    return texts


def to_csv(sheet: Sheet) -> str:
    """A line for every row under the names of the columns.

    A float is written as its ``repr``, from which the same number is read back; nan means that
    there is no number. Lines end with a newline only.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in sheet.written])
    writer.writerows([as_word(row[c.name], c) for c in sheet.written] for row in sheet.rows)
    return text.getvalue()


def as_word(value: Value, column: Column) -> str:
    """The text of a value in the CSV form."""
    if value is None:
        return column.missing
    if isinstance(value, bool):
        return "yes" if value else "no"
    # `float` also converts NumPy's numbers
    return repr(float(value)) if isinstance(value, float) else str(value)


def as_value(word: str, like: Value) -> Value:
    """The value of `word` if it can be read with the type of `like`; otherwise the word."""
    try:
        if isinstance(like, bool):
            return {"yes": True, "no": False}.get(word, word)
        if isinstance(like, float):
            return float(word)
        return int(word) if isinstance(like, int) else word
    except ValueError:
        return word


def read_csv(text: str) -> tuple[list[str], list[list[str]]]:
    """Names of the columns, and the words of every row."""
    lines = list(csv.reader(io.StringIO(text)))
    return (lines[0], lines[1:]) if lines else ([], [])


def to_text(blocks: Sequence[Block]) -> str:
    """The blocks as plain text, without a newline at the end."""
    return "\n\n".join(map(_plain, blocks))


def _plain(block: Block) -> str:
    if isinstance(block, Heading | Paragraph):
        return block.words.replace("`", "")
    if isinstance(block, Bullets):
        return "\n".join(f"- {item}" for item in block.items)
    return grid_as_text(block)


def grid_as_text(grid: Grid) -> str:
    """The lines of a grid, without a newline at the end."""
    return "\n".join("  ".join(line).rstrip() for line in grid.aligned(grid.lines))


_ACTIVE = re.compile(r"([\\`*_\[\]<>|~#$&])")


def to_markdown(blocks: Sequence[Block]) -> str:
    """The blocks as Markdown, a blank line between them and a newline at the end."""
    return "\n\n".join(map(_marked_down, blocks)) + "\n"


def _marked_down(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {_inline(block.words)}"
    if isinstance(block, Paragraph):
        return _inline(block.words)
    if isinstance(block, Bullets):
        return "\n".join(f"- {_inline(item)}" for item in block.items)
    head, *rows = block.aligned([[escape_markdown(c) for c in line] for line in block.lines], 3)
    words = block.text_columns
    rule = ["-" * len(c) if k < words else "-" * (len(c) - 1) + ":" for k, c in enumerate(head)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))


def _inline(words: str) -> str:
    parts = re.split("(`[^`]*`)", words)
    return "".join(one if k % 2 else escape_markdown(one) for k, one in enumerate(parts))


def escape_markdown(text: str) -> str:
    """Text with markup characters escaped."""
    return _ACTIVE.sub(r"\\\1", " ".join(text.splitlines()))


_ESCAPES: Mapping[str, str] = {
    **{letter: f"\\{letter}" for letter in "{}$&#%_"},
    **{letter: f"${letter}$" for letter in "<>|"},
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "`": r"{\char96}",
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
}
_NUMBER = re.compile(r"(?<![\w.^])(-?\d+(?:\.\d+)?)(?:e([+-]?\d+))?(?![\w.])")


def to_latex(blocks: Sequence[Block]) -> str:
    r"""Every grid of the blocks as a ``tabular`` to ``\input``."""
    tables = (_tabular(block) for block in blocks if isinstance(block, Grid))
    return "\n\n".join([r"% To \input; needs \usepackage{booktabs}", *tables]) + "\n"


def escape_latex(text: str) -> str:
    """Text without LaTeX commands; letters beyond Latin-1 are given by their number."""
    plain = " ".join(text.splitlines())
    known = (
        one if " " <= one <= "~" or "À" <= one <= "ÿ" else f"U+{ord(one):04X}" for one in plain
    )
    return "".join(_ESCAPES.get(one, word) for one, word in zip(plain, known, strict=True))


def _with_numbers(text: str) -> str:
    """Text with its numbers as mathematics."""
    parts, end = [], 0
    for found in _NUMBER.finditer(text):
        power = "" if found[2] is None else rf"\cdot10^{{{int(found[2])}}}"
        parts += [escape_latex(text[end : found.start()]), f"${found[1]}{power}$"]
        end = found.end()
    return "".join([*parts, escape_latex(text[end:])])


def _tabular(grid: Grid) -> str:
    def row(cells: Sequence[str]) -> str:
        words = [escape_latex(cell) for cell in cells[: grid.text_columns]]
        words += [_with_numbers(cell) for cell in cells[grid.text_columns :]]
        # a bracket at the beginning of a row would be an optional argument of the row before it
        return " & ".join(f"{{}}{one}" if one.startswith("[") else one for one in words) + r" \\"

    columns = "".join("l" if k < grid.text_columns else "r" for k in range(len(grid.header)))
    begin = rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}"
    lines = [begin, r"\toprule", row(grid.header), r"\midrule", *map(row, grid.rows)]
    lines += [r"\midrule", *map(row, grid.foot)] if grid.foot else []
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])
