"""The four files of one configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from fvi_cli.reports.csv_table import to_csv
from fvi_cli.reports.details import details, setting
from fvi_cli.reports.document import Block, Heading
from fvi_cli.reports.json_table import to_json
from fvi_cli.reports.latex import to_latex
from fvi_cli.reports.markdown import to_markdown
from fvi_cli.reports.plain_text import to_text
from fvi_cli.reports.summary import legend, names_of, summary
from fvi_cli.reports.sweeps import split_sweeps, sweep_details
from fvi_cli.studies.order import OrderTable

FORMS = ("csv", "md", "tex", "json")


def table_paths(directory: Path, name: str) -> dict[str, Path]:
    """Where the forms of the tables of `name` are, by suffix."""
    return {form: directory / f"{name}.{form}" for form in FORMS}


def rendered(name: str, tables: Sequence[OrderTable]) -> dict[str, str]:
    """The text of every form."""
    blocks = report(name, tables)
    texts: Mapping[str, str] = {
        "csv": to_csv(tables),
        "md": to_markdown(blocks),
        "tex": to_latex(blocks),
        "json": to_json(name, tables),
    }
    return {form: texts[form] for form in FORMS}


def report(name: str, tables: Sequence[OrderTable]) -> list[Block]:
    """Summary first, then every experiment in detail."""
    blocks: list[Block] = [Heading(level=1, words=f"Orders of convergence: {name}")]
    blocks += summary(name, tables)
    blocks += legend(tables)
    names = names_of(tables)
    single, swept = split_sweeps(tables)
    for table in single:
        blocks += details(table, names)
    for members in swept:
        blocks += sweep_details(members, names, setting(members))
    return blocks


def summary_text(name: str, tables: Sequence[OrderTable]) -> str:
    """What a terminal shows: the title and the summary."""
    title = Heading(level=1, words=f"Orders of convergence: {name}")
    return to_text([title, *summary(name, tables)])
