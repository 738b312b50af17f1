"""The page on the cost of accuracy."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from fvi_cli.plotting.ladders.cost import cost_figure_names
from fvi_cli.reports.document import Block, CodeSpan, Heading, Paragraph
from fvi_cli.reports.kinds.cost import cost_summary
from fvi_cli.reports.writers.text import to_markdown
from fvi_cli.storage.atomic import replace_file
from fvi_cli.storage.provenance import package_versions, platform_name
from fvi_cli.studies.cost import CostTable

PAGE = "cost.md"
PAGE_CONFIGS = ("cost-paper", "cost-step-forced", "cost-pendulum")
"""Shipped configurations with a section on the page."""


def write_page(output: Path, measured_tables: Mapping[str, Sequence[CostTable]]) -> Path:
    """Write ``cost.md``: the summaries of all configurations."""
    versions = package_versions()
    made_by = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "scipy"))
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    blocks: list[Block] = [
        Heading(level=1, words="What accuracy costs"),
        Paragraph(
            words=(
                "Made by ",
                CodeSpan("fvi cost"),
                f" in one process on one core: {platform_name()}, {made_by}; runnable processes "
                f"{load} on {os.cpu_count()} processors. Every run is in ",
                CodeSpan("tables/<name>-cost.csv"),
                ". Times mean little where others compute as well.",
            )
        ),
    ]
    for index, (name, tables) in enumerate(measured_tables.items()):
        blocks.append(Heading(level=2, words=name))
        # the explanation of the numbers is printed once
        blocks += list(cost_summary(tables, level=3))[min(index, 1) :]
    # pictures are no blocks of a report, so they are inserted below the heading afterwards
    text = to_markdown(blocks)
    for name, tables in measured_tables.items():
        pictures = "".join(
            f"\n![Error against time and work, {picture}](figures/{picture}.png)\n"
            for picture in cost_figure_names(name, tables)
        )
        text = text.replace(f"\n## {name}\n", f"\n## {name}\n{pictures}", 1)
    path = output / PAGE
    output.mkdir(parents=True, exist_ok=True)
    replace_file(path, text.encode("utf-8"))
    return path
