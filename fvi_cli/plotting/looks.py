"""Looks of curves: a family of methods has a range of colours, an order its marker."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fvi_cli.integrator.method import BASELINE_NAMES, AnyMethod, Baseline
from fvi_cli.plotting.style import COLOURS, INK, PALE
from fvi_cli.plotting.words import typeset

LineStyle = str | tuple[float, Sequence[float]]

# colours get darker with the order or the number of stages: BDF cold, Gauss warm; in the BDF ramp
# the least CIE distance is 25, and 18, 14, 12 for deutan, protan and tritan readers
_RAMPS: Mapping[str, Sequence[str]] = {
    "bdf": ("#4FB36B", "#3A9BDC", "#1A2F75", "#7A3FA0", "#D9609F", "#2A0A38"),
    "gauss": ("#F5B94A", "#E8762D", "#C8321F", "#86123A", "#4A0A2C", "#9C7A6B"),
    "lobatto-iiic": ("#B5BD62", "#8A9436", "#636B14", "#3E4400"),
}
_MARKERS = "os^DvPX<>p"
_BASELINES = (("x", "#9a9a9a"), ("+", "#6e6e6e"), ("d", "#8a8a8a"), ("p", "#4a4a4a"))
DASHES: Sequence[LineStyle] = ("-", (0, (4, 1.6)), (0, (6, 1.4, 1, 1.4)), (0, (1, 1.2)))


@dataclass(frozen=True, kw_only=True)
class Look:
    """Colour, marker and dashes of a curve; width and size come from its place in the panel."""

    colour: str
    marker: str = ""
    dashes: LineStyle = "-"
    has_line: bool = True
    width: float | None = None  # points
    size: float | None = None

    def properties(self, width: float, size: float) -> dict[str, Any]:
        """Keyword arguments of a line; `width` and `size` where the look has none of its own."""
        is_open = self.marker in ("x", "+", "|")
        size = size if self.size is None else self.size
        return {
            "color": self.colour,
            "linestyle": self.dashes if self.has_line else "none",
            "linewidth": width if self.width is None else self.width,
            "marker": self.marker,
            "markersize": size,
            "markeredgecolor": self.colour if is_open else "white",
            "markeredgewidth": 0.9 if is_open else 0.5 if size > 3 else 0.0,
        }


EXACT = Look(colour=PALE, width=3.2)
BLACK = Look(colour=INK)


def cycled(index: int) -> Look:
    """The look of the curve number `index` of a panel where curves have none of their own."""
    dashes = DASHES[index // len(COLOURS) % len(DASHES)]
    return Look(colour=COLOURS[index % len(COLOURS)], dashes=dashes)


def method_names(methods: Sequence[AnyMethod]) -> dict[str, str]:
    """Names by case: the family where no other of these methods is of the same, else the label."""
    distinct = {method.case: method for method in methods}
    counts = Counter(method.family for method in distinct.values())
    return {
        case: typeset(method.label) if counts[method.family] > 1 else method.family
        for case, method in distinct.items()
    }


def method_looks(methods: Sequence[AnyMethod]) -> dict[str, Look]:
    """The look of every method by its case, the same in every figure.

    Colour and marker belong to the family and its order or stages; methods that differ otherwise
    have dashes. Where all methods are of one, each has a colour of its own.
    """
    distinct = {method.case: method for method in methods}
    seen: Counter[str] = Counter()
    looks = {}
    for case, method in distinct.items():
        repeat = seen[method.family]
        seen[method.family] += 1
        # greys are alike: baselines differ by their dashes
        place = BASELINE_NAMES.index(method.name) if isinstance(method, Baseline) else repeat
        looks[case] = replace(_look(method), dashes=DASHES[place % len(DASHES)])
    if len(seen) == 1 < len(looks):
        looks = {
            case: replace(cycled(k), marker=_MARKERS[k % len(_MARKERS)])
            for k, case in enumerate(looks)
        }
    return looks


def _look(method: AnyMethod) -> Look:
    if isinstance(method, Baseline):
        marker, colour = _BASELINES[BASELINE_NAMES.index(method.name) % len(_BASELINES)]
        return Look(colour=colour, marker=marker)
    ramp = _RAMPS.get(method.cq, _RAMPS["bdf"])
    index = method.degree - 1 if method.is_runge_kutta else method.bdf_order - 1
    return Look(
        colour=ramp[min(index, len(ramp) - 1)], marker=_MARKERS[min(index, len(_MARKERS) - 1)]
    )
