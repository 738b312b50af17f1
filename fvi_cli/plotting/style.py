"""How figures look: sizes, fonts, colours, ticks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

LineStyle = Literal["-"] | tuple[float, Sequence[float]]

COLUMN_WIDTH = 3.4
"""Width of one column of a journal, inches."""

TEXT_WIDTH = 7.0
"""Width of the text block of a journal, inches."""

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
    "savefig.bbox": None,
    "figure.constrained_layout.h_pad": 0.03,
    "figure.constrained_layout.w_pad": 0.03,
}

# What a user's own settings file says of these must not change a committed figure.
_DRAWING_SETTINGS = (
    *("axes", "figure", "font", "grid", "hatch", "legend", "lines", "markers", "mathtext"),
    *("patch", "path", "pdf", "savefig", "text", "xtick", "ytick"),
)


@contextmanager
def journal_style() -> Iterator[None]:
    """Within this context figures are made and drawn in the style of a printed journal."""
    factory = {
        key: value
        for key, value in mpl.rcParamsDefault.items()
        if key.split(".")[0] in _DRAWING_SETTINGS and key not in _SETTINGS
    }
    with mpl.rc_context({**factory, **_SETTINGS}):
        yield


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure that arranges itself, sizes in inches."""
    return Figure(figsize=(width, height), layout="constrained")


def fraction(value: float) -> str:
    """``5/2`` for 2.5, and the decimal number where no small denominator does."""
    nearest = Fraction(value).limit_denominator(12)
    return str(nearest) if abs(float(nearest) - value) < 1e-9 else f"{value:g}"


def legend_columns(labels: Sequence[str], width: float) -> int:
    """Number of equal columns of a legend that fit into `width` inches, rows filled evenly."""
    longest = max(len(label.replace("$", "")) for label in labels)
    entry = (0.45 * longest + 4.1) * SMALL_TEXT / 72
    columns = max(1, min(len(labels), int((width - 0.1) / entry)))
    return -(-len(labels) // -(-len(labels) // columns))


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
        axes.xaxis.set_major_locator(LogLocator(numticks=5))
        axes.xaxis.set_minor_formatter(NullFormatter())
    bottom, top = axes.get_ylim()
    if top / bottom > 1e2:
        axes.yaxis.set_major_locator(LogLocator(numticks=8))
        axes.yaxis.set_minor_formatter(NullFormatter())
        if top / bottom > 1e8:
            axes.yaxis.set_minor_locator(NullLocator())
