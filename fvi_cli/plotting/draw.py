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
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from fvi_cli.plotting.looks import Look, cycled
from fvi_cli.plotting.panels import Cells, Curve, Panel
from fvi_cli.plotting.style import INK, PALE, journal_style
from fvi_cli.plotting.words import wrap

Painter = Callable[[Axes, Any], None]
Share = bool | Literal["row", "col"]
Rows = Sequence[Sequence[Any]]

SMALL = 7.0  # points, of numbers in a panel
_WIDE = 178.0 / 85.0  # two columns of a journal, relative to one
_ROW = 2.0  # height in inches of ``figure.figsize`` in the packaged sheet
_PER_INCH = 17.0  # letters of a label
_LINE = 0.16  # inches of a line of a legend
_WIDTHS_AND_SIZES = ((1.5, 5.0), (0.8, 3.4))  # points; of the lowest and the highest curve
_STEPS = (1, 2, 4, 5, 10)  # ticks are at multiples of these
_ROUND_OFF = 1e-9  # variations below this share of the largest value
_RUN_AWAY = 10.0  # curves larger than the calmest one by this factor leave the panel
_MOST_CELLS, _MOST_ROWS = 12, 30  # of more columns and rows every n-th has a name
_DECADES = 60.0  # an axis that spans a smaller factor has ticks between the powers of 10


@journal_style()
def figure(
    rows: Rows,
    painter: Painter | Sequence[Painter],
    *,
    height: float | Sequence[float] = 2.0,
    is_wide: bool = False,
    sharex: Share = False,
    sharey: Share = False,
    legend: str = "",
    heading: str = "",
    bar: str = "",
    finish: Callable[[Sequence[Axes], Sequence[Any]], None] | None = None,
) -> Figure:
    """A figure of panels in rows and columns; an entry None is left empty.

    `painter` is one for all panels, or one for each row; `height` is in inches, of every row. The
    legend with its `heading` stands ``right`` of wide figures, otherwise ``below``. A colour `bar`
    of that name shows the numbers of curves.
    """
    heights = [height] * len(rows) if isinstance(height, int | float) else list(height)
    columns = len(rows[0])
    width, unit = rcParams["figure.figsize"]
    made = Figure(figsize=(width * (_WIDE if is_wide else 1.0), sum(heights) * unit / _ROW))
    made.set_layout_engine("constrained")
    grid = made.subplots(
        len(rows), columns, squeeze=False, sharex=sharex, sharey=sharey, height_ratios=heights
    )
    used = [
        (axes, panel, place)
        for place, (axes, panel) in enumerate(
            zip(grid.flat, [panel for row in rows for panel in row], strict=True)
        )
        if panel is not None or axes.set_axis_off()
    ]
    colours = _colours([panel for _, panel, _ in used]) if bar else None
    for number, (axes, panel, place) in enumerate(used):
        row, column = divmod(place, columns)
        paint = painter if callable(painter) else painter[row]
        paint(axes, panel if colours is None else _coloured(panel, colours))
        letter = rf"$\mathbf{{{chr(97 + number % 26)}}}$  " if len(used) > 1 else ""
        axes.set_title(letter + panel.title)
        is_covered = bool(sharex and row + 1 < len(rows) and rows[row + 1][column] is not None)
        is_beside = bool(sharey and column and rows[row][column - 1] is not None)
        axes.tick_params(labelbottom=not is_covered)
        axes.set_xlabel("" if is_covered else wrap(panel.x, _PER_INCH * width / columns))
        axes.set_ylabel("" if is_beside else wrap(panel.y, _PER_INCH * heights[row]))
    made.align_ylabels(grid)
    if finish:
        finish([axes for axes, _, _ in used], [panel for _, panel, _ in used])
    if colours is not None:
        made.colorbar(colours, ax=list(grid.flat), location="top", aspect=40, label=wrap(bar, 50))
    _add_legend(made, legend or ("right" if is_wide else "below"), heading, has_bar=bool(bar))
    return made


