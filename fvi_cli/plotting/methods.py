"""One colour, marker and line style for every method, the same in every figure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict

from matplotlib.colors import to_hex, to_rgb

from fvi_cli.integrator.method import BASELINE_NAMES, PEER_NAMES, AnyMethod, Baseline, Method
from fvi_cli.plotting.style import COLOURS, LINE_STYLES, LineStyle, fraction
from fvi_cli.reports.naming import describe_method, method_names

BASELINE_COLOURS = ("#8c8c8c", "#5c5c5c")

# BDF p has the p-th of these; Runge-Kutta families run from light to dark with their stages
_BDF_MARKERS = "os^DvP"
_STAGE_COLOURS: Mapping[str, Sequence[str]] = {
    "gauss": ("#B79FDB", "#8A5CC8", "#4B2A87", "#8B0037"),
    "radau-iia": ("#C79A6B", "#A0662D", "#7A4413", "#4A2600"),
    "lobatto-iiic": ("#B5BD62", "#8A9436", "#636B14", "#3E4400"),
}
_STAGE_MARKERS: Mapping[str, str] = {"gauss": "X<H>", "radau-iia": "*p8d", "lobatto-iiic": "*p8d"}
_BASELINE_MARKERS = "x+1234|"
# for methods that differ in more than convolution quadrature and degree
_FURTHER_MARKERS = "<>8dHp"


@dataclass(frozen=True, kw_only=True)
class SeriesStyle:
    """Name, colour, marker and line style of one method in one figure."""

    label: str
    colour: str
    marker: str
    line_style: LineStyle
    is_filled: bool = True

    def line_properties(self) -> LineProperties:
        """Keyword arguments of a line of this style, its label apart."""
        return {
            "color": self.colour,
            "linestyle": self.line_style,
            "marker": self.marker,
            "markerfacecolor": self.colour if self.is_filled else "white",
            # a white edge keeps filled marks apart that lie upon each other
            "markeredgecolor": "white" if self.is_filled else self.colour,
            "markeredgewidth": 0.5 if self.is_filled else 0.9,
        }


class LineProperties(TypedDict):
    """Properties of a matplotlib line."""

    color: str
    linestyle: LineStyle
    marker: str
    markerfacecolor: str
    markeredgecolor: str
    markeredgewidth: float


def series_styles(methods: Sequence[AnyMethod]) -> dict[str, SeriesStyle]:
    """Style of every method by its case, told apart in colour as well as in grey.

    Colour and marker belong to the convolution quadrature (with its stages), or to the baseline,
    and are the same in every figure; baselines are grey. Odd degrees are filled, even ones hollow,
    each with its own dashes. Methods that differ in something else get a darker shade and another
    marker, in the order of `methods`.
    """
    distinct = {method.case: method for method in methods}
    labels = method_labels(list(distinct.values()))
    seen: dict[tuple[str, int], int] = {}
    styles = {}
    for case, method in distinct.items():
        key = _kind(method)
        repeat = seen[key] = seen.get(key, -1) + 1
        styles[case] = _style(method, labels[case], repeat)
    return styles


def _kind(method: AnyMethod) -> tuple[str, int]:
    if isinstance(method, Baseline):
        return method.name, 0
    return method.cq, method.degree


def _style(method: AnyMethod, label: str, repeat: int) -> SeriesStyle:
    """Style of the method that is number `repeat`, from 0, of its quadrature and degree."""
    if isinstance(method, Baseline):
        index = (*BASELINE_NAMES, *PEER_NAMES).index(method.name)
        colour, marker, dashes = BASELINE_COLOURS[index % 2], _BASELINE_MARKERS[index], index + 1
        is_filled = False
    elif method.is_runge_kutta:
        index = method.stages - 1 - (method.cq == "lobatto-iiic")
        shades, markers = _STAGE_COLOURS[method.cq], _STAGE_MARKERS[method.cq]
        colour, marker = shades[min(index, len(shades) - 1)], markers[index % len(markers)]
        dashes, is_filled = 0, True
    else:
        index = method.bdf_order - 1
        colour, marker, dashes = COLOURS[index], _BDF_MARKERS[index], method.degree - 1
        is_filled = method.degree % 2 == 1
    if repeat:
        red, green, blue = (0.6**repeat * part for part in to_rgb(colour))
        colour = to_hex((red, green, blue))
        marker = _FURTHER_MARKERS[(index + repeat) % len(_FURTHER_MARKERS)]
    return SeriesStyle(
        label=label,
        colour=colour,
        marker=marker,
        line_style=LINE_STYLES[(dashes + 2 * repeat) % len(LINE_STYLES)],
        is_filled=is_filled,
    )


def method_labels(methods: Sequence[AnyMethod]) -> dict[str, str]:
    """Name of every method by case, as in tables, with powers typeset."""
    return {case: typeset(name.label) for case, name in method_names(methods).items()}


def typeset(name: str) -> str:
    """``weights $t^{5/2}$`` for ``weights t^2.5``."""
    return re.sub(r"t\^([\d.]+)", lambda power: f"$t^{{{fraction(float(power[1]))}}}$", name)


def common_features(methods: Sequence[AnyMethod]) -> str:
    """What all BDF methods of a figure have in common: degree, quadrature points, sampling.

    Where methods of other families are drawn as well, it says of which it speaks.
    """
    plain = [m for m in methods if isinstance(m, Method) and not m.is_runge_kutta]
    described = {", ".join(describe_method(method)[:3]) for method in plain}
    if len(described) != 1:
        return ""
    whose = ", ".join(dict.fromkeys(method.label for method in plain))
    return described.pop() if len(plain) == len(methods) else f"{whose}: {described.pop()}"
