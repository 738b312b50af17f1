"""Stability regions in the plane of stiffness and damping, with the growth of the worst mode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.region import GROWTH_LEVELS, StabilityMap
from fvi_cli.plotting.style import (
    INK,
    journal_style,
    legend_of,
    new_figure,
    note,
    panel_grid,
)
from fvi_cli.plotting.words import fraction_in_words, typeset

MOST_COLUMNS = 3
_HEIGHT = 0.68  # inches of a panel
_PAPER = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}

# undecided, stable, then the growth of the worst mode per step from slow to fast; stable is the
# darkest also when printed in grey
_LEVEL_COLOURS = ("#E69F00", "#3B7BB5", "#F7F7F7", "#E3E3E3", "#C8C8C8", "#A4A4A4")
_LEVEL_LABELS: tuple[str, ...] = ("not decided", "stable (below 0.1 %)", "0.1 to 1 %", "1 to 10 %")
_LEVEL_LABELS += ("10 % to a factor e", "faster")


@journal_style()
def region_figure(maps: Sequence[StabilityMap]) -> Figure:
    """A panel for every method, a row for every family, with the stable share of the plane."""
    lines = _lines(maps)
    columns = max(len(line) for line in lines)
    padded = [one for line in lines for one in (*line, *[None] * (columns - len(line)))]
    figure = new_figure(0.45 + (_HEIGHT + 0.17) * len(lines))
    grid, _ = panel_grid(figure, len(padded), columns, sharex=True, sharey=True)
    for axes, one in zip(figure.axes, padded, strict=True):
        if one is None:
            axes.set_axis_off()
            continue
        _draw(axes, one)
        title = typeset(one.method.label).replace(" (", "\n(", 1)
        axes.set_title(title, fontsize=rcParams["legend.fontsize"], pad=2.5)
    for column in grid:
        lowest = [axes for axes in column if axes.axison][-1]
        lowest.tick_params(labelbottom=True)
    figure.supxlabel("stiffness $h^2 k / m$", fontsize=rcParams["axes.labelsize"])
    figure.supylabel(r"damping $\mu\, h^{2-\gamma} / m$", fontsize=rcParams["axes.labelsize"])
    undecided = any((one.level < 0).any() for one in maps)
    handles = [
        Patch(facecolor=_LEVEL_COLOURS[k], edgecolor=INK, linewidth=0.3, label=_LEVEL_LABELS[k])
        for k in range(0 if undecided else 1, len(_LEVEL_LABELS))
    ]
    order = fraction_in_words(maps[0].order)
    title = rf"damping of order $\gamma = {order}$; growth of the worst mode in one step"
    title += "\nnumbers: share of the panel that is stable"
    legend_of(figure, handles, title=title)
    return figure


def _lines(maps: Sequence[StabilityMap]) -> list[list[StabilityMap]]:
    """Rows of the methods of one family and degree; long rows are divided."""
    families: dict[object, list[StabilityMap]] = {}
    for one in maps:
        method = one.method
        key: object = "baseline"
        if isinstance(method, Method):
            key = "runge-kutta" if method.is_runge_kutta else (method.sampling, method.degree)
        families.setdefault(key, []).append(one)
    return [
        family[begin : begin + MOST_COLUMNS]
        for family in families.values()
        for begin in range(0, len(family), MOST_COLUMNS)
    ]


def _calmest_corner(level: NDArray[np.int_]) -> tuple[int, int]:
    """(Row, column), each 0 or -1, of the corner where text hides least; the lower left first."""
    height, width = max(1, level.shape[0] // 3), max(1, level.shape[1] // 2)
    return min(
        ((row, column) for row in (0, -1) for column in (0, -1)),
        key=lambda at: (
            np.unique(
                level[-height if at[0] else None :, -width if at[1] else None :][:height, :width]
            ).size
        ),
    )


def _draw(axes: Axes, one: StabilityMap) -> None:
    """Draw a plane and the share of it that is stable."""
    plane = (one.stiffness, one.damping)
    norm = BoundaryNorm(np.arange(-1.5, len(GROWTH_LEVELS) + 1.0), len(_LEVEL_COLOURS))
    cells = axes.pcolormesh(*plane, one.level, cmap=ListedColormap(_LEVEL_COLOURS), norm=norm)
    cells.set_rasterized(True)
    axes.set(xscale="log", yscale="log")
    row, column = _calmest_corner(one.level)
    place = (0.95 if column else 0.05, 0.93 if row else 0.07)
    text = note(axes, *place, f"{100 * one.share_stable:.0f} %", bbox=_PAPER)
    text.set(ha="right" if column else "left", va="top" if row else "bottom")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(NullLocator())