def _add_legend(made: Figure, where: str, heading: str, *, has_bar: bool) -> None:
    """One legend of all panels, each label once, outside of them."""
    found: dict[str, Any] = {}
    for axes in made.axes:
        handles, labels = axes.get_legend_handles_labels()
        found |= zip(labels, handles, strict=True)
    if len(found) < 2 and not (heading and not has_bar):
        return
    longest = max((len(label) for label in found), default=0)
    letters, columns = 20, 1
    place: Literal["outside right upper", "outside lower center"] = "outside right upper"
    if where == "below":
        letters, place = int(18 * made.get_figwidth()), "outside lower center"
        columns = max(1, min(letters // (longest + 9), len(found)))
        lines = -(-len(found) // columns) + bool(heading)
        made.set_figheight(made.get_figheight() + _LINE * lines)
    made.legend(
        list(found.values()),
        list(found),
        loc=place,
        ncols=columns,
        title=wrap(heading, letters) or None,
        alignment="left" if where == "right" else "center",
    )


def _colours(panels: Sequence[Any]) -> ScalarMappable:
    """Colours for the numbers of curves; for their logarithms where these are equidistant."""
    numbers = np.array([curve.by for panel in panels for curve in panel.curves])
    low, high, middle = numbers.min(), numbers.max(), np.median(numbers)
    is_log = low > 0 and high > 10 * low and middle**2 < (low * high) ** 0.5 * (low + high) / 2
    # the lightest colours would fade on paper
    shades = ListedColormap(colormaps[rcParams["image.cmap"]](np.linspace(0.0, 0.88, 256)))
    return ScalarMappable((LogNorm if is_log else Normalize)(low, high), shades)


def _coloured(panel: Any, colours: ScalarMappable) -> Any:
    """The panel with the colours of a bar; lines of members are thin and have no label."""
    curves = []
    for curve in panel.curves:
        look = curve.look or Look(colour=INK, width=0.7)
        colour = to_hex(tuple(np.ravel(colours.to_rgba(np.array([curve.by])))))
        curves.append(replace(curve, look=replace(look, colour=colour)))
    return replace(panel, curves=curves)


def properties_of(curves: Sequence[Curve]) -> list[dict[str, Any]]:
    """Properties of lines: thick below and thin above, so that lines at one place are all seen."""
    looks = [curve.look or cycled(index) for index, curve in enumerate(curves)]
    count = sum(look.width is None for look in looks)
    usual = (rcParams["lines.linewidth"], rcParams["lines.markersize"])
    sizes = iter(np.linspace(*_WIDTHS_AND_SIZES, count) if count > 1 else [usual])
    return [look.properties(*(next(sizes) if look.width is None else usual)) for look in looks]


def lines(axes: Axes, panel: Panel) -> None:
    """Curves over an abscissa or in a plane, with bands and points that stand out."""
    axes.set(
        xscale="log" if "x" in panel.log else "linear",
        yscale="log" if "y" in panel.log else "linear",
    )
    if panel.is_equal:
        axes.set_aspect("equal", adjustable="datalim")
    for level in panel.levels:
        axes.axhline(level, color=PALE, linewidth=0.6, zorder=0)
    for curve, look in zip(panel.curves, properties_of(panel.curves), strict=True):
        draw_bands(axes, curve, look["color"])
        axes.plot(curve.x, curve.y, label=curve.label, **look)
        for left, right, height in curve.spans:
            axes.plot([left, right], [height] * 2, "|-", color=INK, linewidth=0.8, markersize=4)
        for x, y, text in curve.marks:
            add_mark(axes, x, y, text, look["color"])
    scale_axes(axes, panel)


def draw_bands(axes: Axes, curve: Curve, colour: str) -> None:
    """Fill the regions around a curve."""
    for number, (label, low, high) in enumerate(curve.bands):
        alpha = 0.18 if number == len(curve.bands) - 1 else 0.36
        area = axes.fill_between(curve.x, low, high, color=colour, alpha=alpha, linewidth=0)
        area.set_label(label)


def add_mark(axes: Axes, x: float, y: float, text: str, colour: str) -> None:
    """A point that stands out, with a white edge, and its number."""
    axes.plot(
        x, y, "o", color=colour, markersize=4.2, markeredgecolor="white", zorder=6, clip_on=False
    )
    note = axes.annotate(text, (x, y), xytext=(5, 0), textcoords="offset points", zorder=7)
    note.set(fontsize=SMALL, color=colour, va="center")


def scale_axes(axes: Axes, panel: Panel) -> None:
    """Set the limits that the panel asks for, and few round ticks."""
    if panel.xlim:
        axes.set_xlim(*panel.xlim)
    if panel.ylim:
        axes.set_ylim(*panel.ylim)
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        if axis.get_scale() == "linear":
            largest = max(abs(low), abs(high))
            if high - low < _ROUND_OFF * largest:  # the round-off of a constant fills no panel
                middle = 0.5 * (low + high)
                axis.set_view_interval(middle - largest, middle + largest, ignore=True)
            axis.set_major_locator(MaxNLocator("auto", steps=_STEPS))
        else:
            scale_log(axis, low, high)


def scale_log(axis: Any, low: float, high: float) -> None:
    """Ticks of a logarithmic axis: plain numbers between the powers where it is short."""
    axis.set_minor_formatter(NullFormatter())
    if high < _DECADES * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
        axis.set_major_formatter("{x:g}")


def calm_limits(curves: Sequence[Curve]) -> tuple[float, float] | None:
    """Limits in which curves that run away do not hide the others; None where none does."""
    sizes = [float(np.nanmax(np.abs(curve.y), initial=0.0)) for curve in curves]
    moving = [size for size in sizes if size > _ROUND_OFF * max(sizes, default=0.0)]
    if not moving or max(moving) <= _RUN_AWAY * min(moving):
        return None
    shown = [c.y for c, size in zip(curves, sizes, strict=True) if size <= _RUN_AWAY * min(moving)]
    low, high = min(map(np.nanmin, shown)), max(map(np.nanmax, shown))
    return float(low - 0.6 * (high - low)), float(high + 0.6 * (high - low))


def waterfall(axes: Axes, panel: Panel) -> None:
    """Curves one above the other, each displaced at its number `by`, filled to it."""
    numbers = np.array([curve.by for curve in panel.curves])
    order = np.argsort(numbers)
    values = np.array([panel.curves[k].y for k in order])
    up, down = np.maximum(values, 0.0), np.maximum(-values, 0.0)
    # the largest factor with which no line touches the one above it
    room = max(up.max(), down.max(), (up[:-1] + down[1:]).max(initial=0.0))
    gap = float(np.diff(numbers[order]).min(initial=1.0))
    lift = 0.85 * gap / room if 0 < room < math.inf else 1.0
    shades = colormaps[rcParams["image.cmap"]](np.linspace(0.08, 0.78, len(numbers)))
    for place in range(len(numbers))[::-1]:
        curve, level = panel.curves[order[place]], numbers[order[place]]
        look = {"color": shades[place], "zorder": 2 + len(numbers) - place}
        axes.fill_between(curve.x, level, level + lift * curve.y, alpha=0.25, linewidth=0, **look)
        axes.plot(curve.x, level + lift * curve.y, linewidth=0.9, **look)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlim(float(panel.curves[0].x[0]), float(panel.curves[0].x[-1]))
    ticks = MaxNLocator(8, integer=panel.is_numbered).tick_values(*numbers[order[[0, -1]]])
    axes.set_yticks([tick for tick in ticks if numbers.min() <= tick <= numbers.max()])
    _add_scale(axes, float(np.abs(values).max()), lift, numbers[order[0]], panel.unit)


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
    shape = panel.kinds.shape
    shown = ListedColormap([colour for _, colour in panel.colours])
    x, y = (np.arange(shape[1]), np.arange(shape[0])) if panel.plane is None else panel.plane
    mesh = axes.pcolormesh(x, y, panel.kinds, cmap=shown, shading="nearest")
    mesh.set(clim=(-0.5, len(panel.colours) - 0.5), rasterized=True)
    for kind in np.unique(panel.kinds):
        name, colour = panel.colours[int(kind)]
        axes.fill_between([], [], color=colour, label=name, linewidth=0)
    if panel.plane is not None:
        axes.set(xscale="log", yscale="log")
        note = axes.text(0.05, 0.07, panel.note, transform=axes.transAxes, fontsize=SMALL)
        note.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0})
        return
    if shape[1] <= _MOST_CELLS:
        mesh.set(edgecolor="white", linewidth=1.2)
    for row, texts in enumerate(panel.texts if shape[1] <= _MOST_CELLS else ()):
        for column, text in enumerate(texts):
            axes.text(column, row, text, ha="center", va="center", fontsize=SMALL - 0.5)
    across, up = -(-shape[1] // _MOST_CELLS), -(-shape[0] // _MOST_ROWS)
    axes.set_xticks(range(0, shape[1], across), panel.columns[::across])
    axes.set_yticks(range(0, shape[0], up), panel.rows[::up])
    axes.invert_yaxis()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
