"""The style of figures: the packaged sheet, a user's own style, and the looks of curves."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from matplotlib import style

from fvi_cli.errors import RequestError
from fvi_cli.integrator.method import BASELINE_NAMES, AnyMethod, Baseline

SHEET = Path(__file__).with_name("fvi.mplstyle")
INK, GREY, PALE, STRIP = "#222222", "#777777", "#c9c9c9", "#f1f1f1"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LineStyle = str | tuple[float, Sequence[float]]

_own: ContextVar[str | None] = ContextVar("a style of matplotlib", default=None)
# colours get darker with the order or the number of stages: BDF cold, Gauss warm; in the BDF ramp
# the least CIE distance is 25, and 18, 14, 12 for deutan, protan and tritan readers
_RAMPS: Mapping[str, Sequence[str]] = {
    "bdf": ("#4FB36B", "#3A9BDC", "#1A2F75", "#7A3FA0", "#D9609F", "#2A0A38"),
    "gauss": ("#F5B94A", "#E8762D", "#C8321F", "#86123A", "#4A0A2C", "#9C7A6B"),
    "lobatto-iiic": ("#B5BD62", "#8A9436", "#636B14", "#3E4400"),
}
_MARKERS = "os^DvPX<>p"
_BASELINES = (("x", "#9a9a9a"), ("+", "#6e6e6e"), ("d", "#8a8a8a"), ("p", "#4a4a4a"))
_DASHES: Sequence[LineStyle] = ("-", (0, (4, 1.6)), (0, (6, 1.4, 1, 1.4)), (0, (1, 1.2)))


@contextmanager
def journal_style() -> Iterator[None]:
    """A context in which figures are made and saved with the packaged sheet.

    A user's own settings file is left out; inside :func:`styled` that style takes precedence.
    """
    own = _own.get()
    with style.context(["default", str(SHEET), *([own] if own else [])]):
        yield


@contextmanager
def styled(name: str) -> Iterator[None]:
    """A context in which figures follow a style of matplotlib: its name, or a file.

    Raises
    ------
    RequestError
        If matplotlib does not know it, or refuses what it says.
    """
    try:
        with style.context(name):
            pass
    except (OSError, ValueError) as error:
        raise RequestError(f"style: {error}") from None
    token = _own.set(name)
    try:
        yield
    finally:
        _own.reset(token)


@dataclass(frozen=True, kw_only=True)
class Look:
    """Colour, marker and dashes of a curve; width and size come from its place in the panel."""

    colour: str
    marker: str = ""
    dashes: LineStyle = "-"
    is_hollow: bool = False
    width: float | None = None  # points; 0: no line
    size: float | None = None

    def properties(self, width: float, size: float) -> dict[str, Any]:
        """Keyword arguments of a line; `width` and `size` where the look has none of its own."""
        is_open = self.is_hollow or self.marker in ("x", "+", "|")
        size = size if self.size is None else self.size
        return {
            "color": self.colour,
            "linestyle": "none" if self.width == 0 else self.dashes,
            "linewidth": width if self.width is None else self.width,
            "marker": self.marker,
            "markersize": size,
            "markerfacecolor": "white" if self.is_hollow else self.colour,
            "markeredgecolor": self.colour if is_open else "white",
            "markeredgewidth": 0.9 if is_open else 0.5 if size > 3 else 0.0,
        }


EXACT = Look(colour=PALE, width=3.2)
BLACK = Look(colour=INK)


def cycled(index: int) -> Look:
    """The look of the curve number `index` of a panel where curves have none of their own."""
    dashes = _DASHES[index // len(COLOURS) % len(_DASHES)]
    return Look(colour=COLOURS[index % len(COLOURS)], dashes=dashes)


def dots(colour: str, size: float) -> Look:
    """Points without a line."""
    return Look(colour=colour, marker="o", width=0, size=size)


def method_words(methods: Sequence[AnyMethod]) -> dict[str, dict[str, Any]]:
    """Label and look of the curve of every method by its case; looks are the same in every figure.

    The label is the family, and how the method differs in it. Colour and marker belong to family
    and order or stages; methods that differ otherwise have dashes. Where all are of one family,
    each has a colour of its own, and every other one hollow marks.
    """
    distinct = {method.case: method for method in methods}
    counts = Counter(method.family for method in distinct.values())
    parts = {case: re.split(r", (?!t\^)", method.variant) for case, method in distinct.items()}
    seen: Counter[str] = Counter()
    words = {}
    for index, (case, method) in enumerate(distinct.items()):
        # greys are alike: baselines differ by their dashes
        is_grey = isinstance(method, Baseline)
        place = BASELINE_NAMES.index(case) if is_grey else seen[method.family]
        seen[method.family] += 1
        look = replace(_look(method), dashes=_DASHES[place % len(_DASHES)])
        if len(counts) == 1 < len(distinct):
            look = replace(cycled(index), marker=_MARKERS[index % 10], is_hollow=index % 2 == 1)
        alike = [parts[other] for other in distinct if distinct[other].family == method.family]
        own = [part for part in parts[case] if part and not all(part in one for one in alike)]
        label = re.sub(r"t\^([\d.]+)", r"$t^{\1}$", ", ".join([method.family, *own]))
        words[case] = {"label": label, "look": look}
    return words


def _look(method: AnyMethod) -> Look:
    if isinstance(method, Baseline):
        marker, colour = _BASELINES[BASELINE_NAMES.index(method.name)]
        return Look(colour=colour, marker=marker)
    ramp = _RAMPS.get(method.cq, _RAMPS["bdf"])
    index = method.degree - 1 if method.is_runge_kutta else method.bdf_order - 1
    return Look(colour=ramp[min(index, len(ramp) - 1)], marker=_MARKERS[min(index, 9)])
