"""The basic kinds of figures, from plain values: curves over time, log-log ladders, planes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from fvi_cli.plotting.curves import Curve, Panel, looks
from fvi_cli.plotting.looks import EXACT, Look, colour_of, colours_of
from fvi_cli.plotting.slopes import draw_slopes, explain
from fvi_cli.plotting.style import (
    COLOURS,
    INK,
    hatch_rounding,
    journal_style,
    legend_of,
    new_figure,
    panel_grid,
    wrap,
)

MOST_LINES = 6
"""Up to so many members of a sweep have names in the legend."""
MOST_COLOURED = 100
"""Up to so many members have a line with a colour of a bar; more members become bands."""
ROUND_OFF = 1e-9
"""Variations below this share of the largest value count as round-off."""
_APART = 0.15  # distance of marks along a curve over time, as a share of the panel
_BANDS = ((0.0, 100.0, "all members", 0.15), (5.0, 95.0, "9 of 10 members", 0.3))
_ALPHAS = (0.3, 0.15)
"""Opacities of the bands of one curve, the inner one first."""
_DEEPEST = 1e-5  # least share of a median that is shown; smaller values are near a zero
# of several curves the first is thick with large marks, the last thin with small ones, so that both
# are seen where they coincide
_WIDTHS, _SIZES = (1.35, 0.75), (1.25, 0.85)


@journal_style()
def over_time(
    panels: Sequence[Panel],
    *,
    x: str,
    span: tuple[float, float] | None = None,
    bar: str = "",
    logarithmic: bool = False,
    title: str = "",
    columns: int = 1,
    from_zero: bool = False,
    shared: bool = True,
) -> Figure:
    """Draw panels one below the other over the same abscissa, which may be `logarithmic`.

    A colour `bar` of that name shows the numbers of curves. `title` is above the legend.
    `from_zero`: ordinates are sizes. `shared`: all panels have the same abscissas.
    """

    def limit(axes: Axes, panel: Panel) -> None:
        _limit_over_time(axes, panel)
        own = [curve for one in (panels if shared else [panel]) for curve in one.curves]
        places = np.concatenate([curve.x for curve in own])
        axes.set_xlim(*(span or (places.min(), places.max())))
        if from_zero:
            axes.set_ylim(bottom=0.0)
        if logarithmic:
            axes.set_xscale("log")

    shares = {"sharex": shared, "sharey": columns > 1}
    figure, used = _drawn(panels, limit, x=x, columns=columns, bar=bar, title=title, **shares)
    figure.align_ylabels(used)
    return figure


@journal_style()
def ladders(
    panels: Sequence[Panel],
    *,
    x: str = "step size $h$",
    columns: int = 1,
    bar: str = "",
    title: str = "",
    above: bool = True,
    shared: bool = False,
) -> Figure:
    """Draw log-log panels of errors, with runs without an error in a strip at the top.

    The region below a floor that a curve reaches is hatched. A fan shows the slopes that theory
    expects, dashed those that a source states. The legend is `above`, or below. `shared`: all
    panels have the same abscissas.
    """

    def limit(axes: Axes, panel: Panel) -> None:
        axes.set(xscale="log", yscale="log")
        _limit_ladder(axes, panel.curves)

    options = {"nested": True, "above": above, "sharex": shared}
    figure, used = _drawn(panels, limit, x=x, columns=columns, bar=bar, title=title, **options)
    figure.draw_without_rendering()  # the directions of slopes depend on the layout
    for axes, panel in zip(used, panels, strict=True):
        if not panel.is_ensemble:
            explain(axes, panel.curves)
        if not panel.is_ensemble and panel.has_slopes:
            draw_slopes(axes, panel.curves)
    return figure


@journal_style()
def plane(
    panels: Sequence[Panel],
    *,
    columns: int = 1,
    bar: str = "",
    title: str = "",
    is_equal: bool = False,
    most_ticks: int = 0,
) -> Figure:
    """Draw panels of one quantity against another; `is_equal`: both in the same unit of length."""

    def limit(axes: Axes, panel: Panel) -> None:
        _widen(axes, [curve for panel in panels for curve in panel.curves])
        if is_equal:
            axes.set_aspect("equal", adjustable="datalim")
        if most_ticks:
            axes.xaxis.set_major_locator(MaxNLocator(most_ticks))

    return _drawn(panels, limit, columns=columns, bar=bar, title=title)[0]


def _drawn(
    panels: Sequence[Panel],
    limit: Callable[[Axes, Panel], None],
    *,
    x: str = "",
    columns: int,
    bar: str,
    title: str,
    above: bool = True,
    nested: bool = False,
    **options: Any,
) -> tuple[Figure, list[Axes]]:
    """A figure with the curves, labels and legend of all panels; and its axes."""
    heights = [panel.height for panel in panels[::columns]]
    figure = new_figure(sum(heights) + 0.5)
    grid, used = panel_grid(figure, len(panels), columns, height_ratios=heights, **options)
    numbers = [curve.by for panel in panels for curve in panel.curves]
    colours = colours_of(numbers) if bar else None
    for axes, panel in zip(used, panels, strict=True):
        _draw_curves(axes, panel, colours, nested=nested)
    _name_axes(figure, grid, used, panels, x)
    for axes, panel in zip(used, panels, strict=True):
        limit(axes, panel)
    # an axis of the same numbers says which colour is which
    if colours is not None and all(panel.x != bar for panel in panels):
        shown = figure.colorbar(colours, ax=used, location="top", aspect=40, pad=0.02)
        shown.set_label(wrap(bar, figure.get_figwidth() - 0.6))
    legend_of(figure, _legend_entries(used, is_coloured=bool(bar)), title=title, above=above)
    return figure, used


def _draw_curves(axes: Axes, panel: Panel, colours: ScalarMappable | None, *, nested: bool) -> None:
    """Draw all curves of a panel; `nested`: with a mark at every point."""
    curves = panel.curves
    if colours is None and panel.is_ensemble and len(curves) > MOST_LINES:
        _draw_bands(axes, curves, marked=nested)
        return
    count = len(curves)
    shrunk = [np.linspace(*ends, count) if count > 1 else np.ones(1) for ends in (_WIDTHS, _SIZES)]
    shown = looks(curves, marked=nested)
    for position, (curve, look) in enumerate(zip(curves, shown, strict=True)):
        width, size = (float(one[position]) for one in shrunk)
        if colours is not None:
            look = replace(
                curve.look or Look(colour="", width=0.6), colour=colour_of(colours, curve.by)
            )
        properties = {
            "linewidth": width * rcParams["lines.linewidth"],
            "markersize": size * rcParams["lines.markersize"],
            **look.properties(),
        }
        for (label, *edges), alpha in zip(curve.bands, _ALPHAS, strict=False):
            _fill(axes, curve.x, edges, label, alpha, look.colour)
        if not nested and look.has_line and sum(other.has_line for other in shown) == 1:
            properties["marker"], properties["linestyle"] = "", "-"
        axes.plot(
            curve.x,
            np.where(np.isfinite(curve.y), curve.y, np.nan),
            label=curve.label,
            # marks of different curves over time are at different points
            markevery=None if nested or not look.has_line else (_APART * position / count, _APART),
            zorder=2.0 if look.is_broad else 3 + 0.01 * position,
            **properties,
        )
        if curve.peaks:
            axes.plot(
                *np.array(curve.peaks).T,
                "o",
                color=INK if colours is None and count == 1 else look.colour,
                label="peak",
                markersize=4.5,
                markerfacecolor="none",
                markeredgewidth=1.1,
                zorder=6,
            )
    if panel.rounding > 0:
        hatch_rounding(axes, 1e-300, panel.rounding)
    for level in panel.levels:
        axes.axhline(level, color="#888888", linewidth=0.5)


def _fill(axes: Axes, x: Any, edges: Sequence[Any], label: str, alpha: float, colour: str) -> None:
    axes.fill_between(x, *edges, color=colour, alpha=alpha, linewidth=0, label=label)


def _draw_bands(axes: Axes, curves: Sequence[Curve], *, marked: bool) -> None:
    """Draw the median of many members, and bands that hold 9 of 10 and all of them."""
    x = np.unique(np.concatenate([curve.x for curve in curves]))  # they may differ by round-off
    x = x[np.diff(x, prepend=-np.inf) > 1e-12 * np.abs(x)]
    values = np.full((len(curves), x.size), np.nan)
    for row, curve in zip(values, curves, strict=True):
        row[np.searchsorted(x, curve.x, side="right") - 1] = curve.y
    shown = np.isfinite(values).any(axis=0)
    values, x = values[:, shown], x[shown]
    for low, high, label, alpha in _BANDS:
        _fill(
            axes, x, list(np.nanpercentile(values, [low, high], axis=0)), label, alpha, COLOURS[0]
        )
    median = np.nanmedian(values, axis=0)
    axes.plot(x, median, color="black", marker="o" if marked else "", label="median")


def _legend_entries(used: Sequence[Axes], *, is_coloured: bool) -> list[Artist]:
    """An entry for every name in the panels, those of bands last."""
    found: dict[str, Artist] = {}
    for axes in used:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    entries = sorted(found.values(), key=lambda one: not isinstance(one, Line2D))
    if is_coloured:
        # the bar has the colours of members; marks and dashes of different kinds have names
        entries = [_in_ink(one) for one in entries if isinstance(one, Line2D)]
        entries = entries if 1 < len(entries) <= MOST_LINES else []
    return entries


def _in_ink(line: Line2D) -> Line2D:
    entry = Line2D([], [])
    entry.update_from(line)
    entry.set(label=line.get_label(), color=INK, markerfacecolor=INK, markevery=None)
    return entry


def _name_axes(
    figure: Figure,
    grid: Sequence[Sequence[Axes]],
    used: Sequence[Axes],
    panels: Sequence[Panel],
    x: str,
) -> None:
    """Label the axes of the panels, in lines that are about as long as the axes."""
    columns = len(grid)
    wide = (figure.get_figwidth() - 0.6) / columns
    for position, (axes, panel) in enumerate(zip(used, panels, strict=True)):
        if panel.title:
            axes.set_title("\n".join(wrap(line, wide) for line in panel.title.split("\n")))
        if panel.remark:
            axes.set_title(panel.remark, loc="right", fontsize=rcParams["legend.fontsize"], pad=2.5)
        if position % columns == 0 or panel.y != panels[position - 1].y:
            axes.set_ylabel(wrap(panel.y, panel.height))
        # a shorter column would keep a gap open for its words
        is_lowest = position + columns >= len(panels) and any(
            axes is column[-1] for column in grid if len(column) == len(grid[0])
        )
        if panel.x or is_lowest:
            axes.set_xlabel(wrap(panel.x or x, wide))


def _widen(axes: Axes, curves: Sequence[Curve]) -> None:
    """Widen the limits of constant curves, so that their round-off does not fill a panel."""
    for axis in ("x", "y"):
        values = np.concatenate([getattr(one, axis) for one in curves])
        largest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
        low, high = getattr(axes, f"get_{axis}lim")()
        if high - low < ROUND_OFF * largest:
            getattr(axes, f"set_{axis}lim")(low - 0.5 * largest, low + 0.5 * largest)


def _limit_over_time(axes: Axes, panel: Panel) -> None:
    """Set limits so that neither curves that run away nor zeros of an error hide the others."""
    exact = [curve for curve in panel.curves if curve.look is EXACT]
    ranges = [curve.y[np.isfinite(curve.y)] for curve in exact or panel.curves]
    if panel.is_log:
        ranges = [values[values > 0] for values in ranges]
    ranges = [values for values in ranges if values.size]
    if panel.is_log and ranges:
        axes.set_yscale("log", nonpositive="mask")
        middles = [float(np.median(values)) for values in ranges]
        high = min(max(values.max() for values in ranges), 1e3 * max(middles))
        low = max(min(float(values.min()) for values in ranges), _DEEPEST * min(middles))
        if panel.rounding:
            low, high = min(low, panel.rounding / 3), max(high, 30 * panel.rounding)
        axes.set_ylim(low / 2, high * 2)
    elif panel.may_run_away and ranges:
        values = np.concatenate(ranges)
        sizes = [float(np.abs(one).max()) for one in ranges]
        # leave out curves at rest, such as the force of a damper that a design lacks
        calmest = min(size for size in sizes if size >= ROUND_OFF * max(sizes))
        values = values[np.abs(values) <= 10 * calmest]
        low, high = float(values.min()), float(values.max())
        span = (high - low) or abs(high) or 1.0
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, low - 0.6 * span), min(top, high + 0.6 * span))


def _limit_ladder(axes: Axes, curves: Sequence[Curve]) -> None:
    """Fit the limits of a log-log panel to all steps and to the existing errors."""
    steps = [h for curve in curves for h in curve.x.tolist()]
    errors = np.concatenate([curve.y for curve in curves])
    errors = errors[np.isfinite(errors) & (errors > 0)]
    low, high = (errors.min(), errors.max()) if errors.size else (1e-2, 1.0)
    if high / low < 10:
        low, high = low / 3, high * 3
    margin = (high / low) ** 0.06
    side_margin = (max(steps) / min(steps)) ** 0.06 if len(set(steps)) > 1 else 2.0
    axes.set_xlim(min(steps) / side_margin, max(steps) * side_margin)
    axes.set_ylim(low / margin, high * margin)
    if not errors.size:
        # without errors: tick labels would suggest a measured range
        axes.set_yticks([])
        axes.set_yticks([], minor=True)
