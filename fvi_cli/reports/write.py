"""The forms of a report (CSV, text, Markdown, LaTeX with booktabs), its files, and their check."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from fvi_cli.reports.table import Block, Grid, Report, Sheet, Value, Within
from fvi_cli.storage.files import replace_file


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


def write(directory: Path, report: Report) -> list[Path]:
    """Write the files of a report into `directory`: their paths.

    Each appears whole or not at all.

    Raises
    ------
    StorageError
        If the folder or a file cannot be written.
    """
    texts = {directory / name: text for name, text in rendered(report).items()}
    for place, text in texts.items():
        replace_file(place, text.encode("utf-8"))
    return list(texts)


def to_csv(sheet: Sheet) -> str:
    """A line for every row under the names of the columns.

    A float is written as its ``repr``, from which the same number is read back; nan means that
    there is no number. Lines end with a newline only.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in sheet.written])
    writer.writerows(map(as_word, row.values()) for row in sheet.rows)
    return text.getvalue()


def as_word(value: Value) -> str:
    """The text of a value in the CSV form."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    # `float` also converts NumPy's numbers
    return repr(float(value)) if isinstance(value, float) else str(value)


def to_text(blocks: Sequence[Block]) -> str:
    """The blocks as plain text, without a newline at the end."""
    return "\n\n".join(filter(None, map(_plain, blocks)))


def _plain(block: Block) -> str:
    if isinstance(block, str):
        return block.lstrip("# ").replace("`", "")
    lines = _aligned(block, [block.header, *block.rows, *block.foot])
    return "\n".join("  ".join(line).rstrip() for line in lines)


def _aligned(grid: Grid, lines: Sequence[Sequence[str]], least: int = 0) -> list[list[str]]:
    """The entries of lines padded to their columns: words left, numbers right."""
    widths = [max(least, *map(len, column)) for column in zip(*lines, strict=True)]
    pads = [str.rjust if is_number else str.ljust for is_number in grid.has_numbers]
    return [[p(c, w) for p, c, w in zip(pads, line, widths, strict=True)] for line in lines]


_ACTIVE = re.compile(r"([\\`*_\[\]<>|~#$&])")


def to_markdown(blocks: Sequence[Block]) -> str:
    """The blocks as Markdown, a blank line between them and a newline at the end."""
    return "\n\n".join(map(_marked_down, blocks)) + "\n"


def _marked_down(block: Block) -> str:
    if isinstance(block, str):
        return "\n".join(map(_inline, block.splitlines()))
    lines = [block.header, *block.rows, *block.foot]
    head, *rows = _aligned(block, [[escape_markdown(c) for c in line] for line in lines], 3)
    ends = ["-:"[is_number] for is_number in block.has_numbers]
    rule = ["-" * (len(c) - 1) + end for c, end in zip(head, ends, strict=True)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))


def _inline(line: str) -> str:
    begin, words = re.fullmatch("(#+ |- |)(.*)", line).groups()  # type: ignore[union-attr]
    parts = re.split("(`[^`]*`)", words)
    return begin + "".join(p if k % 2 else escape_markdown(p) for k, p in enumerate(parts))


def escape_markdown(text: str) -> str:
    """Text with markup characters escaped."""
    return _ACTIVE.sub(r"\\\1", " ".join(text.splitlines()))


_ESCAPES: Mapping[str, str] = {
    **{letter: f"\\{letter}" for letter in "{}$&#%_"},
    **{letter: f"${letter}$" for letter in "<>|"},
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "²": r"\textsuperscript{2}",
}
_NUMBER = re.compile(r"(\(?)([+-]?\d+(?:\.\d+)?)(?:e([+-]?\d+))?(\)?)")


def to_latex(blocks: Sequence[Block]) -> str:
    r"""Every grid of the blocks as a ``tabular`` to ``\input``."""
    tables = (_tabular(block) for block in blocks if isinstance(block, Grid))
    return "\n\n".join([r"% To \input; needs \usepackage{booktabs}", *tables]) + "\n"


def _tabular(grid: Grid) -> str:
    columns = "".join("lr"[is_number] for is_number in grid.has_numbers)
    head, *rows = (
        # a bracket at the beginning of a row would be an optional argument of the row before it
        " & ".join(map(_typeset, line)).replace("[", "{[}") + r" \\"
        for line in (grid.header, *grid.rows, *grid.foot)
    )
    lines = [rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}", r"\toprule", head, r"\midrule", *rows]
    if grid.foot:
        lines.insert(-len(grid.foot), r"\midrule")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])


def _typeset(text: str) -> str:
    """Text without LaTeX commands, or a number as mathematics."""
    if found := _NUMBER.fullmatch(text):
        begin, digits, power, end = found.groups(default="")
        return f"${begin}{digits}" + (rf"\cdot10^{{{int(power)}}}" if power else "") + f"{end}$"
    return "".join(_ESCAPES.get(letter, letter) for letter in " ".join(text.splitlines()))


def compare(directory: Path, report: Report) -> list[str]:
    """One line for every stored number that differs from `report` by more than its tolerance."""
    found = []
    for sheet in report.sheets:
        path = directory / csv_name(report, sheet)
        if sheet.is_file and not path.is_file():
            found.append(f"{path}: missing")
        elif sheet.is_file:
            text = path.read_text(encoding="utf-8", errors="replace")
            found += [f"{path}:{line}" for line in _differences(text, sheet)]
    return found


def _differences(text: str, sheet: Sheet) -> Iterator[str]:
    names = [one.name for one in sheet.written]
    header, *stored = list(csv.reader(io.StringIO(text))) or [[]]
    if header != names or any(len(line) != len(names) for line in stored):
        yield f"1: its columns are not {','.join(names)}"
    elif len(stored) != len(sheet.items):
        yield f"1: {len(stored)} rows are stored, now there are {len(sheet.items)}"
    else:
        for number, (words, item) in enumerate(zip(stored, sheet.items, strict=True), start=2):
            ignored = sheet.is_round_off(item, dict(zip(names, words, strict=True)))
            for column, word in zip(sheet.written, words, strict=True):
                is_compared = column.within is not None and column.name not in ignored
                now = column.of(item)
                if is_compared and not _agree(word, now, column.within or Within()):
                    yield f"{number}: {column.name}: {word} is stored, now {as_word(now)}"


def _agree(word: str, now: Value, within: Within) -> bool:
    if not isinstance(now, float):
        return word == as_word(now)
    try:
        return within.holds(float(word), now)
    except ValueError:
        return False
