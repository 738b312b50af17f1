"""How figures look: sizes, fonts, colours, ticks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, TypedDict

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

LineStyle = Literal["-"] | tuple[float, Sequence[float]]

COLUMN_WIDTH = 85 / 25.4
"""Width of every figure: one column of a journal, 85 mm, in inches."""

SMALL_TEXT = 8.0
"""Size of tick labels, legends and notes, points."""

INK = "#1a1a1a"
GUIDE_COLOUR = "#666666"

# Okabe and Ito, "Color universal design" (2008), without yellow, which paper swallows.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "h", "<", "p")
LINE_STYLES: tuple[LineStyle, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (6, 1.5, 1, 1.5)),
    (0, (1, 1.2)),
    (0, (6, 1.5, 1, 1.5, 1, 1.5)),
    (0, (2.5, 1.2)),
)
MARKER_SIZE = 4.0


class _Decoration(TypedDict):
    gid: str
    scalex: bool
    scaley: bool


DECORATION = _Decoration(gid="decoration", scalex=False, scaley=False)
"""Properties of lines that show no number: they move no limits, and no check compares them."""

# The fonts come with matplotlib, so that a figure looks the same on every machine.
_SETTINGS: Mapping[RcKeyType, object] = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.titlesize": 9.0,
    "axes.titlepad": 4.0,
    "figure.titlesize": 9.0,
    "figure.labelsize": 9.0,
    "xtick.labelsize": SMALL_TEXT,
    "ytick.labelsize": SMALL_TEXT,
    "legend.fontsize": SMALL_TEXT,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "legend.columnspacing": 1.2,
    "legend.handletextpad": 0.5,
    "legend.borderaxespad": 0.2,
    "axes.linewidth": 0.6,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "xtick.minor.size": 1.6,
    "ytick.minor.size": 1.6,
    "lines.linewidth": 1.1,
    "lines.markersize": MARKER_SIZE,
    "hatch.linewidth": 0.4,
    "axes.unicode_minus": True,
    "pdf.fonttype": 42,
    # text of an SVG as outlines, and names in it that are the same every time
    "svg.fonttype": "path",
    "svg.hashsalt": "fvi",
    "savefig.bbox": None,
    "figure.constrained_layout.h_pad": 0.03,
    "figure.constrained_layout.w_pad": 0.03,
}

# What a user's own settings file says of these must not change a committed figure.
_DRAWING_SETTINGS = (
    *("axes", "figure", "font", "grid", "hatch", "legend", "lines", "markers", "mathtext"),
    *("patch", "path", "pdf", "savefig", "svg", "text", "xtick", "ytick"),
)


# keys of a style file that are no matter of looks
_NOT_LOOKS = ("backend", "interactive", "toolbar", "timezone", "webagg", "tk", "keymap", "savefig")
_OWN: ContextVar[Mapping[RcKeyType, object]] = ContextVar(
    "settings of a style file", default=MappingProxyType({})
)


@contextmanager
def journal_style() -> Iterator[None]:
    """Within this context figures are made and drawn in the style of a printed journal.

    Within :func:`style_file` too, the settings of that file go before.
    """
    factory = {
        key: value
        for key, value in mpl.rcParamsDefault.items()
        if key.split(".")[0] in _DRAWING_SETTINGS and key not in _SETTINGS
    }
    with mpl.rc_context({**factory, **_SETTINGS, **_OWN.get()}):
        yield


@contextmanager
def style_file(path: Path) -> Iterator[None]:
    """Within this context figures follow a style file of matplotlib, where it says something.

    Colours and marks of methods stay, for they say which method is meant.

    Raises
    ------
    ValueError
        For a file that cannot be read, an unknown key, or a value that matplotlib refuses.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read as a style file: {error}") from None
    for number, line in enumerate(lines, start=1):
        key, colon, _ = line.split("#", 1)[0].partition(":")
        if key.strip() and not (colon and key.strip() in mpl.rcParams):
            raise ValueError(
                f"{path}, line {number}: {key.strip()!r} is not a setting of matplotlib; "
                "a line reads like `font.size: 8`"
            )
    try:
        found = mpl.rc_params_from_file(path, fail_on_error=True, use_default_template=False)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    looks = {key: value for key, value in found.items() if key.split(".")[0] not in _NOT_LOOKS}
    token = _OWN.set(looks)
    try:
        yield
    finally:
        _OWN.reset(token)


