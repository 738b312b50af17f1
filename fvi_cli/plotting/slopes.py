"""Explanations in a ladder: lost runs in a strip, the floor, and a fan of slopes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from fvi_cli.plotting.curves import Curve, looks
from fvi_cli.plotting.style import DECORATION, GUIDE_COLOUR, hatch_rounding
from fvi_cli.plotting.words import fraction_in_words

_ROW = 0.055  # share of the panel that a row of lost runs takes
_START = (0.6, 0.08)  # where the fan begins, as shares of the panel
_LENGTH = 0.2  # of its rays, as a share of the width


def explain(axes: Axes, curves: Sequence[Curve]) -> None:
    """Add lost runs and the floor to a panel whose limits are set."""
    _draw_lost(axes, curves)
    level = max((one.floor for one in curves if np.any(one.y < one.floor)), default=0.0)
    if level:
        hatch_rounding(axes, axes.get_ylim()[0], level)


def _draw_lost(axes: Axes, curves: Sequence[Curve]) -> None:
    """Draw hollow marks in a strip at the top, a row for each method with lost runs."""
    shown = zip(curves, looks(curves, marked=True), strict=True)
    rows = [(one, look) for one, look in shown if one.lost]
    share = _ROW * len(rows)
    if not rows:
        return
    low, high = axes.get_ylim()
    axes.set_ylim(low, low * (high / low) ** (1 / (1 - share)))
    strip = Rectangle((0, 1 - share), 1, share, transform=axes.transAxes, zorder=0)
    strip.set_facecolor("#f0f0f0")
    axes.add_patch(strip)
    for row, (one, look) in enumerate(rows):
        at = [1 - _ROW * (row + 0.5)] * len(one.lost)
        (line,) = axes.plot(
            one.lost, at, transform=axes.get_xaxis_transform(), **look.properties(), **DECORATION
        )
        line.set(label=f"_lost: {one.label}", linestyle="none", markerfacecolor="none")
        line.set(markeredgecolor=look.colour, markeredgewidth=0.8)


def draw_slopes(axes: Axes, curves: Sequence[Curve]) -> None:
    """Draw rays with the slopes of theory, and dashed those that the source states.

    They begin in the lower right corner, which is empty where errors fall with the steps.
    """
    expected = {one.order for one in curves if math.isfinite(one.order)}
    stated = {one.stated for one in curves if math.isfinite(one.stated)} - expected
    box = axes.get_window_extent()
    across, up = np.diff(np.log10([axes.get_xlim(), axes.get_ylim()]), axis=1).ravel()
    reached = max((one.floor for one in curves if np.any(one.y < one.floor)), default=0.0)
    low = axes.get_ylim()[0]
    band = math.log10(reached / low) / up if reached > low else 0.0
    start = np.array([_START[0], _START[1] + band])
    for order in sorted(expected | stated):
        step = np.array([box.width / across, order * box.height / up])
        end = start + _LENGTH * box.width * step / np.hypot(*step) / [box.width, box.height]
        (ray,) = axes.plot(*zip(start, end, strict=True), transform=axes.transAxes, **DECORATION)
        words = f"order {fraction_in_words(order)}" + " stated" * (order in stated)
        ray.set(color=GUIDE_COLOUR, linewidth=0.8, zorder=1.5, label=f"_{words}")
        ray.set_linestyle((0, (3, 1.5)) if order in stated else "-")
        power = f"$h^{{{fraction_in_words(order)}}}$" if order != 1 else "$h$"
        axes.annotate(
            power,
            xy=tuple(end),
            xycoords="axes fraction",
            xytext=(2, 0),
            textcoords="offset points",
            va="center",
            fontsize=rcParams["legend.fontsize"],
            color=GUIDE_COLOUR,
        )
