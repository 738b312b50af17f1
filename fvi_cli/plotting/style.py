"""The style of figures: the packaged style sheet, a user's style file, sizes, wrapped text."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont
from matplotlib.legend_handler import HandlerLine2D
from matplotlib.lines import Line2D
from matplotlib.text import Text

from fvi_cli.mathematics.arrays import Array

LineStyle = Literal["-"] | tuple[float, Sequence[float]]

SHEET = Path(__file__).with_name("fvi.mplstyle")
HEIGHT = 2.5
"""Height in ``figure.figsize`` of the sheet: inches of a figure with one panel."""
INK = "#1a1a1a"
GUIDE_COLOUR = "#666666"
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


DECORATION: Mapping[str, Any] = {"gid": "decoration", "scalex": False, "scaley": False}
"""Properties of lines without data: they do not change limits and are not compared."""

_FEW_ROWS = 3  # a legend with more rows has short samples of lines
_LINES = 1.05  # distance of lines, relative to their height in the sheet's font
_DOTS = 100.0  # dots per inch for measuring text; with few text gets broader
_OWN: ContextVar[str] = ContextVar("a style of matplotlib", default="default")


@functools.cache
def _sheet() -> mpl.RcParams:
    return mpl.rc_params_from_file(SHEET, use_default_template=False)


@contextmanager
def journal_style() -> Iterator[None]:
    """A context in which figures are made and drawn with the packaged sheet.

    A user's own settings file is left out; inside :func:`styled` that style takes precedence.
    """
    own = [] if _OWN.get() == "default" else [_OWN.get()]
    with style.context(["default", _sheet(), *own]):
        yield


@contextmanager
def styled(name: str) -> Iterator[None]:
    """A context in which figures follow a style of matplotlib: its name, or a file.

    All figures have the width of ``figure.figsize``, and heights scale with its height. Colours and
    marks of methods stay, since they identify methods.

    Raises
    ------
    OSError, ValueError
        Those of ``matplotlib.style.context``.
    """
    with style.context(name):
        pass
    token = _OWN.set(name)
    try:
        yield
    finally:
        _OWN.reset(token)


def new_figure(height: float) -> Figure:
    """An empty figure with automatic layout; `height` is in inches for the packaged sheet."""
    width, tall = mpl.rcParams["figure.figsize"]
    return Figure(figsize=(width, height * tall / HEIGHT), layout="constrained")


def panel_grid(
    figure: Figure, count: int, columns: int, **options: Any
) -> tuple[list[list[Axes]], list[Axes]]:
    """A grid of `count` panels: its columns from top to bottom, and all panels in order."""
    grid = figure.subplots(-(-count // columns), columns, squeeze=False, **options)
    for axes in grid.flat[count:]:
        axes.set_axis_off()
    for column in grid.T:
        # of shared axes the lowest used panel has the tick labels
        lowest = [axes for axes in column if axes.axison][-1]
        lowest.tick_params(labelbottom=True)
    return [[axes for axes in column if axes.axison] for column in grid.T], list(grid.flat[:count])


def small() -> float:
    """Size of legends, tick labels and notes, in points."""
    return float(FontProperties(size=mpl.rcParams["legend.fontsize"]).get_size_in_points())


@functools.lru_cache(maxsize=4096)
def _width(words: str, font: str, size: float) -> float:
    renderer: Any = RendererAgg(1, 1, _DOTS)  # type: ignore[no-untyped-call]
    prop = FontProperties(fname=font, size=size)
    return float(renderer.get_text_width_height_descent(words, prop, "$" in words)[0])


def text_width(words: str, size: float = 0.0) -> float:
    """Width in inches of the widest line; in `size` points, or :func:`small`."""
    font = findfont(FontProperties())
    return max(_width(line, font, size or small()) for line in words.split("\n")) / _DOTS


def wrap(words: str, width: float, size: float = 0.0) -> str:
    """The text in lines of at most `width` inches, as far as single words permit."""
    lines = [""]
    # not broken: a formula, a unit, and a number with the word before it
    for word in re.findall(r"(?:\$[^$]*\$|\([^()$]*\)|[^\s$]|(?<=\w) (?=\d+\b))+", words):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and text_width(longer, size) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return "\n".join(lines)


def label_size() -> float:
    """Size of the labels of axes, in points."""
    return float(FontProperties(size=mpl.rcParams["axes.labelsize"]).get_size_in_points())


def label_axis(axis: Axis, words: str, width: float) -> None:
    """Label an axis, in lines of at most `width` inches."""
    label = axis.set_label_text(wrap(words, width, label_size()))
    if "\n" in label.get_text():
        # a power in a lower line would touch the line above
        label.set_linespacing(1.2 if "^" in words else _LINES)


def legend_of(
    figure: Figure, handles: Sequence[Artist], *, title: str = "", above: bool = True
) -> None:
    """One legend for all panels, above or below them, in as many columns as fit."""
    if not handles:
        return
    width = figure.get_figwidth() - 0.15
    labels: list[str] = []
    dashed = [one for one in handles if isinstance(one, Line2D) and one.is_dashed()]
    is_long = any(one.get_marker() not in ("", "None") for one in dashed)  # dashes next to a mark
    for length, gap in (
        (mpl.rcParams["legend.handlelength"] + is_long, mpl.rcParams["legend.columnspacing"]),
        (1.5 + is_long, 0.8),
    ):
        line = (length + mpl.rcParams["legend.handletextpad"]) * small() / 72
        labels = [wrap(str(handle.get_label()), width - line) for handle in handles]
        widths = [text_width(label) + line for label in labels]
        columns = next(
            n
            for n in range(len(labels), 0, -1)
            if n == 1 or sum(map(max, _columns(widths, n))) + gap * small() / 72 * (n - 1) <= width
        )
        rows = -(-len(labels) // columns)
        if rows <= _FEW_ROWS:
            break
    # as few columns as fill the same rows
    columns = -(-len(labels) // rows)
    head = "\n".join(wrap(line, width) for line in title.split("\n"))
    lines = sum(max(label.count("\n") for label in row) + 1 for row in _columns(labels, rows))
    lines += len(head.splitlines())
    factor = mpl.rcParams["figure.figsize"][1] / HEIGHT
    figure.set_figheight(figure.get_figheight() + factor * lines * 1.45 * small() / 72)
    for one in dashed if is_long else ():
        # the mark hides the middle of a dash, and no dots; beside it are all of them
        _, dashes = one._unscaled_dash_pattern  # type: ignore[attr-defined]
        long = length * small() / one.get_linewidth()
        dashes = np.array(dashes) * min(1.0, long / (1.9 * sum(dashes)))
        one.set_linestyle((dashes[0] / 2 - long / 2, dashes.tolist()))
    widths = [one for one in handles if isinstance(one, Line2D) and one.get_marker() == "|"]
    at_ends = HandlerLine2D(marker_pad=0.0, numpoints=2)
    legend = figure.legend(
        handles=list(handles),
        handler_map=dict.fromkeys(widths, at_ends),
        labels=labels,
        loc="outside upper center" if above else "outside lower center",
        ncols=columns,
        handlelength=length,
        columnspacing=gap,
        title=head or None,
        title_fontsize=small(),
    )
    legend.get_title().set_multialignment("center")
    if "\n" in head:
        legend.get_title().set_linespacing(1.2 if "^" in head else _LINES)


def _columns(widths: Sequence[Any], count: int) -> list[Sequence[Any]]:
    """Entries of a legend column by column, as matplotlib distributes them."""
    size, more = divmod(len(widths), count)
    ends = [k * size + min(k, more) for k in range(count + 1)]
    return [widths[a:b] for a, b in itertools.pairwise(ends)]


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
) -> Text:
    """Small text at a place in fractions of a panel; `paper` (pad, alpha): on a white box."""
    box = None if paper is None else {"facecolor": "white", "edgecolor": "none", **paper}
    text = axes.text(x, y, words, transform=axes.transAxes, fontsize=small(), bbox=box)
    text.set(ha=ha, va=va, rotation=rotation)
    return text


def fill_band(
    axes: Axes, x: Array, edges: Iterable[Array], label: str, alpha: float, colour: str
) -> None:
    """Fill the region between two edges over x."""
    low, high = edges
    axes.fill_between(x, low, high, color=colour, alpha=alpha, linewidth=0)
    # comparisons with a stored figure use the numbers of the edges
    for edge, name in ((low, "least"), (high, "greatest")):
        axes.plot(x, edge, color=colour, linewidth=0.5, label=f"_{label}, {name}")


def hatch_rounding(axes: Axes, low: float, level: float) -> None:
    """Hatch the region of round-off."""
    area = axes.axhspan(low, level, facecolor="none", edgecolor="#b0b0b0", hatch="/////")
    area.set(linewidth=0, zorder=0.5)
    note(axes, 0.97, 0.03, "round-off", ha="right", va="bottom", paper={"pad": 1.0})