def own_style() -> str:
    """What a style file says here, in one line; empty without one."""
    return "; ".join(f"{key}: {value}" for key, value in sorted(_OWN.get().items()))


def new_figure(height: float) -> Figure:
    """Make an empty figure of one column that arranges itself, `height` in inches."""
    return Figure(figsize=(COLUMN_WIDTH, height), layout="constrained")


def panel_grid(
    figure: Figure, count: int, columns: int, *, sharex: bool = False, sharey: bool = False
) -> tuple[NDArray[np.object_], list[Axes]]:
    """Rows of at most so many panels: the grid of axes, and the `count` of them that are used.

    Parameters
    ----------
    figure
        Where they stand.
    count
        Number of panels; places behind the last one stay empty.
    columns
        Panels in a row.
    sharex, sharey
        Whether all have the same axis.
    """
    rows = -(-count // columns)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey)
    for axes in grid.flat[count:]:
        axes.set_axis_off()
    return grid, list(grid.flat[:count])


def lowest(grid: NDArray[np.object_]) -> list[Axes]:
    """Of every column of a grid the lowest panel that is used, with numbers along its axis."""
    found = [[axes for axes in column if axes.axison][-1] for column in grid.T]
    for axes in found:
        axes.tick_params(labelbottom=True)
    return found


def legend_above(figure: Figure, axes: Axes) -> None:
    """One legend above all panels, of what is labelled in `axes`."""
    legend_of(figure, axes.get_legend_handles_labels()[0], above=True)


def legend_of(
    figure: Figure, handles: Sequence[Artist], *, title: str = "", above: bool = False
) -> None:
    """One legend for all panels, below or above them, in as many columns as fit."""
    figure.legend(
        handles=list(handles),
        loc="outside upper center" if above else "outside lower center",
        ncols=legend_columns([str(handle.get_label()) for handle in handles]),
        title=title or None,
        title_fontsize=SMALL_TEXT,
    )


def note(
    axes: Axes,
    x: float,
    y: float,
    words: str,
    *,
    ha: str = "center",
    va: str = "center",
    paper: Mapping[str, float] | None = None,
    rotation: str = "horizontal",
) -> None:
    """Small words at a place in fractions of a panel; on white `paper` with its pad and alpha."""
    box = None if paper is None else {"facecolor": "white", "edgecolor": "none", **paper}
    text = axes.text(x, y, words, transform=axes.transAxes, fontsize=SMALL_TEXT, bbox=box)
    text.set(ha=ha, va=va, rotation=rotation)


def fraction(value: float) -> str:
    """``5/2`` for 2.5, and the decimal number where no small denominator does."""
    nearest = Fraction(value).limit_denominator(12)
    return str(nearest) if abs(float(nearest) - value) < 1e-9 else f"{value:g}"


def legend_columns(labels: Sequence[str], width: float = COLUMN_WIDTH) -> int:
    """Number of equal columns of a legend that fit into `width` inches, rows filled evenly."""
    longest = max(len(re.sub(r"[$^{}]", "", label)) for label in labels)
    entry = (0.45 * longest + 4.1) * SMALL_TEXT / 72
    columns = max(1, min(len(labels), int((width - 0.1) / entry)))
    return -(-len(labels) // -(-len(labels) // columns))


def few_decades(axis: Axis, number: int) -> None:
    """At most so many ticks with numbers on a logarithmic axis, none between decades."""
    axis.set_major_locator(LogLocator(numticks=number))
    axis.set_minor_formatter(NullFormatter())


def short_numbers(axis: Axis) -> None:
    """Numbers of three digits on a logarithmic axis, in place of powers."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    axis.set_minor_formatter(NullFormatter())


def logarithmic_ticks(axes: Axes, step_sizes: Sequence[float]) -> None:
    """Set ticks of a log-log panel that stay apart, for any number of decades."""
    low, high = axes.get_xlim()
    decades = [k for k in range(-30, 31) if low <= 10.0**k <= high]
    if len(decades) < 2:
        shown = sorted(set(step_sizes))
        stride = -(-len(shown) // 4)
        axes.xaxis.set_major_locator(FixedLocator(shown[::stride]))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        few_decades(axes.xaxis, 5)
    bottom, top = axes.get_ylim()
    if top / bottom > 1e2:
        few_decades(axes.yaxis, 8)
        if top / bottom > 1e8:
            axes.yaxis.set_minor_locator(NullLocator())
