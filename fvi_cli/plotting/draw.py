"""Figures from panels: `figure` lays them out, and painters draw a panel into its axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from matplotlib import colormaps, rcParams
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullFormatter, NullLocator

from fvi_cli.plotting.panels import Cells, Curve, Panel
from fvi_cli.plotting.style import GREY, INK, PALE, STRIP, Look, cycled, journal_style
from fvi_cli.plotting.words import fraction_in_words, wrap

Painter = Callable[[Axes, Any], None]
Share = bool | Literal["row", "col"]

SMALL = 7.0  # points, of numbers in a panel
_WIDE = 178.0 / 85.0  # two columns of a journal, relative to one
_ROW = 2.0  # height in inches of ``figure.figsize`` in the packaged sheet
_PER_INCH = 17.0  # letters of a label
_LINE = 0.16  # inches of a line of a legend
_WIDTHS_AND_SIZES = ((1.5, 5.0), (0.8, 3.4))  # points; of the lowest and the highest curve
_MOST_CELLS, _MOST_ROWS = 12, 30  # of more columns and rows every n-th has a name
_BOX = 0.92  # height over width of every panel, so that slopes compare
_LOST, _EDGE = 0.06, 0.02  # shares of the panel for a row of lost runs, and around the rows
_CORNER, _RAY, _LONGER = (0.64, 0.05), 0.18, 0.06  # of the fan, as shares of the panel
_CLEAR = 0.08  # between the fan and the curves
DECADES = 60.0  # an axis that spans a smaller factor has ticks between the powers of 10


@journal_style()
def figure(
    panels: Sequence[Any],
    painter: Painter,
    *,
    columns: int = 1,
    height: float | Sequence[float] = 2.0,
    sharex: Share = False,
    sharey: Share = False,
    heading: str = "",
    bar: str = "",
    finish: Callable[[Sequence[Axes], Sequence[Any]], None] | None = None,
) -> Figure:
    """A figure of panels, row by row, one or two columns of a journal wide; None leaves a gap.

    `height` is in inches, of every row. The legend has this `heading`. A colour `bar` of that name
    shows the numbers of curves.
    """
    placed = [*panels, *[None] * (-len(panels) % columns)]
    count = len(placed) // columns
    heights = [height] * count if isinstance(height, int | float) else list(height)
    width, unit = rcParams["figure.figsize"]
    made = Figure(figsize=(width * (_WIDE if columns > 1 else 1.0), sum(heights) * unit / _ROW))
    made.set_layout_engine("constrained")
    grid = made.subplots(
        count, columns, squeeze=False, sharex=sharex, sharey=sharey, height_ratios=heights
    )
    places = enumerate(zip(grid.flat, placed, strict=True))
    used = [(k, *pair) for k, pair in places if pair[1] or pair[0].set_axis_off()]
    if bar:
        colours = _colours([panel for *_, panel in used])
        used = [(k, axes, _coloured(panel, colours)) for k, axes, panel in used]
        made.colorbar(colours, ax=list(grid.flat), aspect=30, label=wrap(bar, 40))
    for number, (place, axes, panel) in enumerate(used):
        row, column = divmod(place, columns)
        painter(axes, panel)
        letter = rf"$\mathbf{{{chr(97 + number % 26)}}}$  " if len(used) > 1 else ""
        axes.set_title(letter + panel.title)
        is_covered = sharex and place + columns < len(placed) and placed[place + columns]
        is_beside = column and placed[place - 1] and placed[place - 1].y == panel.y
        axes.tick_params(labelbottom=not is_covered)
        axes.set_xlabel(
            "" if is_covered else wrap(panel.x, _PER_INCH * made.get_figwidth() / columns)
        )
        label = "" if is_beside else wrap(panel.y, _PER_INCH * heights[row])
        axes.set_ylabel(label, linespacing=1.0)
    made.align_ylabels(grid)
    if finish:
        finish([axes for _, axes, _ in used], [panel for *_, panel in used])
    _add_legend(made, heading, is_right=columns == 2)
    return made


def _add_legend(made: Figure, heading: str, *, is_right: bool) -> None:
    """One legend of all panels, each label once, outside of them: right, or below."""
    found: dict[str, Any] = {}
    for axes in made.axes:
        handles, labels = axes.get_legend_handles_labels()
        found |= zip(labels, handles, strict=True)
    if len(found) < 2 and not heading:
        return
    letters, columns = (20, 1) if is_right else (int(18 * made.get_figwidth()), len(found))
    if not is_right:
        columns = max(1, min(letters // (max(map(len, found), default=0) + 9), columns))
        lines = -(-len(found) // columns) + bool(heading)
        made.set_figheight(made.get_figheight() + _LINE * lines)
    made.legend(
        list(found.values()),
        list(found),
        loc="outside right upper" if is_right else "outside lower center",
        ncols=columns,
        title=wrap(heading, letters) or None,
        alignment="left" if is_right else "center",
    )


def _colours(panels: Sequence[Panel]) -> ScalarMappable:
    """Colours for the numbers of curves, for their logarithms where they span a large factor."""
    numbers = [curve.by for panel in panels for curve in panel.curves]
    low, high = min(numbers), max(numbers)
    # the lightest colours would fade on paper
    shades = ListedColormap(colormaps[rcParams["image.cmap"]](np.linspace(0.0, 0.88, 256)))
    return ScalarMappable((LogNorm if high >= DECADES * low > 0 else Normalize)(low, high), shades)


def _coloured(panel: Panel, colours: ScalarMappable) -> Panel:
    """The panel with the colours of a bar, without labels."""
    curves = []
    for curve in panel.curves:
        look = curve.look or Look(colour=INK, width=0.7)
        colour = to_hex(tuple(np.ravel(colours.to_rgba(np.array([curve.by])))))
        curves.append(replace(curve, look=replace(look, colour=colour), label=""))
    return replace(panel, curves=curves)


def properties_of(curves: Sequence[Curve]) -> list[dict[str, Any]]:
    """Properties of lines: thick below and thin above, so that lines at one place are all seen."""
    looks = [curve.look or cycled(index) for index, curve in enumerate(curves)]
    count = sum(look.width is None for look in looks)
    usual = (rcParams["lines.linewidth"], rcParams["lines.markersize"])
    sizes = iter(np.linspace(*_WIDTHS_AND_SIZES, count) if count > 1 else [usual])
    return [look.properties(*(next(sizes) if look.width is None else usual)) for look in looks]


def draw_curves(axes: Axes, curves: Sequence[Curve]) -> None:
    """Lines with their bands, and points that stand out."""
    for curve, look in zip(curves, properties_of(curves), strict=True):
        for place, (label, low, high) in enumerate(reversed(curve.bands)):
            area = axes.fill_between(curve.x, low, high, color=look["color"], linewidth=0)
            area.set(alpha=0.18 * (place + 1), label=label)
        axes.plot(curve.x, curve.y, label=curve.label, **look)
        for x, y, text in curve.marks:
            note = axes.annotate(text, (x, y), (4, 1), textcoords="offset points", zorder=7)
            note.set(fontsize=SMALL, color=look["color"], va="bottom" if y >= 0 else "center")
            if not look["marker"]:
                (dot,) = axes.plot(x, y, "o", color=look["color"], markersize=4.2, clip_on=False)
                dot.set(markeredgecolor="white", zorder=6)
                note.set_bbox({"fc": axes.get_facecolor(), "alpha": 0.8, "pad": 0.3, "lw": 0})


def lines(axes: Axes, panel: Panel) -> None:
    """Curves over an abscissa or in a plane."""
    axes.set(**{f"{axis}scale": "log" for axis in panel.log})
    if panel.is_equal:
        axes.set_aspect("equal", adjustable="datalim")
    for level in panel.levels:
        axes.axhline(level, color=PALE, linewidth=0.8, zorder=0)
    draw_curves(axes, panel.curves)
    if panel.xlim:
        axes.set_xlim(*panel.xlim)
    if panel.ylim:
        axes.set_ylim(*panel.ylim)
    scale_log(axes)


def scale_log(axes: Axes) -> None:
    """Ticks of logarithmic axes: plain numbers between the powers where an axis is short."""
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        if axis.get_scale() == "log":
            axis.set_minor_formatter(NullFormatter())
            if high < DECADES * low:
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
                axis.set_major_formatter("{x:g}")


def ladder(axes: Axes, panel: Panel) -> None:
    """Marked lines over two logarithmic axes: every run is a marker on the line of its method."""
    axes.set(xscale="log", yscale="log")
    axes.set_box_aspect(_BOX)
    axes.margins(0.05)
    axes.grid(visible=True)
    draw_curves(axes, panel.curves)
    for curve in panel.curves:
        axes.update_datalim([(h, np.nan) for h in curve.lost], updatey=False)
    axes.autoscale_view()


def finish_ladders(axes: Sequence[Axes], panels: Sequence[Panel]) -> None:
    """Add what needs the final limits: the strips of lost runs and of the floor, and the fans."""
    losers = list(dict.fromkeys(c.label for p in panels for c in p.curves if len(c.lost)))
    share = _LOST * len(losers) + _EDGE if losers else 0.0
    raised = {}
    for one in axes:
        low, high = np.log10(one.get_ylim())
        raised[one] = (10**low, 10 ** (high + share / (1 - share) * (high - low)))
    for one, panel in zip(axes, panels, strict=True):
        one.set_ylim(raised[one])
        scale_log(one)
        if losers:
            _draw_lost(one, panel.curves, losers, share)
        bottom, top = raised[one]
        if panel.floor > bottom:
            # words outside of the axes would take their room
            level = min(panel.floor, top)
            one.axhspan(bottom, level, color=STRIP, zorder=0, linewidth=0)
            words = one.text(0.985, level, "floor", transform=one.get_yaxis_transform())
            words.set(color=GREY, fontsize=SMALL, ha="right", va="top")
        _draw_fan(one, panel)


def _draw_lost(axes: Axes, curves: Sequence[Curve], losers: Sequence[str], share: float) -> None:
    """A strip on top with a hollow mark for every run that has no error, a line a method."""
    low, high = np.log10(axes.get_ylim())
    limit = 10 ** (high - share * (high - low))
    strip = axes.fill_between([0, 1], 1 - share, 1, color=STRIP, transform=axes.transAxes)
    strip.set(zorder=0, linewidth=0)
    axes.yaxis.set_major_locator(FixedLocator([y for y in axes.get_yticks() if y < limit]))
    axes.yaxis.set_minor_locator(NullLocator())
    for curve, look in zip(curves, properties_of(curves), strict=True):
        if len(curve.lost):
            height = 1 - share * (losers.index(curve.label) + 0.5) / len(losers)
            look |= {"linestyle": "none", "markerfacecolor": "none", "markeredgewidth": 0.9}
            look["markeredgecolor"] = look["color"]
            at = axes.get_xaxis_transform()
            axes.plot(curve.lost, [height] * len(curve.lost), transform=at, **look)
    words = axes.text(0.985, 1 - share / 2, "diverged", transform=axes.transAxes)
    words.set(color=GREY, fontsize=SMALL, ha="right", va="center")


def _draw_fan(axes: Axes, panel: Panel) -> None:
    """Rays from one corner, close below the curves at the right: how steep an order is here."""
    (left, right), (low, high) = np.log10(axes.get_xlim()), np.log10(axes.get_ylim())
    band = max(0.0, math.log10(panel.floor) - low) / (high - low) if panel.floor else 0.0
    corner = np.array(_CORNER) - (0.08 * bool(panel.stated), -band)
    rays = sorted([(order, "") for order in panel.orders] + [(p, "stated") for p in panel.stated])
    ends = [np.array([1 / (right - left), order * _BOX / (high - low)]) for order, _ in rays]
    for number, end in enumerate(ends):
        end *= (_RAY + _LONGER * number) / np.hypot(*end) / np.array([1, _BOX])
    room = []
    for one in panel.curves:
        x, y = (np.log10([one.x, one.y]).T - (left, low)).T / [[right - left], [high - low]]
        for place in (np.zeros(2), *ends):
            reached = np.interp(corner[0] + place[0], x[y > 0], y[y > 0], np.nan, np.nan)
            room.append(reached - corner[1] - place[1] - _CLEAR)
    corner[1] += max(0.0, np.nanmin(room, initial=1.0)) if rays else 0.0
    for (order, source), end in zip(rays, ends, strict=True):
        (line,) = axes.plot(*zip(corner, corner + end, strict=True), transform=axes.transAxes)
        line.set(color=GREY, linewidth=0.8, zorder=1, linestyle="--" if source else "-")
        power = f"$h^{{{fraction_in_words(order)}}}$".replace("^{1}", "")
        words = f"{order:g} stated" if source else power
        note = axes.annotate(words, tuple(corner + end), (2.5, 0.0))
        note.set(color=GREY, fontsize=SMALL, va="center", ha="left")
        note.xycoords, note.anncoords = "axes fraction", "offset points"


def waterfall(axes: Axes, panel: Panel) -> None:
    """Curves one above the other, filled to their numbers `by`; lines where they have none."""
    if math.isnan(panel.curves[0].by):
        lines(axes, panel)
        return
    curves = sorted(panel.curves, key=lambda curve: curve.by)
    numbers, values = np.array([one.by for one in curves]), np.array([one.y for one in curves])
    up, down = np.maximum(values, 0.0), np.maximum(-values, 0.0)
    # the largest factor with which no line touches the one above it
    room = max(up.max(), down.max(), (up[:-1] + down[1:]).max(initial=0.0))
    lift = 0.85 * float(np.diff(numbers).min(initial=1.0)) / room if 0 < room < math.inf else 1.0
    shades = colormaps[rcParams["image.cmap"]](np.linspace(0.08, 0.78, numbers.size))
    for place, (curve, level) in enumerate(zip(curves, numbers, strict=True)):
        look = {"color": shades[place], "zorder": 2 + numbers.size - place}
        axes.fill_between(curve.x, level, level + lift * curve.y, alpha=0.25, linewidth=0, **look)
        axes.plot(curve.x, level + lift * curve.y, linewidth=0.9, **look)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlim(float(curves[0].x[0]), float(curves[0].x[-1]))
    is_whole = np.array_equal(numbers, numbers.round())
    ticks = MaxNLocator(8, integer=is_whole).tick_values(*numbers[[0, -1]])
    axes.set_yticks([tick for tick in ticks if numbers[0] <= tick <= numbers[-1]])
    _add_scale(axes, float(np.abs(values).max()), lift, numbers[0], panel.unit)


def _add_scale(axes: Axes, largest: float, lift: float, level: float, unit: str) -> None:
    """A bar of one round number beside the panel: the scale of displaced curves."""
    if not 0 < largest < math.inf:
        return
    power = 10.0 ** math.floor(math.log10(largest))
    value = max(n * power for n in (1, 2, 5) if n * power <= largest * (1 + 1e-9))
    at = axes.get_yaxis_transform()
    bar = axes.plot([1.02] * 2, [level, level + value * lift], transform=at, color=INK)[0]
    bar.set(linewidth=1.6, clip_on=False, solid_capstyle="butt")
    words = axes.text(1.035, level + value * lift / 2, f"{value:g} {unit}".strip(), transform=at)
    words.set(fontsize=SMALL, va="center")


def cells(axes: Axes, panel: Cells) -> None:
    """Coloured cells: a matrix with numbers in it, or a plane with logarithmic axes."""
    up, across = panel.kinds.shape
    shown = ListedColormap([colour for _, colour in panel.colours])
    x, y = (np.arange(across), np.arange(up)) if panel.plane is None else panel.plane
    mesh = axes.pcolormesh(x, y, panel.kinds, cmap=shown, shading="nearest")
    mesh.set(clim=(-0.5, len(panel.colours) - 0.5), rasterized=True)
    for kind in np.unique(panel.kinds):
        name, colour = panel.colours[int(kind)]
        axes.fill_between([], [], color=colour, label=name, linewidth=0)
    if panel.plane is not None:
        axes.set(xscale="log", yscale="log")
        return
    if across <= _MOST_CELLS:
        mesh.set(edgecolor="white", linewidth=1.2)
        for row, texts in enumerate(panel.texts):
            for column, text in enumerate(texts):
                axes.text(column, row, text, ha="center", va="center", fontsize=SMALL - 0.5)
    every, other = -(-across // _MOST_CELLS), -(-up // _MOST_ROWS)
    axes.set_xticks(range(0, across, every), panel.columns[::every])
    axes.set_yticks(range(0, up, other), panel.rows[::other])
    axes.invert_yaxis()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
