"""What accuracy costs, as a picture: time and work against the error, and who is cheapest."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from fvi_cli.plotting.methods import SeriesStyle, series_styles
from fvi_cli.plotting.style import (
    COLOURS,
    INK,
    SMALL_TEXT,
    TEXT_WIDTH,
    journal_style,
    legend_columns,
    new_figure,
)
from fvi_cli.reports.kinds.cost import curve_name
from fvi_cli.reports.naming import method_names
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.price import Curve, Point, cheapest_bands, cost_curves, pareto_front

BASELINE_COLOUR = "#8c8c8c"
FRONT_COLOUR = "#f2c14e"

_COARSEST, _FINEST = 3.0, 2e-15
_PANEL_HEIGHT = 2.9
_STRIP_SHARE = 0.1
_LETTER = 0.56 * SMALL_TEXT
"""Width of a letter in points."""


def cost_figure(tables: Sequence[CostTable]) -> Figure:
    """Set-up plus stepping time, and history operations, against the error reached.

    Accuracy grows to the right. The strip on top of a panel of times names the cheapest method at
    every accuracy; the broad line behind the curves is the Pareto front. Baselines are grey. Where
    no method sums over the past there is no panel of work.

    Parameters
    ----------
    tables
        Experiments, one below the other.
    """
    with journal_style():
        methods = {case.method.case: case.method for table in tables for case in table.cases}
        styles = _styles_by_curve(tables, series_styles(list(methods.values())))
        columns = 2 if any(table.has_memory for table in tables) else 1
        figure = new_figure(TEXT_WIDTH, _PANEL_HEIGHT * len(tables) + 0.75)
        panels = figure.subplots(len(tables), columns, squeeze=False)
        for table, row in zip(tables, panels, strict=True):
            curves = cost_curves(table)
            _draw_times(row[0], table, curves, styles)
            if columns == 1:
                continue
            if table.has_memory:
                _draw_work(row[1], curves, styles)
            else:
                row[1].set_axis_off()
        _legend(figure, styles)
        figure.draw_without_rendering()
        for table, row in zip(tables, panels, strict=True):
            _draw_bands(row[0], cost_curves(table), styles)
    return figure


def _styles_by_curve(
    tables: Sequence[CostTable], styles: Mapping[str, SeriesStyle]
) -> dict[str, SeriesStyle]:
    """Styles by key of the curve: baselines grey, methods of the package in colours of their own.

    A method by another route of its steps looks like the method, hollow and dotted. Colours go
    round only where there are more methods than colours; markers differ all the same.
    """
    found: dict[str, SeriesStyle] = {}
    markers = "osD^vPXh<>p*"
    fillings = {True: 0, False: 0}
    for table in tables:
        names = method_names([case.method for case in table.cases])
        for curve in cost_curves(table):
            if curve.key in found:
                continue
            style = styles[curve.methods[0].case]
            label = curve_name(curve, names)
            twin = found.get(curve.key.removesuffix("-direct"))
            if twin is not None:
                # another route of the same method: its mark, hollow and dotted
                found[curve.key] = dataclasses.replace(
                    twin, label=label, line_style=(0, (1, 1.2)), is_filled=False
                )
                continue
            k = fillings[curve.is_baseline]
            fillings[curve.is_baseline] += 1
            found[curve.key] = dataclasses.replace(
                style,
                label=label,
                colour=BASELINE_COLOUR if curve.is_baseline else COLOURS[k % len(COLOURS)],
                marker=markers[k % len(markers)],
                line_style=(0, (2.5, 1.2)) if curve.is_baseline else "-",
                is_filled=not curve.is_baseline,
            )
    return found


def _shown(point: Point) -> float:
    """An error of exactly 0 stands at the unit of round-off."""
    return max(point.error, point.row.floor / 100, 1e-300)


def _draw(
    axes: Axes,
    curves: Sequence[Curve],
    styles: Mapping[str, SeriesStyle],
    value: Callable[[Point], float],
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
    axes.xaxis.set_major_locator(LogLocator(base=100, numticks=12))
    axes.xaxis.set_minor_locator(LogLocator(base=10, numticks=30))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_locator(LogLocator(numticks=9))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _draw_front(axes: Axes, points: Sequence[tuple[float, float]]) -> None:
    """The Pareto front: what is reached for less is reached by it."""
    if not points:
        return
    errors, values = zip(*points, strict=True)
    axes.plot(
        errors,
        values,
        color=FRONT_COLOUR,
        linewidth=6,
        alpha=0.75,
        solid_capstyle="round",
        solid_joinstyle="round",
        label="_Pareto front",
        zorder=1,
    )


def _draw_times(
    axes: Axes, table: CostTable, curves: Sequence[Curve], styles: Mapping[str, SeriesStyle]
) -> None:
    _draw(axes, curves, styles, lambda point: point.seconds)
    front = [(_shown(p), p.seconds) for _, p in pareto_front(curves) if _shown(p) < _COARSEST]
    _draw_front(axes, front)
    axes.set_title(f"{table.experiment}, $T={table.final_time:g}$", loc="left")
    axes.set_title("on top: the cheapest method", loc="right", fontsize=SMALL_TEXT)
    axes.set_ylabel("set-up and stepping, seconds")
    axes.set_xlabel("error (more accurate to the right)")


def _draw_work(axes: Axes, curves: Sequence[Curve], styles: Mapping[str, SeriesStyle]) -> None:
    _draw(axes, curves, styles, lambda point: float(point.row.history_operations))
    worked = [
        (float(point.row.history_operations), _shown(point))
        for curve in curves
        if not curve.is_exact_by_chance
        for point in curve.points
        if point.row.history_operations > 0 and _shown(point) < _COARSEST
    ]
    front: list[tuple[float, float]] = []
    for operations, error in sorted(worked):
        if not front or error < front[-1][0]:
            front.append((error, operations))
    _draw_front(axes, front)
    axes.set_ylabel("multiply-adds on the history")
    axes.set_xlabel("error (more accurate to the right)")


def _draw_bands(axes: Axes, curves: Sequence[Curve], styles: Mapping[str, SeriesStyle]) -> None:
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
    # the last band ends where the last method does
    rated = [curve for curve in curves if not curve.is_exact_by_chance]
    best = min((p.error for c in rated for p in c.points if p.error > 0), default=fine)
    named: set[str] = set()
    for band in cheapest_bands(curves, min(coarse, 1.0), max(fine, best)):
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
            gid="decoration",
            scalex=False,
            scaley=False,
            zorder=0.5,
        )
        middle, height = (left + right) / 2, bottom + _STRIP_SHARE / 2
        short = style.label
        if _LETTER * len(short) < (right - left) * points - 2:
            axes.text(
                middle,
                height,
                short,
                transform=axes.transAxes,
                ha="center",
                va="center",
                fontsize=SMALL_TEXT,
                color=INK,
            )
        elif band.curve.key not in named:
            properties = style.line_properties()
            properties["linestyle"] = (0, (1, 1))
            axes.plot(
                [middle],
                [height],
                transform=axes.transAxes,
                label="_cheapest",
                gid="decoration",
                scalex=False,
                scaley=False,
                **properties,
            )
        named.add(band.curve.key)
    axes.yaxis.set_minor_locator(NullLocator())


def _legend(figure: Figure, styles: Mapping[str, SeriesStyle]) -> None:
    handles = [
        Line2D([], [], label=style.label, **style.line_properties()) for style in styles.values()
    ]
    handles.append(
        Line2D([], [], color=FRONT_COLOUR, linewidth=6, alpha=0.75, label="Pareto front")
    )
    labels = [str(handle.get_label()) for handle in handles]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=legend_columns(labels, TEXT_WIDTH)
    )
