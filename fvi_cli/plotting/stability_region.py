"""Stability regions in the plane of stiffness and damping of a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.region import GROWTH_LEVELS, StabilityMap
from fvi_cli.plotting.methods import method_labels
from fvi_cli.plotting.style import (
    COLUMN_WIDTH,
    INK,
    SMALL_TEXT,
    few_decades,
    fraction,
    journal_style,
    legend_of,
    lowest,
    new_figure,
    note,
)
from fvi_cli.studies.stability_study import StabilityTable

MOST_COLUMNS = 3

# undecided, stable, and the growth of the worst mode per step from slow to fast
_COLOURS = ("#E69F00", "#7FBFE8", "#F2F2F2", "#D9D9D9", "#B3B3B3", "#808080")
_LABELS = (
    "not decided",
    "stable",
    "growth 0.1 to 1 %",
    "to 10 %",
    "to a factor e",
    "faster, per step",
)


def region_figures(stem: str, table: StabilityTable) -> dict[str, Figure]:
    """One figure for every order of damping, by the name of its files."""
    orders = sorted({region.order for region in table.regions})
    figures = {}
    for order in orders:
        maps = [region for region in table.regions if region.order == order]
        word = f"{order:g}".replace(".", "-")
        figures[f"{stem}-stability-region-{word}"] = region_figure(maps)
    return figures


def region_figure(maps: Sequence[StabilityMap]) -> Figure:
    """A panel for every method, those of one family side by side."""
    lines = _lines(maps)
    columns = max(len(line) for line in lines)
    labels = method_labels([one.method for one in maps])
    order = maps[0].order
    with journal_style():
        size = min((COLUMN_WIDTH - 0.5) / columns, 1.8)
        figure = new_figure(1.25 + (size + 0.12) * len(lines))
        grid = figure.subplots(len(lines), columns, squeeze=False, sharex=True, sharey=True)
        for row, line in zip(grid, lines, strict=True):
            for axes in row[len(line) :]:
                axes.set_axis_off()
            for axes, one in zip(row, line, strict=False):
                _panel(axes, one)
                axes.set_title(labels[one.method.case].replace(", ", "\n", 1), fontsize=SMALL_TEXT)
            row[0].set_ylabel(r"$\mu\, h^{2-\gamma} / m$")
        for axes in lowest(grid):
            axes.set_xlabel("$h^2 k / m$")
        figure.suptitle(
            rf"Stability regions, damping of order $\gamma = {fraction(order)}$;"
            "\npercentages: stable share of the area shown",
            fontsize=9.0,
        )
        undecided = any((one.level < 0).any() for one in maps)
        shown = range(0 if undecided else 1, len(_LABELS))
        handles = [
            Patch(facecolor=_COLOURS[k], edgecolor=INK, linewidth=0.3, label=_LABELS[k])
            for k in shown
        ]
        legend_of(figure, handles)
    return figure


def _lines(maps: Sequence[StabilityMap]) -> list[list[StabilityMap]]:
    """Methods of one family and degree in a row; long rows are cut."""
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


def _panel(axes: Axes, one: StabilityMap) -> None:
    """The plane with the share of it that is stable."""
    norm = BoundaryNorm(np.arange(-1.5, len(GROWTH_LEVELS) + 1.0), len(_COLOURS))
    axes.pcolormesh(
        one.stiffness,
        one.damping,
        one.level,
        cmap=ListedColormap(_COLOURS),
        norm=norm,
        shading="nearest",
        rasterized=True,
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    if 0 < one.share_stable < 1 and min(one.level.shape) > 1:
        axes.contour(
            one.stiffness,
            one.damping,
            (one.level == 0).astype(float),
            levels=[0.5],
            colors=[INK],
            linewidths=0.8,
        )
    share = f"{100 * one.share_stable:.0f} %"
    note(axes, 0.05, 0.95, share, ha="left", va="top", paper={"alpha": 0.8, "pad": 1.0})
    for axis in (axes.xaxis, axes.yaxis):
        few_decades(axis, 4)
        axis.set_minor_locator(NullLocator())
