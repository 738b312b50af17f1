"""Figures of stability: over the steps, over one or two parameters, and in the plane."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.looks import MethodLook, method_looks
from fvi_cli.plotting.regions import region_figure
from fvi_cli.plotting.style import (
    COLOURS,
    DECORATION,
    GUIDE_COLOUR,
    INK,
    journal_style,
    legend_of,
    new_figure,
    note,
    panel_grid,
    wrap,
)
from fvi_cli.reports.naming import key_label, with_unit
from fvi_cli.studies.stability_study import LASTING, StabilityRow, StabilityTable

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
_POINTS = 60  # of a line of predicted growth
_KEY = (1.02, 1.07, 1.12)  # places of a line of the key, as shares of the width of the bars


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
    """Stable steps of every method above, growth at the other steps below.

    Marks show runs from random data, which are long enough to show any growth.
    """
    methods = table.experiment.methods
    styles = method_looks(methods)
    by_case = {case: [row for row in table.rows if row.run.method.case == case] for case in styles}
    steps = sorted({row.run.step_size for row in table.rows})
    low, high = steps[0] / 1.6, steps[-1] * 1.6
    figure = new_figure(2.3 + 0.15 * len(styles))
    bars, growth = figure.subplots(2, 1, sharex=True, height_ratios=(0.15 * len(styles), 1.7))
    for place, rows in enumerate(by_case.values()):
        _bar(bars, place, rows, low, high)
    labels = [style.label for style in styles.values()]
    bars.set_yticks(range(len(labels)), labels)
    bars.tick_params(axis="y", length=0)
    bars.set_ylim(len(labels) - 0.4, -0.6)
    growth.set_yscale("log")
    growing = [
        rows[0].run.method
        for rows in by_case.values()
        if any(row.prediction.growth_per_step > 0 for row in rows)
    ]
    if growing:
        note(bars, _KEY[1], 1.01, "line below", va="bottom")
    growths = [one for row in table.rows if (one := row.prediction.growth_per_step) > 0] or [1.0]
    growth.set_ylim(0.6 * min(growths), 1.4 * max(growths))
    growth.set_xlim(low, high)
    # few methods need few shades
    for case, style in method_looks(growing).items():
        _draw_growth(growth, replace(style, label=styles[case].label), by_case[case])
        _mark_row(bars, list(styles).index(case), style)
    growth.set_ylabel(wrap("logarithm of the growth factor per step", 1.7))
    if not any(row.prediction.growth_per_step > 0 for row in table.rows):
        growth.set_ylim(1e-3, 1.0)
        growth.text(0.5, 0.5, "no mode grows", transform=growth.transAxes, ha="center")
    growth.set_xscale("log")
    experiment = table.experiment
    growth.set_xlabel(with_unit("step size $h$", experiment.units, "time"))
    figure.align_ylabels([growth])
    final_time = table.rows[0].run.experiment.problem.final_time
    time = f"$T = {final_time:g}$ {experiment.units.get('time', '')}".rstrip()
    is_whole = any(row.verdict == "unknown" for row in table.rows)
    kinds = list(_COLOURS.items())[: None if is_whole else -1]
    fillings = {colour: kind.replace("the final time", time) for kind, colour in kinds}
    marks = [
        Line2D([], [], label="stable in a long run", **_MARKS["stable"]),
        Line2D([], [], label="unstable in a long run", **_MARKS["unstable"]),
        Line2D([], [], label="growth as predicted", color=GUIDE_COLOUR),
        Line2D([], [], label="growth as measured", **_GROWTH),
    ]
    entries = [*_patches(fillings), *_observed_entries(table, marks)]
    legend_of(figure, entries, above=False)
    return figure


def _bar(axes: Axes, place: int, rows: Sequence[StabilityRow], low: float, high: float) -> None:
    """Draw the range of stable steps, with a mark for every examined step."""
    if all(row.verdict == "unknown" for row in rows):
        axes.barh(place, high - low, left=low, height=0.62, color=UNKNOWN_COLOUR, linewidth=0)
    else:
        lasting = rows[0].lasting_step
        final_time = rows[0].run.experiment.problem.final_time
        end = low if math.isnan(lasting) else high if lasting >= final_time else lasting
        steps = sorted((row.run.step_size, row.verdict == "unstable") for row in rows)
        middles = [math.sqrt(a * b) for (a, _), (b, _) in pairwise(steps)]
        edges = [low, *middles, high]
        parts = [(low, end, STABLE_COLOUR)]
        parts += [
            (max(left, end), right, UNSTABLE_COLOUR if grows_soon else SLOW_COLOUR)
            for (left, right), (_, grows_soon) in zip(pairwise(edges), steps, strict=True)
        ]
        for left, right, colour in parts:
            if right > left:
                (bar,) = axes.barh(place, right - left, left=left, height=0.62, color=colour)
                bar.set(linewidth=0, edgecolor="white", hatch=_HATCHES.get(colour, ""))
    for verdict, properties in _MARKS.items():
        x = [row.run.step_size for row in rows if _seen(row) == verdict]
        axes.plot(x, [place] * len(x), label=f"_{verdict}", **properties)
    x = [row.run.step_size for row in rows if _differs(row)]
    axes.plot(x, [place] * len(x), label="_differs", **_DIFFERENCE)


def _mark(marker: str, colour: str, face: str, size: float, edge: float = 1.0) -> dict[str, Any]:
    own = {"marker": marker, "color": colour, "markerfacecolor": face}
    return {**own, "linestyle": "none", "markersize": size, "markeredgewidth": edge}


_MARKS = {
    "stable": _mark("o", INK, "white", 4.5),
    "unstable": _mark("x", INK, INK, 5.0)
    | {"path_effects": [withStroke(linewidth=2.5, foreground="white")]},
    "unknown": _mark("|", GUIDE_COLOUR, "none", 4.0),
}
_GROWTH = _mark("o", GUIDE_COLOUR, GUIDE_COLOUR, 4.0)
_DIFFERENCE = _mark("s", COLOURS[1], "none", 9.0, 1.4)
_SMALL_DIFFERENCE = _mark("s", COLOURS[1], "none", 5.0, 1.4)


def _seen(row: StabilityRow) -> str:
    return "unknown" if row.observation is None else row.observation.verdict


def _differs(row: StabilityRow) -> bool:
    return row.observation is not None and row.observation.agrees is False


def _draw_growth(axes: Axes, style: MethodLook, rows: Sequence[StabilityRow]) -> None:
    """Predicted growth as a line from its begin; marks of what was measured, or else predicted."""
    growing = [row for row in rows if row.prediction.growth_per_step > 0]
    seen = [
        (row.run.step_size, (row.observation or row.prediction).growth_per_step) for row in growing
    ]
    properties = replace(style.look, size=4.5 if style.look.is_filled else 6.0).properties()
    if not style.look.is_filled:
        # what is full is seen through what is hollow
        properties |= {"markerfacecolor": "none", "zorder": 5}
    line = _predicted_growth(axes, rows)
    axes.plot(*line, label=style.label, **{**properties, "marker": ""})
    axes.plot(*np.array(seen).T, label="_seen", **{**properties, "linestyle": "none"})


def _predicted_growth(axes: Axes, rows: Sequence[StabilityRow]) -> Array:
    """Steps and growth per step, between the examined steps as well, down to where it begins."""
    run, begin = rows[0].run, rows[0].lasting_step
    final_time, low = run.experiment.problem.final_time, axes.get_xlim()[0]
    examined = [row.run.n_steps for row in rows]
    between = np.geomspace(min(examined), final_time / max(np.nan_to_num(begin), low), _POINTS)
    # over a longer time steps need not divide the scene's own
    longer = replace(run.scene, final_time=LASTING * final_time)
    counts = {*np.rint(LASTING * between).astype(int).tolist(), *(LASTING * n for n in examined)}
    found = [
        (longer.final_time / n, growth)
        for n in sorted(counts, reverse=True)
        if (growth := predict_stability(longer, run.method, n).growth_per_step) > 0
    ]
    # below the last step without growth there is none
    start = [(begin, axes.get_ylim()[0])] if begin < found[0][0] else []
    return np.array([*start, *found]).T


def _mark_row(axes: Axes, place: int, style: MethodLook) -> None:
    """Show the line of a method in the lower panel next to its bar."""
    axes.plot(
        _KEY,
        [place] * 3,
        markevery=[1],
        transform=axes.get_yaxis_transform(),
        clip_on=False,
        label="_key",
        **DECORATION,
        **replace(style.look, size=3.5).properties(),
    )


def _patches(fillings: Mapping[str, str]) -> list[Patch | Line2D]:
    """Legend entries for colours."""
    return [
        Patch(facecolor=colour, label=words, edgecolor="white", hatch=_HATCHES.get(colour, ""))
        for colour, words in fillings.items()
    ]


def _observed_entries(table: StabilityTable, seen: Sequence[Line2D]) -> list[Line2D]:
    """Legend entries for observations, if there are any."""
    is_observed = any(row.observation is not None for row in table.rows)
    differs = Line2D([], [], label="not as predicted", **_DIFFERENCE)
    return [*(seen if is_observed else ()), *([differs] if table.disagreements else ())]


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
    seen = Line2D([], [], linestyle="none", marker=".", color=INK, label="unstable in a long run")
    limit = Line2D([], [], color=INK, linewidth=1.3, label="all modes stable below")
    found = {_kind(row) for row in table.rows}
    fillings = {colour: kind for kind, colour in _COLOURS.items() if kind in found}
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
    entries = [*_patches(fillings), *([limit] if len(keys) == 1 else ())]
    entries += _observed_entries(table, [seen])
    legend_of(figure, entries, title=words)
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
    """Draw cells of verdicts, a line for the largest stable step, and differing observations."""
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
    if len(keys) == 1:
        limits = {a: row.lasting_step for row, a in zip(rows, across, strict=True)}
        line = np.array([limits[a] for a in x])
        axes.plot(x, line, color=INK, linewidth=1.3, label="all modes stable below")
    places = np.array([across, up])
    seen = places[:, [_seen(row) == "unstable" for row in rows]]
    axes.plot(*seen, ".", markersize=1.8, color=INK, label="_unstable")
    other = places[:, [_differs(row) for row in rows]]
    axes.plot(*other, label="_differs", **_SMALL_DIFFERENCE)
    axes.set_xlim(x_edges[0], x_edges[-1])
    axes.set_ylim(y_edges[0], y_edges[-1])


def _kind(row: StabilityRow) -> str:
    """The key of the colour of a cell."""
    kinds = list(_COLOURS)
    if row.verdict == "stable":
        return kinds[row.prediction.growth_per_step > row.prediction.exact_growth]
    return kinds[2 if row.verdict == "unstable" else 3]


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
