"""Figures put into files, and compared with those that are there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FORMS = (".pdf", ".png", ".json")


def write_figures(figures: Mapping[str, Figure], output: Path, *, anew: bool = False) -> list[Path]:
    """Bring figures under ``figures/`` in `output` up to date; returns the paths.

    One whose files are all there and show what it shows (:func:`compare_figures`) is left as it
    is, unless it is wanted `anew`.
    """
    from fvi_cli.plotting import save_figure

    directory = output / "figures"
    paths: list[Path] = []
    for name, figure in figures.items():
        if anew or compare_figures({name: figure}, output):
            save_figure(figure, directory, name)
        paths += [directory / f"{name}{form}" for form in FORMS]
    return paths


def compare_figures(figures: Mapping[str, Figure], output: Path) -> list[str]:
    """One line for everything that the stored figures show differently."""
    from fvi_cli.plotting import compare_drawn, drawn_text

    differences = []
    for name, figure in figures.items():
        path = output / "figures" / f"{name}.json"
        missing = [str(other) for other in map(path.with_suffix, FORMS) if not other.is_file()]
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
