"""Writing figures to files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_figures(
    figures: Mapping[str, Figure], output: Path, *, formats: Sequence[str] = ()
) -> list[Path]:
    """Write figures under ``figures/`` in `output`, as PNG or in `formats`; returns the paths."""
    if not figures:
        return []
    # a slow import, which tables do not need
    from fvi_cli.plotting import FORMATS, save_figure

    forms = list(dict.fromkeys(formats or FORMATS[:1]))
    folder = output / "figures"
    return [p for name, one in figures.items() for p in save_figure(one, folder, name, forms)]
