"""What accuracy costs, as a picture: time and work against the error, and who is cheapest."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from fvi_cli.plotting.methods import SeriesStyle, series_styles
from fvi_cli.plotting.style import (
    DECORATION,
    INK,
    SMALL_TEXT,
    few_decades,
    fraction,
    journal_style,
    legend_of,
    new_figure,
    note,
)
from fvi_cli.reports.kinds.cost import curve_name
from fvi_cli.reports.naming import method_names
from fvi_cli.studies.cost import CostRow, CostTable
from fvi_cli.studies.price import Band, Curve, cheapest_bands, cost_curves

FRONT_COLOUR = "#f2c14e"

_COARSEST, _FINEST = 3.0, 2e-15
_STRIP_SHARE = 0.1
_LETTER = 0.56 * SMALL_TEXT
"""Width of a letter in points."""

_SYMBOLS = (
    *(("sum ", r"\sum "), ("mu ", r"\mu "), ("gamma", r"\gamma"), ("omega", r"\omega")),
    *(("sin ", r"\sin "), ("eta ", r"\eta "), ("_tt", "_{tt}"), ("_ss", "_{ss}")),
)
_LONGEST_EQUATION = 48


def cost_figures(name: str, tables: Sequence[CostTable]) -> dict[str, Figure]:
    """A figure for every experiment of a configuration, by the name of its files."""
    names = cost_figure_names(name, tables)
    return {title: cost_figure(table) for title, table in zip(names, tables, strict=True)}


def cost_figure_names(name: str, tables: Sequence[CostTable]) -> list[str]:
    """Names of the files: of the configuration where it has one experiment, or of experiments."""
    if len(tables) == 1:
        return [f"{name}-cost"]
    return [f"{table.experiment}-cost" for table in tables]


def cost_figure(table: CostTable) -> Figure:
    """Set-up plus stepping time, and history operations, against the error reached.

    Accuracy grows to the right. The strip on top of the panel of times names the cheapest method
    at every accuracy, and the broad line behind the curves follows it. Baselines are grey. Stars
    are searches for a tolerance with all their runs. Where no method sums over the past there is no
    panel of work. A method that has nothing but round-off from the coarsest step on is exact by
    chance; it is named and not drawn.
    """
    with journal_style():
        everything = cost_curves(table)
        curves = [curve for curve in everything if not curve.is_exact_by_chance]
        styles = _styles_by_curve(table, curves)
        rows = 2 if table.has_memory else 1
        figure = new_figure(1.3 + 2.1 * rows + 0.17 * len(curves) / 2)
        panels = figure.subplots(rows, 1, squeeze=False, sharex=True)[:, 0]
        figure.suptitle(_title(table))
        _draw(panels[0], curves, styles, lambda point: point.seconds)
        bands = cheapest_bands(curves)
        _draw_front(panels[0], bands)
        panels[0].set_title("cheapest method:", loc="left", fontsize=SMALL_TEXT)
        panels[0].set_ylabel("set-up and stepping, seconds")
        if table.has_memory:
            _draw(panels[1], curves, styles, lambda point: float(point.history_operations))
            panels[1].set_ylabel("multiply-adds on the history")
        asked_for = _draw_asked_for(panels[0], table)
        panels[-1].set_xlabel("error (more accurate to the right)")
        chance = [curve for curve in everything if curve.is_exact_by_chance]
        _legend(figure, styles, _labels(table, chance), asked_for)
        figure.draw_without_rendering()
        _draw_bands(panels[0], bands, styles)
    return figure


def _title(table: CostTable) -> str:
    orders = ", ".join(fraction(float(g)) for g in table.gamma.split(";") if g != "-")
    below = (rf"$\gamma = {orders}$, " if orders else "") + f"$T = {table.final_time:g}$"
    equation = table.equation
    if len(equation) > _LONGEST_EQUATION:
        return below
    for word, symbol in _SYMBOLS:
        equation = equation.replace(word, symbol)
    return f"${equation}$\n{below}"


def _labels(table: CostTable, curves: Sequence[Curve]) -> list[str]:
    names = method_names([case.method for case in table.cases])
    return [curve_name(curve, names) for curve in curves]


def _styles_by_curve(table: CostTable, curves: Sequence[Curve]) -> dict[str, SeriesStyle]:
    """Styles by key of the curve; runs of one method by all tolerances are one curve."""
    styles = series_styles([case.method for case in table.cases])
    return {
        curve.key: dataclasses.replace(styles[curve.methods[0].case], label=label)
        for curve, label in zip(curves, _labels(table, curves), strict=True)
    }


def _shown(point: CostRow) -> float:
    """An error of exactly 0 stands at the unit of round-off."""
    return max(point.error, point.floor / 100, 1e-300)


def _draw(
    axes: Axes,
    curves: Sequence[Curve],
    styles: Mapping[str, SeriesStyle],
    value: Callable[[CostRow], float],
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for curve in curves:
        drawn = [point for point in curve.points if value(point) > 0 and _shown(point) < _COARSEST]
        style = styles[curve.key]
        axes.plot(
            [_shown(point) for point in drawn],
            [value(point) for point in drawn],
            label=style.label,
            **style.line_properties(),
            zorder=2.5 if curve.is_baseline else 3,
        )
    errors = [_shown(p) for c in curves for p in c.points]
    values = [value(p) for c in curves for p in c.points if value(p) > 0]
    fine = max(min(errors, default=1e-3), _FINEST)
    coarse = min(max(errors, default=1.0), _COARSEST)
    # accuracy grows to the right
    axes.set_xlim(coarse * 2, fine / 3)
    if values:
        axes.set_ylim(min(values) / 1.8, max(values) * 1.8)
    axes.xaxis.set_major_locator(LogLocator(base=1000, numticks=12))
    axes.xaxis.set_minor_locator(LogLocator(base=10, numticks=30))
    axes.xaxis.set_minor_formatter(NullFormatter())
    few_decades(axes.yaxis, 9)


def _draw_asked_for(axes: Axes, table: CostTable) -> list[Line2D]:
    """Searches for a tolerance, at the errors that they came to."""
    met = [row for row in table.by_tolerance if row.outcome == "met" and row.error > 0]
    if not met:
        return []
    seconds = [row.seconds for row in met]
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, min(seconds) / 1.8), max(high, max(seconds) * 1.8))
    errors = [max(row.error, _FINEST) for row in met]
    axes.set_xlim(None, min(axes.get_xlim()[1], min(errors) / 3))
    return axes.plot(
        errors,
        seconds,
        color=INK,
        marker="*",
        markersize=5,
        linestyle=(0, (1, 1)),
        linewidth=0.8,
        label="by tolerance",
        zorder=4,
    )


def _draw_front(axes: Axes, bands: Sequence[Band]) -> None:
    """The times of the cheapest method, band by band."""
    for band in bands:
        errors = np.geomspace(band.coarse, band.fine, 30)
        # an end belongs to the next band as well
        errors = errors[1:-1]
        axes.plot(
            errors,
            [band.curve.seconds_to(error) for error in errors.tolist()],
            color=FRONT_COLOUR,
            linewidth=6,
            alpha=0.75,
            solid_capstyle="butt",
            solid_joinstyle="round",
            label="_cheapest time",
            zorder=1,
        )


def _draw_bands(axes: Axes, bands: Sequence[Band], styles: Mapping[str, SeriesStyle]) -> None:
    """A strip at the top with the name, or where that has no room the mark, of the cheapest."""
    coarse, fine = axes.get_xlim()
    low, high = axes.get_ylim()
    axes.set_ylim(low, low * (high / low) ** (1 / (1 - _STRIP_SHARE)))
    extent = axes.get_window_extent()
    points = extent.width * 72.0 / axes.figure.dpi
    whole = math.log10(coarse / fine)

    def place(error: float) -> float:
        return math.log10(coarse / error) / whole

    bottom = 1 - _STRIP_SHARE
    axes.add_patch(
        Rectangle((0, bottom), 1, _STRIP_SHARE, transform=axes.transAxes, facecolor="#f4f4f4")
    )
    named: set[str] = set()
    for band in bands:
        style = styles[band.curve.key]
        left, right = place(band.coarse), place(band.fine)
        axes.add_patch(
            Rectangle(
                (left, bottom),
                right - left,
                _STRIP_SHARE,
                transform=axes.transAxes,
                facecolor=style.colour,
                edgecolor="white",
                linewidth=0.8,
                alpha=0.3,
            )
        )
        axes.plot(
            [right, right],
            [0, 1],
            transform=axes.transAxes,
            color="#bbbbbb",
            linewidth=0.5,
            label="_edge",
            **DECORATION,
            zorder=0.5,
        )
        middle, height = (left + right) / 2, bottom + _STRIP_SHARE / 2
        short = style.label
        if _LETTER * len(short) < (right - left) * points - 2:
            note(axes, middle, height, short)
        elif band.curve.key not in named:
            properties = style.line_properties()
            properties["linestyle"] = (0, (1, 1))
            axes.plot(
                [middle],
                [height],
                transform=axes.transAxes,
                label="_cheapest",
                **DECORATION,
                **properties,
            )
        named.add(band.curve.key)
    axes.yaxis.set_minor_locator(NullLocator())


def _legend(
    figure: Figure,
    styles: Mapping[str, SeriesStyle],
    chance: Sequence[str],
    asked_for: Sequence[Line2D],
) -> None:
    handles = [
        Line2D([], [], label=style.label, **style.line_properties()) for style in styles.values()
    ]
    handles += asked_for
    handles.append(Line2D([], [], color=FRONT_COLOUR, linewidth=6, alpha=0.75, label="cheapest"))
    title = f"exact here up to round-off, not drawn: {', '.join(chance)}" if chance else ""
    legend_of(figure, handles, title=title)
