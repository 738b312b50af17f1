"""Curves, and panels of curves, from which figures are drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.style import COLOURS, LINE_STYLES, MARKERS


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Points with a name and a look, and the marks on them."""

    x: Array  # shape ``(n,)``; nan where there is nothing to draw
    y: Array
    label: str = ""  # its entry in the legend
    by: float = math.nan  # a number that a colour bar shows in place of the label
    look: Look | None = None  # None: by its place among the curves of the panel
    peaks: Sequence[tuple[float, float]] = ()  # points that are marked
    # regions around the curve: (name, lower edge, upper edge), the edges over x
    bands: Sequence[tuple[str, Array, Array]] = ()
    lost: Sequence[float] = ()  # step sizes of the runs without an error
    order: float = math.nan  # slope of theory, and the one that the source states; nan: none
    stated: float = math.nan
    floor: float = 0.0  # values below are round-off


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Curves that share their axes."""

    curves: Sequence[Curve]  # at least one
    y: str  # labels of the axes, with units
    x: str = ""
    title: str = ""  # above the panel; `remark` is above it on the right, in small letters
    remark: str = ""
    height: float = 2.0  # inches, without legend and labels
    is_log: bool = False  # whether the ordinate is logarithmic, if the kind of figure has a choice
    is_ensemble: bool = False  # whether the curves are members of a sweep; many become bands
    has_slopes: bool = True  # whether a fan shows the slopes of a ladder
    # whether a large curve may leave the panel, so that the others stay visible
    may_run_away: bool = False
    rounding: float = 0.0  # values below are hatched as round-off
    levels: Sequence[float] = ()  # thin horizontal lines


def looks(curves: Sequence[Curve], *, marked: bool) -> list[Look]:
    """The look of every curve of a panel: its own, or one by its place in the panel."""
    return [
        curve.look
        or Look(
            colour=COLOURS[k % len(COLOURS)],
            dashes=LINE_STYLES[k % len(LINE_STYLES)],
            marker=MARKERS[k % len(MARKERS)] if marked else "",
        )
        for k, curve in enumerate(curves)
    ]
