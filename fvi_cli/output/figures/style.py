"""How figures look: sizes, fonts, and one colour, marker and line style for every method."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from fvi_cli.integrator.method import AnyMethod, Baseline, Method

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


@dataclass(frozen=True, kw_only=True)
class SeriesStyle:
    """Name, colour, marker and line style of one method in one figure."""

    label: str
    colour: str
    marker: str
    line_style: LineStyle


def series_styles(methods: Sequence[AnyMethod]) -> dict[str, SeriesStyle]:
    """Style of every method by its case, distinct in label, marker and colour or line style.

    BDF of order p has the p-th colour in every figure; what shares the convolution quadrature
    shares the colour, and differs in marker and line style.
    """
    distinct = {method.case: method for method in methods}
    labels = method_labels(list(distinct.values()))
    colours = _choose(distinct, _family, COLOURS)
    seen: dict[str, int] = {}
    shared = len({_family(method) for method in distinct.values()}) < len(distinct)
    markers = _choose(distinct, (lambda method: method.case) if shared else _family, MARKERS)
    styles: dict[str, SeriesStyle] = {}
    for case, method in distinct.items():
        family = _family(method)
        variant = seen.get(family, 0)
        seen[family] = variant + 1
        colour = colours[family]
        position = variant if shared else COLOURS.index(colour)
        while any(
            (style.colour, style.line_style) == (colour, LINE_STYLES[position % len(LINE_STYLES)])
            for style in styles.values()
        ) and position < len(LINE_STYLES):
            position += 1  # more methods than colours
        styles[case] = SeriesStyle(
            label=labels[case],
            colour=colour,
            marker=markers[case if shared else family],
            line_style=LINE_STYLES[position % len(LINE_STYLES)],
        )
    return styles


def _family(method: AnyMethod) -> str:
    if isinstance(method, Baseline):
        return method.name
    return f"{method.cq}-{method.degree}" if method.is_runge_kutta else method.cq


def _choose(
    methods: Mapping[str, AnyMethod], key: Callable[[AnyMethod], str], values: Sequence[str]
) -> dict[str, str]:
    """One value for every key: BDF p takes the p-th, the others what is left, then round again."""
    chosen: dict[str, str] = {}
    for method in methods.values():
        name = key(method)
        if name == getattr(method, "cq", None) and name.startswith("bdf"):
            chosen.setdefault(name, values[int(name[3:]) - 1])
    for method in methods.values():
        name = key(method)
        if name not in chosen:
            free = [value for value in values if value not in chosen.values()]
            chosen[name] = free[0] if free else values[len(chosen) % len(values)]
    return chosen


_FAMILY_NAMES = {"gauss": "Gauss", "radau-iia": "Radau IIA", "lobatto-iiic": "Lobatto IIIC"}


def method_labels(methods: Sequence[AnyMethod]) -> dict[str, str]:
    """Shortest label of every method, by case, that tells it from the others.

    Beside other people's methods ours say that they are variational integrators, as in
    ``FVI-BDF1CQ``.
    """
    beside_others = any(isinstance(method, Baseline) for method in methods)
    galerkin = [method for method in methods if isinstance(method, Method)]
    plain = [method for method in galerkin if not method.is_runge_kutta]
    told: list[_Feature] = [
        feature for feature in _ACTION if len({feature(method) for method in plain}) > 1
    ]
    for feature in _REST:
        if len(_names(galerkin, [*told, feature])) > len(_names(galerkin, told)):
            told.append(feature)
    labels = {}
    for method in methods:
        if isinstance(method, Baseline):
            labels[method.case] = method.name.replace("-", " ").replace("euler", "Euler")
            continue
        base = _base_label(method)
        if beside_others:
            base = f"FVI-{base.replace(' ', '')}CQ"
        labels[method.case] = ", ".join([base, *_told(method, told)])
    doubled = [label for label in labels.values() if list(labels.values()).count(label) > 1]
    return {case: case if label in doubled else label for case, label in labels.items()}


_Feature = Callable[[Method], str]


def _sampling(method: Method) -> str:
    return method.sampling


def _degree(method: Method) -> str:
    return f"$s={method.degree}$"


def _rule(method: Method) -> str:
    return f"{method.rule.points} {method.rule.rule.capitalize()}"


def _start(method: Method) -> str:
    if method.start != "weights":
        return "series start" if method.start == "series" else "plain start"
    if not method.start_exponents:
        return "starting weights"
    powers = ", ".join(f"$t^{{{fraction(e)}}}$" for e in method.start_exponents)
    return f"starting weights for {powers}"


def _forcing(method: Method) -> str:
    return f"{method.forcing_quadrature} forcing"


_ACTION: tuple[_Feature, ...] = (_sampling, _degree)
_REST: tuple[_Feature, ...] = (_rule, _start, _forcing)


def _told(method: Method, features: Sequence[_Feature]) -> list[str]:
    """What a label says of its method; a Runge-Kutta method brings degree and points along."""
    return [
        feature(method)
        for feature in (*_ACTION, *_REST)
        if (feature in features and not (method.is_runge_kutta and feature not in _REST[1:]))
        or (feature is _start and method.start == "weights")
    ]


def _names(methods: Sequence[Method], features: Sequence[_Feature]) -> set[tuple[str, ...]]:
    return {(_base_label(method), *_told(method, features)) for method in methods}


def common_features(methods: Sequence[AnyMethod]) -> str:
    """What all BDF methods of a figure have in common: degree, quadrature points, sampling."""
    plain = [m for m in methods if isinstance(m, Method) and not m.is_runge_kutta]
    if len({(m.degree, m.rule.label, m.sampling) for m in plain}) != 1:
        return ""
    method = plain[0]
    points = "point" if method.rule.points == 1 else "points"
    where = "nodes" if method.sampling == "nodes" else "quadrature points"
    return f"degree $s={method.degree}$, {_rule(method)} {points}, damping sampled at the {where}"


def fraction(value: float) -> str:
    """``5/2`` for 2.5, and the decimal number where no small denominator does."""
    nearest = Fraction(value).limit_denominator(12)
    return str(nearest) if abs(float(nearest) - value) < 1e-9 else f"{value:g}"


def _base_label(method: Method) -> str:
    if method.is_runge_kutta:
        return f"{_FAMILY_NAMES[method.cq]} {method.stages}"
    return f"BDF{method.bdf_order}"


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
