"""Figures of stability: over the steps, over one or two parameters, and in the plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.looks import method_looks
from fvi_cli.plotting.regions import region_figure
from fvi_cli.plotting.style import (
    journal_style,
    legend_of,
    new_figure,
    panel_grid,
    wrap,
)
from fvi_cli.reports.naming import key_label, with_unit
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable

STABLE_COLOUR = "#A8D3EE"
UNSTABLE_COLOUR = "#D9824F"
SLOW_COLOUR = "#FBE6D4"
UNKNOWN_COLOUR = "#E6E6E6"
_HATCHES = {UNSTABLE_COLOUR: "////"}
_COLOURS = {
    "stable": STABLE_COLOUR,
    "unstable, not visible by the final time": SLOW_COLOUR,
    "unstable, visible by the final time": UNSTABLE_COLOUR,
    "not predicted": UNKNOWN_COLOUR,
}
MOST_PANELS = 12


def stability_figures(name: str, tables: Sequence[StabilityTable]) -> dict[str, Figure]:
    """Every figure of a study, by the name of its files."""
    figures: dict[str, Figure] = {}
    for table in tables:
        stem = table.experiment.name if len(tables) > 1 else name
        for order in sorted({region.order for region in table.regions}):
            word = f"{order:g}".replace(".", "-")
            maps = [region for region in table.regions if region.order == order]
            figures[f"{stem}-stability-region-{word}"] = region_figure(maps)
        if table.experiment.members:
            figures[f"{stem}-stability"] = parameter_figure(table)
        elif len(table.experiment.steps) > 1:
            figures[f"{stem}-stability"] = step_figure(table)
    return figures


@journal_style()
def step_figure(table: StabilityTable) -> Figure:
    """Stable steps of every method above, growth at the other steps below."""
    styles = method_looks(table.experiment.methods)
    by_case = {case: [row for row in table.rows if row.run.method.case == case] for case in styles}
    steps = sorted({row.run.step_size for row in table.rows})
    figure = new_figure(2.3 + 0.15 * len(styles))
    bars, growth = figure.subplots(2, 1, sharex=True, height_ratios=(0.15 * len(styles), 1.7))
    middles = [math.sqrt(a * b) for a, b in pairwise(steps)]
    edges = [steps[0] / 1.6, *middles, steps[-1] * 1.6]
    for place, rows in enumerate(by_case.values()):
        for row in rows:
            left, right = edges[(at := steps.index(row.run.step_size)) : at + 2]
            colour = _COLOURS[_kind(row)]
            (bar,) = bars.barh(place, right - left, left=left, height=0.62, color=colour)
            bar.set(linewidth=0, edgecolor="white", hatch=_HATCHES.get(colour, ""))
    labels = [style.label for style in styles.values()]
    bars.set_yticks(range(len(labels)), labels)
    bars.tick_params(axis="y", length=0)
    bars.set_ylim(len(labels) - 0.4, -0.6)
    growth.set_yscale("log")
    growing = {
        case: [
            (row.run.step_size, row.prediction.growth_per_step)
            for row in rows
            if row.prediction.growth_per_step > 0
        ]
        for case, rows in by_case.items()
    }
    methods = [rows[0].run.method for case, rows in by_case.items() if growing[case]]
    # few methods need few shades
    for case, style in method_looks(methods).items():
        label = styles[case].label
        growth.plot(*np.array(growing[case]).T, label=label, **style.look.properties())
    if not methods:
        growth.set_ylim(1e-3, 1.0)
        growth.text(0.5, 0.5, "no mode grows", transform=growth.transAxes, ha="center")
    growth.set_ylabel(wrap("logarithm of the growth factor per step", 1.7))
    growth.set_xscale("log")
    growth.set_xlim(edges[0], edges[-1])
    growth.set_xlabel(with_unit("step size $h$", table.experiment.units, "time"))
    figure.align_ylabels([growth])
    legend_of(figure, [*_patches(table), *growth.get_legend_handles_labels()[0]], above=False)
    return figure


def _patches(table: StabilityTable) -> list[Patch]:
    """Legend entries for the colours of a study."""
    found = {_kind(row) for row in table.rows}
    return [
        Patch(facecolor=colour, label=words, edgecolor="white", hatch=_HATCHES.get(colour, ""))
        for words, colour in _COLOURS.items()
        if words in found
    ]


@journal_style()
def parameter_figure(table: StabilityTable) -> Figure:
    """Verdicts over one parameter and the step, or over two parameters, a panel per method."""
    experiment = table.experiment
    keys = _numeric_keys(table)
    panels: list[tuple[str, list[StabilityRow]]] = []
    styles = method_looks(experiment.methods)
    steps = experiment.steps if len(keys) > 1 else (0,)
    for case, style in styles.items():
        own = [row for row in table.rows if row.run.method.case == case]
        for n in steps:
            rows = [row for row in own if n in (0, row.run.n_steps)]
            panels.append((style.label if not n else f"{style.label}, $N={n}$", rows))
    shown = panels[:MOST_PANELS]
    columns = min(2, len(shown))
    rows_of_panels = -(-len(shown) // columns)
    height = min(1.6, 6.6 / rows_of_panels)
    step = with_unit("step size $h$", experiment.units, "time")
    up = step if len(keys) == 1 else key_label(keys[1], experiment.units)
    figure = new_figure(0.9 + height * rows_of_panels)
    grid, used = panel_grid(figure, len(shown), columns, sharex=True, sharey=True)
    for axes, (title, rows) in zip(used, shown, strict=True):
        _verdict_panel(axes, keys, rows)
        axes.set_title(title)
    for axes in grid[0]:
        axes.set_ylabel(wrap(up, 0.8 * height))
    for column in grid:
        column[-1].set_xlabel(wrap(key_label(keys[0], experiment.units), 2.6 / columns))
    some = f"the first {len(shown)} of {len(panels)} panels; all are in the table"
    words = some if len(panels) > len(shown) else ""
    legend_of(figure, _patches(table), title=words)
    return figure


def _numeric_keys(table: StabilityTable) -> list[str]:
    """The swept keys with numbers, at most two; without such keys the number of the member."""
    members = table.experiment.members
    keys = [
        key
        for key in table.experiment.swept
        if all(isinstance(member.values[key], int | float) for member in members)
    ]
    return keys[:2] or ["member"]


def _coordinate(row: StabilityRow, key: str) -> float:
    member = row.run.member
    if member is None:
        return 0.0
    return float(member.number if key == "member" else member.values[key])


def _verdict_panel(axes: Axes, keys: Sequence[str], rows: Sequence[StabilityRow]) -> None:
    """Draw cells of verdicts."""
    across = [_coordinate(row, keys[0]) for row in rows]
    up = [_coordinate(row, keys[1]) if len(keys) > 1 else row.run.step_size for row in rows]
    x, y = sorted(set(across)), sorted(set(up))
    cells = np.full((len(y), len(x)), np.nan)
    for row, a, b in zip(rows, across, up, strict=True):
        cells[y.index(b), x.index(a)] = list(_COLOURS).index(_kind(row))
    x_edges, x_scale = _edges(x)
    y_edges, y_scale = _edges(y)
    axes.set_xscale(x_scale)
    axes.set_yscale(y_scale)
    axes.pcolormesh(
        x_edges,
        y_edges,
        cells,
        cmap=ListedColormap(list(_COLOURS.values())),
        vmin=-0.5,
        vmax=len(_COLOURS) - 0.5,
        rasterized=True,
    )
    axes.set_xlim(x_edges[0], x_edges[-1])
    axes.set_ylim(y_edges[0], y_edges[-1])


def _kind(row: StabilityRow) -> str:
    """The key of the colour of a cell."""
    kinds, verdict = list(_COLOURS), row.prediction.verdict
    if verdict == "stable":
        return kinds[row.prediction.growth_per_step > 0]
    return kinds[2 if verdict == "unstable" else 3]


def _edges(values: Sequence[float]) -> tuple[Array, str]:
    """Borders of the cells around these values, and the scale on which they are equidistant."""
    points = np.array(values, dtype=float)
    if points.size == 1:
        return points[0] + np.array([-0.5, 0.5]) * (abs(points[0]) or 1.0), "linear"
    is_log = points[0] > 0 and points[-1] / points[0] > 20
    scaled = np.log(points) if is_log else points
    middle = 0.5 * (scaled[1:] + scaled[:-1])
    edges = np.concatenate([[2 * scaled[0] - middle[0]], middle, [2 * scaled[-1] - middle[-1]]])
    return (np.exp(edges), "log") if is_log else (edges, "linear")
