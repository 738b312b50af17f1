"""The basic kinds of figures, from plain values: curves over time, log-log ladders, planes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox, TransformedBbox

from fvi_cli.plotting.curves import (
    HIDDEN,
    MOST_POINTS,
    PEAK,
    Curve,
    Panel,
    draw_hidden,
    draw_marks,
    looks,
    merge_alike,
)
from fvi_cli.plotting.looks import Look, colour_of, colours_of
from fvi_cli.plotting.slopes import explain
from fvi_cli.plotting.style import (
    COLOURS,
    INK,
    MARKERS,
    fill_band,
    hatch_rounding,
    journal_style,
    label_axis,
    label_size,
    legend_of,
    new_figure,
    panel_grid,
    small,
    wrap,
)
from fvi_cli.plotting.ticks import (
    clear_factor,
    ends_of,
    few_numbers,
    limit_ladder,
    limit_over_time,
    plain_numbers,
    reach_numbers,
    three_numbers,
    widen,
)

MOST_LINES = 6
"""Up to so many members of a sweep have names in the legend."""
MOST_COLOURED = 100
"""Up to so many members have a line with a colour of a bar; more members become bands."""
_MARKS, _FEWEST_MARKS = 12, 4  # on one curve
_BANDS = ((0.0, 100.0, "all members", 0.15), (5.0, 95.0, "9 of 10 members", 0.3))
_OF_HIDDEN = "pale: a line that lies under another; marks there in turn"
_ALPHAS = (0.3, 0.15)
"""Opacities of the bands of one curve, the inner one first."""


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

    Curves that look equal are drawn once, under their joint name. A colour `bar` of that name shows
    the numbers of curves. `title` is above the legend. `from_zero`: ordinates are sizes. `shared`:
    all panels have the same abscissas.
    """
    panels = [replace(one, remark=one.remark or one.gaps) for one in merge_alike(panels)]
    shares = {"sharex": shared, "sharey": columns > 1}

    def limit(axes: Axes, panel: Panel) -> None:
        limit_over_time(axes, panel)
        if not panel.is_log:
            three_numbers(axes.yaxis)
        own = [curve for one in (panels if shared else [panel]) for curve in one.curves]
        axes.set_xlim(*(span or ends_of(own)))
        if from_zero:
            axes.set_ylim(bottom=0.0)
        if logarithmic:
            axes.set_xscale("log")
            plain_numbers(axes.xaxis)
        elif span is None:
            reach_numbers(axes.xaxis)
        # no curve leaves the panel there: marks at its frame are whole
        sides = TransformedBbox(Bbox([[-1.0, -1.0 * from_zero], [2.0, 1.0]]), axes.transAxes)
        for line in axes.lines:
            line.set_clip_box(sides if line.get_marker() not in ("", "None") else axes.bbox)

    figure, used = _drawn(panels, limit, x=x, columns=columns, bar=bar, title=title, **shares)
    _clear_factors(figure, used, panels, columns)
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

    The region below a floor that a curve reaches is hatched. Triangles show the slopes that theory
    expects, or else observed ones; dashed triangles show orders that a source states. The legend is
    `above`, or below. `shared`: all panels have the same abscissas.
    """

    def limit(axes: Axes, panel: Panel) -> None:
        axes.set(xscale="log", yscale="log")
        limit_ladder(axes, panel.curves)

    options = {"nested": True, "above": above, "sharex": shared}
    figure, used = _drawn(panels, limit, x=x, columns=columns, bar=bar, title=title, **options)
    figure.draw_without_rendering()
    for axes, panel in zip(used, panels, strict=True):
        draw_marks(axes)
        if panel.has_slopes and not panel.is_ensemble:
            explain(axes, panel.curves)
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
        widen(axes, [curve for panel in panels for curve in panel.curves])
        if is_equal:
            axes.set_aspect("equal", adjustable="datalim")
        if most_ticks:
            few_numbers(axes, most_ticks)

    figure, used = _drawn(panels, limit, columns=columns, bar=bar, title=title, is_plane=True)
    _clear_factors(figure, used, panels, columns)
    return figure


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
    is_plane: bool = False,
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
    figure.draw_without_rendering()
    for axes, panel in zip(used, panels, strict=True):
        if colours is None and panel.has_slopes and not is_plane:
            draw_hidden(axes, is_ladder=nested)
    if any(line.get_label() == HIDDEN for axes in used for line in axes.lines):
        title = f"{title}\n{_OF_HIDDEN}".strip()
    entries = _legend_entries(panels, used)
    # an axis of the same numbers says which colour is which
    if colours is not None and all(panel.x != bar for panel in panels):
        _draw_bar(figure, used, colours, bar)
    if colours is not None:
        # lines are distinguished by their colours; marks and dashes of different kinds have names
        entries = [
            one
            for one in entries
            if isinstance(one, Line2D)
            and (len(entries) <= MOST_LINES or one.get_linestyle() == "None")
        ]
        for one in entries:
            one.set(color=INK, markerfacecolor=INK)
        entries = entries if len(entries) > 1 else []
    legend_of(figure, entries, title=title, above=above)
    return figure, used


def _draw_bar(figure: Figure, used: Sequence[Axes], colours: ScalarMappable, words: str) -> None:
    shown = figure.colorbar(colours, ax=list(used), location="top", aspect=40, pad=0.02)
    shown.set_label(wrap(words, figure.get_figwidth() - 0.6))
    shown.ax.set_gid("decoration")
    if isinstance(colours.norm, LogNorm):
        plain_numbers(shown.ax.xaxis)


def _draw_curves(axes: Axes, panel: Panel, colours: ScalarMappable | None, *, nested: bool) -> None:
    """Draw all curves of a panel; `nested`: with a mark at every point, small ones above large."""
    curves = panel.curves
    if colours is None and panel.is_ensemble and len(curves) > MOST_LINES:
        _draw_bands(axes, curves, marked=nested)
        return
    shown = looks(curves, marked=nested)
    for position, (curve, look) in enumerate(zip(curves, shown, strict=True)):
        properties = look.properties()
        if colours is not None:
            look = replace(
                curve.look or Look(colour="", width=0.6), colour=colour_of(colours, curve.by)
            )
            properties = look.properties()
        every = curve.stride() if look.has_line else 1
        xs, ys = curve.x[::every], np.where(np.isfinite(curve.y), curve.y, np.nan)[::every]
        for (label, *edges), alpha in zip(curve.bands, _ALPHAS, strict=False):
            fill_band(axes, xs, [one[::every] for one in edges], label, alpha, look.colour)
        # marks of different curves are at different points; of many curves none is at the first
        stride = max(1, xs.size // _MARKS, min(len(curves), xs.size // _FEWEST_MARKS))
        first = -(-(2 * position + 1) * stride // (2 * len(curves))) if stride > 1 else 0
        # round a hollow mark a full one is seen, but not below a full one; a cross hides neither
        above = 0.5 * (nested and not look.is_filled) + 0.3 * (nested and look.marker in "x12")
        above = above if look.has_line else 1.0
        if not nested and look.has_line and sum(other.has_line for other in shown) == 1:
            properties["marker"], properties["linestyle"] = "", "-"
        axes.plot(
            xs,
            ys,
            label=curve.label,
            gid=f"floor {curve.floor:.1e}" if curve.floor else None,
            markevery=curve.marked if nested or not look.has_line else (first, stride),
            zorder=2.0 if look.is_broad else 3 + 0.01 * position + above,
            rasterized=xs.size > MOST_POINTS,
            **properties,
        )
        if curve.peaks:
            # marks of several curves differ in shape, so that all are visible where peaks coincide
            several = sum(bool(one.peaks) for one in curves) > 1
            axes.plot(
                *np.array(curve.peaks).T,
                color=INK if colours is None and len(curves) == 1 else properties["color"],
                marker=MARKERS[position % len(MARKERS)] if several else "o",
                label=f"_{curve.label}" if several else "_peak",
                **PEAK,
            )
    if panel.rounding > 0:
        hatch_rounding(axes, 1e-300, panel.rounding)
    for level in panel.levels:
        line = axes.axhline(level, color="#888888", linewidth=0.5)
        line.set_gid("decoration")


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
        edges = np.nanpercentile(values, [low, high], axis=0)
        fill_band(axes, x, edges, label, alpha, COLOURS[0])
    median = np.nanmedian(values, axis=0)
    axes.plot(x, median, color="black", marker="o" if marked else "", label="median")


def _legend_entries(panels: Sequence[Panel], axes: Sequence[Axes]) -> list[Line2D | Patch]:
    """A legend entry for every name in the panels; none for a single curve without a peak."""
    entries: dict[str, Line2D | Patch] = {}
    size = rcParams["lines.markersize"]
    for line in (line for one in axes for line in one.lines):
        label = str(line.get_label())
        named = entries.get(label[1:]) if label.startswith("_") else None
        if isinstance(named, Line2D) and line.get_linestyle() == "None":
            # the name has a line in one panel and marks in another: the entry shows both
            named.set(marker=line.get_marker(), markersize=0.9 * size)
            named.set_markerfacecolor(line.get_markerfacecolor())
            named.set_markeredgecolor(line.get_markeredgecolor())
        known = entries.get(label)
        if isinstance(known, Line2D) and known.get_color() != line.get_color():
            known.set(color=INK, markeredgecolor=INK)
        if label.startswith("_") or known is not None:
            continue
        entries[label] = entry = Line2D([], [])
        entry.update_from(line)
        entry.set(label=label, markevery=None)
        if entry.get_markeredgecolor() == "white":
            entry.set_markeredgecolor(entry.get_color())  # an edge would cut a short line's dashes
    for label, alpha in {
        label: alpha
        for panel in panels
        for curve in panel.curves
        for (label, *_), alpha in zip(curve.bands, _ALPHAS, strict=False)
    }.items():
        entries[label] = Patch(facecolor=COLOURS[0], alpha=1.5 * alpha, label=label)
    if "median" in entries and any(panel.is_ensemble for panel in panels):
        for _, _, label, alpha in _BANDS:
            entries[label] = Patch(facecolor=COLOURS[0], alpha=1.5 * alpha, label=label)
    peaked = [sum(bool(curve.peaks) for curve in panel.curves) for panel in panels]
    if any(peaked):
        words, mark = ("marks: peaks", "") if max(peaked) > 1 else ("peak", "o")
        entries["peak"] = Line2D([], [], color=INK, label=words, marker=mark, **PEAK)
    return list(entries.values())


def _name_axes(
    figure: Figure,
    grid: Sequence[Sequence[Axes]],
    used: Sequence[Axes],
    panels: Sequence[Panel],
    x: str,
) -> None:
    """Label the axes of the panels, in lines that are no longer than the axes."""
    columns = len(grid)
    wide = _panel_width(figure, columns)
    for position, (axes, panel) in enumerate(zip(used, panels, strict=True)):
        if panel.title:
            lines = panel.title.split("\n")
            room = wide - 0.1 if columns > 1 else wide
            axes.set_title("\n".join(wrap(line, room, label_size()) for line in lines))
        if panel.remark:
            axes.set_title(panel.remark, loc="right", fontsize=small(), pad=2.5)
        if position % columns == 0 or panel.y != panels[position - 1].y:
            label_axis(axes.yaxis, panel.y, _panel_height(figure, panels, position, columns))
        # a shorter column would keep a gap open for its words
        is_lowest = position + columns >= len(panels) and any(
            axes is column[-1] for column in grid if len(column) == len(grid[0])
        )
        if panel.x or is_lowest:
            label_axis(axes.xaxis, panel.x or x, wide - 0.25 * (columns > 1))


def _panel_width(figure: Figure, columns: int) -> float:
    """Inches for labels above or below a panel."""
    return (figure.get_figwidth() - 0.6) / columns


def _panel_height(figure: Figure, panels: Sequence[Panel], position: int, columns: int) -> float:
    """Inches for labels beside a panel; a remark above the panel takes one line of them."""
    one = panels[position]
    factor = figure.get_figheight() / sum(panel.height for panel in panels[::columns])
    return 0.95 * one.height * min(factor, 1.0) - 1.6 * bool(one.remark) * small() / 72


def _clear_factors(
    figure: Figure, used: Sequence[Axes], panels: Sequence[Panel], columns: int
) -> None:
    """Move common factors of numbers into the labels, once it is known which numbers there are."""
    for position, axes in enumerate(used):
        clear_factor(axes.xaxis, _panel_width(figure, columns) - 0.25 * (columns > 1))
        clear_factor(axes.yaxis, _panel_height(figure, panels, position, columns))
