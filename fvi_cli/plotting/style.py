"""The style of figures: the packaged style sheet, a user's own style, sizes, legends."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

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


DECORATION: Mapping[str, Any] = {"scalex": False, "scaley": False}
"""Properties of lines without data: they do not change limits."""

_PER_INCH = 17.0  # letters of a label
_KEY = 9.0  # letters that the sample of a legend takes
_LINE = 0.16  # inches of a line of a legend
_OWN: ContextVar[str] = ContextVar("a style of matplotlib", default="default")


@contextmanager
def journal_style() -> Iterator[None]:
    """A context in which figures are made and drawn with the packaged sheet.

    A user's own settings file is left out; inside :func:`styled` that style takes precedence.
    """
    own = [] if _OWN.get() == "default" else [_OWN.get()]
    with style.context(["default", str(SHEET), *own]):
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
    width = mpl.rcParams["figure.figsize"][0]
    return Figure(figsize=(width, height * _scale()), layout="constrained")


def _scale() -> float:
    """Heights of figures, relative to those of the packaged sheet."""
    return float(mpl.rcParams["figure.figsize"][1]) / HEIGHT


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


def wrap(words: str, width: float) -> str:
    """The text in lines of about `width` inches; formulas and units stay whole."""
    lines = [""]
    for word in re.findall(r"(?:\$[^$]*\$|\([^()$]*\)|[^\s$])+", words):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and _letters(longer) > _PER_INCH * width:
            lines.append(word)
        else:
            lines[-1] = longer
    return "\n".join(lines)


def _letters(words: str) -> int:
    return len(re.sub(r"\\[a-z]+|[${}^_]", "", words))


def legend_of(
    figure: Figure, handles: Sequence[Artist], *, title: str = "", above: bool = True
) -> None:
    """One legend for all panels, above or below them."""
    if not handles:
        return
    width = figure.get_figwidth()
    labels = [wrap(str(one.get_label()), width - 0.6) for one in handles]
    longest = max(_letters(line) for label in labels for line in label.split("\n"))
    columns = max(1, min(len(labels), int(_PER_INCH * width / (longest + _KEY))))
    columns = -(-len(labels) // -(-len(labels) // columns))
    head = "\n".join(wrap(line, width) for line in title.split("\n"))
    lines = -(-len(labels) // columns) + sum(one.count("\n") for one in labels)
    lines += len(head.splitlines())
    figure.set_figheight(figure.get_figheight() + _LINE * lines * _scale())
    size = mpl.rcParams["legend.fontsize"]
    legend = figure.legend(
        handles=list(handles),
        labels=labels,
        loc="outside upper center" if above else "outside lower center",
        ncols=columns,
        title=head or None,
        title_fontsize=size,
    )
    legend.get_title().set_multialignment("center")


def note(axes: Axes, x: float, y: float, words: str, **properties: Any) -> Text:
    """Small text at a place in fractions of a panel."""
    own = {"fontsize": mpl.rcParams["legend.fontsize"], "ha": "center", "va": "center"}
    return axes.text(x, y, words, transform=axes.transAxes, **(own | properties))


def hatch_rounding(axes: Axes, low: float, level: float) -> None:
    """Hatch the region of round-off."""
    area = axes.axhspan(low, level, facecolor="none", edgecolor="#b0b0b0", hatch="/////")
    area.set(linewidth=0, zorder=0.5)
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
    note(axes, 0.97, 0.03, "round-off", ha="right", va="bottom", bbox=box)
