"""Figures put into files, and compared with those that are there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_figures(figures: Mapping[str, Figure], output: Path) -> list[Path]:
    """Write figures under ``figures/`` in `output`; returns the paths."""
    from fvi_cli.plotting import save_figure

    written: list[Path] = []
    for name, figure in figures.items():
        written += save_figure(figure, output / "figures", name)
    return written


def compare_figures(figures: Mapping[str, Figure], output: Path) -> list[str]:
    """One line for everything that the stored figures show differently."""
    from fvi_cli.plotting import compare_drawn, drawn_text

    differences = []
    for name, figure in figures.items():
        path = output / "figures" / f"{name}.json"
        missing = [
            str(other)
            for other in (path, path.with_suffix(".pdf"), path.with_suffix(".png"))
            if not other.is_file()
        ]
        differences += [f"{other}: missing" for other in missing]
        if not path.is_file():
            continue
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            differences.append(f"{path}: cannot be read")
            continue
        fresh = json.loads(drawn_text(figure))
        differences += [f"{path}: {line}" for line in compare_drawn(stored, fresh)]
    return differences
