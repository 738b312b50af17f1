"""Looks of lines, and a look for every method, which is the same in every figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib import colormaps, rcParams
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize, to_hex, to_rgb

from fvi_cli.integrator.method import BASELINE_NAMES, AnyMethod, Baseline, Method
from fvi_cli.plotting.style import COLOURS, LINE_STYLES, LineStyle
from fvi_cli.plotting.words import typeset

BASELINE_COLOURS = ("#8c8c8c", "#5c5c5c")

# BDF p has the p-th marker; colours of Runge-Kutta families get darker with the number of stages
_BDF_MARKERS = "os^DvP"
_STAGE_COLOURS: Mapping[str, Sequence[str]] = {
    "gauss": ("#B79FDB", "#8A5CC8", "#4B2A87", "#8B0037"),
    "lobatto-iiic": ("#B5BD62", "#8A9436", "#636B14", "#3E4400"),
}
_STAGE_MARKERS: Mapping[str, str] = {"gauss": "X<H>", "lobatto-iiic": "*p8d"}
_BASELINE_MARKERS = "xvdh"
# markers of methods with the same convolution quadrature and degree that differ otherwise
_FURTHER_MARKERS = "<>8dHp"


@dataclass(frozen=True, kw_only=True)
class Look:
    """Colour, marker, dashes and width of a line, or of marks without one."""

    colour: str
    marker: str = ""
    dashes: LineStyle = "-"
    has_line: bool = True
    is_filled: bool = True
    width: float | None = None
    size: float | None = None
    is_broad: bool = False  # whether it is broad, and so visible below other lines

    def properties(self) -> dict[str, Any]:
        """Keyword arguments of a line of this look."""
        # a white edge separates filled marks that overlap
        has_edge = self.is_filled and self.marker not in "x+.*|" and not self.is_broad
        sizes = {"linewidth": self.width, "markersize": self.size}
        return {
            "color": self.colour,
            "linestyle": self.dashes if self.has_line else "none",
            "marker": self.marker,
            "markerfacecolor": self.colour if self.is_filled else "white",
            "markeredgecolor": "white" if has_edge else self.colour,
            "markeredgewidth": 0.5 if self.is_filled else 0.9,
            **({"solid_capstyle": "butt"} if self.is_broad else {}),
            **{name: size for name, size in sizes.items() if size is not None},
        }


EXACT = Look(colour="#bdbdbd", width=4.0, is_broad=True)


@dataclass(frozen=True, kw_only=True)
class MethodLook:
    """The name of a method in a figure, and its look."""

    label: str
    look: Look


def method_looks(methods: Sequence[AnyMethod]) -> dict[str, MethodLook]:
    """Name and look of every method by its case, distinct in colour as well as in grey.

    Colour and marker depend on the convolution quadrature (with its stages) or the baseline, and
    are the same in every figure; baselines are grey. Marks of odd degrees are filled, of even
    degrees hollow; each degree has its own dashes. Methods that differ otherwise get another marker
    and a darker shade. If all methods would have one colour, each gets its own.
    """
    distinct = {method.case: method for method in methods}
    seen: dict[tuple[str, int], int] = {}
    found = {}
    for case, method in distinct.items():
        if isinstance(method, Baseline):
            key = (method.name, 0)
        else:
            # degrees 1 and 3 of BDF are both filled: one of them needs another marker
            key = (method.cq, method.degree if method.is_runge_kutta else method.degree % 2)
        repeat = seen[key] = seen.get(key, -1) + 1
        found[case] = MethodLook(label=typeset(method.label), look=_look(method, repeat))
    plain = [method for method in distinct.values() if isinstance(method, Method)]
    if len(plain) > 1 and len({method.cq for method in plain}) == 1 and not plain[0].is_runge_kutta:
        for index, method in enumerate(plain):
            own = found[method.case]
            colour = COLOURS[index % len(COLOURS)]
            found[method.case] = replace(own, look=replace(own.look, colour=colour))
    return found


def _look(method: AnyMethod, repeat: int) -> Look:
    """Look of the method that is number `repeat`, from 0, of its quadrature and degree."""
    if isinstance(method, Baseline):
        index = BASELINE_NAMES.index(method.name)
        colour, marker, dashes = BASELINE_COLOURS[index % 2], _BASELINE_MARKERS[index], index + 1
        is_filled = False
    elif method.is_runge_kutta:
        index = method.stages - 1 - (method.cq == "lobatto-iiic")
        shades, markers = _STAGE_COLOURS[method.cq], _STAGE_MARKERS[method.cq]
        colour, marker = shades[min(index, len(shades) - 1)], markers[index % len(markers)]
        # printed in grey, neighbouring lines differ by their dashes
        dashes, is_filled = (0, 2, 0, 1)[index % 4], True
    else:
        index = method.bdf_order - 1
        colour, marker, dashes = COLOURS[index], _BDF_MARKERS[index], method.degree - 1
        is_filled = method.degree % 2 == 1
    if repeat:
        red, green, blue = (0.6**repeat * part for part in to_rgb(colour))
        colour = to_hex((red, green, blue))
        marker = _FURTHER_MARKERS[(index + repeat) % len(_FURTHER_MARKERS)]
    return Look(
        colour=colour,
        marker=marker,
        dashes=LINE_STYLES[(dashes + 2 * repeat) % len(LINE_STYLES)],
        is_filled=is_filled,
    )


def colours_of(numbers: Sequence[float]) -> ScalarMappable:
    """Colours for numbers; for their logarithms if these are equidistant."""
    low, high, middle = min(numbers), max(numbers), float(np.median(numbers))
    is_log = low > 0 and high > 10 * low and middle**2 < (low * high) ** 0.5 * (low + high) / 2
    # the lightest colours would fade on paper
    colours = ListedColormap(colormaps[rcParams["image.cmap"]](np.linspace(0.0, 0.88, 256)))
    return ScalarMappable((LogNorm if is_log else Normalize)(low, high), colours)


def colour_of(colours: ScalarMappable, number: float) -> str:
    """The colour of a number at a bar."""
    return to_hex(tuple(np.atleast_2d(colours.to_rgba(np.array([number])))[0]))
