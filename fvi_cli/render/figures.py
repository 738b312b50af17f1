"""Figures put into files, and compared with those that are there."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_figures(
    figures: Mapping[str, Figure],
    output: Path,
    *,
    formats: Sequence[str] = (),
    anew: bool = False,
) -> list[Path]:
    """Bring figures under ``figures/`` in `output` up to date; returns the paths.

    Where the files show what the figure shows (:func:`compare_figures`) they are left as they are,
    and only pictures that are missing are drawn, unless it is wanted `anew`.
    """
    from fvi_cli.plotting import USUAL_FORMS, save_figure

    forms = list(dict.fromkeys((*formats, "json") if formats else USUAL_FORMS))
    paths: list[Path] = []
    for name, figure in figures.items():
        files = {form: output / "figures" / f"{name}.{form}" for form in forms}
        agrees = not anew and not compare_figures({name: figure}, output, formats=())
        wanted = [form for form, path in files.items() if not (agrees and path.is_file())]
        save_figure(figure, output / "figures", name, wanted)
        paths += files.values()
    return paths


def compare_figures(
    figures: Mapping[str, Figure], output: Path, *, formats: Sequence[str] = ("png",)
) -> list[str]:
    """One line for everything that the stored figures show differently.

    Pictures in `formats` must be there: by default those that documents show.
    """
    from fvi_cli.plotting import compare_drawn, drawn_text

    differences = []
    for name, figure in figures.items():
        path = output / "figures" / f"{name}.json"
        files = (path, *(path.with_suffix(f".{kind}") for kind in formats))
        differences += [f"{other}: missing" for other in files if not other.is_file()]
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
