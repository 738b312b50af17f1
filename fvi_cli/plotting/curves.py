"""What a picture is drawn of: curves, and panels of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.looks import EXACT, Look
from fvi_cli.plotting.style import COLOURS, LINE_STYLES, MARKERS

FEW_POINTS = 2001
"""Points of a line up to which all are drawn; of more as many as its form needs."""
MOST_POINTS = 20_000
"""Points of a line up to which files hold them all; a longer one is a picture in them."""
_VISIBLE = 2e-3  # of the extent of a line: less is one line to the eye
_SAME = 0.02  # of a panel's height: less is one line to the eye


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Points, what they are called, and what is marked among them."""

    x: Array  # shape ``(n,)``; nan where there is nothing to draw
    y: Array
    label: str = ""  # its entry in the legend
    by: float = math.nan  # a number that a colour bar shows in place of the label
    look: Look | None = None  # None: by its place among the curves of the panel
    peaks: Sequence[tuple[float, float]] = ()  # points that are marked by crosses
    # regions around it: what they are, and their lower and upper edges over x
    bands: Sequence[tuple[str, Array, Array]] = ()
    lost: Sequence[tuple[float, str]] = ()  # abscissas without a value, with what happened
    # slope that theory expects (one, or one for every point) and that the source states; nan: none
    order: float | Array = math.nan
    stated: float = math.nan
    floor: float = 0.0  # values below are round-off

    def stride(self) -> int:
        """Which points of a long line are drawn: every so many, as its form allows."""
        every = max(1, self.x.size // FEW_POINTS)
        while every > 1 and self._bends_between(every):
            every //= 2
        return every

    def _bends_between(self, every: int) -> bool:
        """Whether points that are left out lie visibly beside the line through the others."""
        place, kept = np.arange(self.x.size), np.arange(0, self.x.size, every)
        for values in (self.x, self.y):
            finite = np.isfinite(values[kept])
            if np.count_nonzero(finite) < 2:
                continue
            line = np.interp(place, kept[finite], values[kept][finite])
            distance = np.abs(values - line)[: kept[-1] + 1]
            size = float(np.ptp(values[np.isfinite(values)]))
            if np.any(distance[np.isfinite(distance)] > _VISIBLE * size):
                return True
        return False


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Curves that share their axes."""

    curves: Sequence[Curve]  # at least one
    y: str  # words beside the axes, with units
    x: str = ""
    title: str = ""  # above the panel, the remark in small letters on the right
    remark: str = ""
    height: float = 2.0  # inches, without legend and words
    is_log: bool = False  # whether the ordinate is logarithmic, where that is to be chosen
    is_ensemble: bool = False  # whether the curves are members of a sweep: of many there are bands
    has_slopes: bool = True  # whether triangles explain a ladder
    # whether a curve may leave the panel so that it does not press the others flat
    may_run_away: bool = False
    rounding: float = 0.0  # values below are hatched as round-off
    levels: Sequence[float] = ()  # dashed horizontal lines


def looks(curves: Sequence[Curve], *, marked: bool) -> list[Look]:
    """What every curve of a panel looks like: as it says, else by its place."""
    return [
        curve.look
        or Look(
            colour=COLOURS[k % len(COLOURS)],
            dashes=LINE_STYLES[k % len(LINE_STYLES)],
            marker=MARKERS[k % len(MARKERS)] if marked else "",
        )
        for k, curve in enumerate(curves)
    ]


def merge_alike(panels: Sequence[Panel]) -> list[Panel]:
    """Panels in which curves that coincide in all of them are one, with a joint label."""
    count = len(panels[0].curves)
    if any(p.is_ensemble or p.is_log or len(p.curves) != count for p in panels):
        return list(panels)
    groups: list[list[int]] = []
    for k in range(count):
        own = next((g for g in groups if all(_coincide(p, g[0], k) for p in panels)), None)
        if own is None:
            groups.append([k])
        else:
            own.append(k)
    return [
        replace(
            panel,
            curves=[
                replace(
                    panel.curves[group[-1]],
                    look=panel.curves[group[0]].look,
                    label=join_labels([panel.curves[k].label for k in group]),
                )
                for group in groups
            ],
        )
        for panel in panels
    ]


def _coincide(panel: Panel, first: int, second: int) -> bool:
    one, other = panel.curves[first], panel.curves[second]
    if EXACT in (one.look, other.look) or one.x.shape != other.x.shape:
        return False
    if not all(look is None or look.has_line for look in (one.look, other.look)):
        return False
    if not np.allclose(one.x, other.x, rtol=1e-9):
        return False
    there = np.isfinite(one.y)
    if not there.any() or not np.array_equal(there, np.isfinite(other.y)):
        return False
    a, b = one.y[there], other.y[there]
    return bool(np.abs(a - b).max() <= _SAME * np.ptp([a, b]))


def is_near(one: Curve, other: Curve) -> bool:
    """Whether marks of two ladders lie upon each other at half of their points or more."""
    shared, a, b = np.intersect1d(one.x, other.x, return_indices=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        distance = np.abs(np.log10(one.y[a] / other.y[b]))
    return bool(shared.size and np.mean(distance < 0.06) >= 0.5)


def join_labels(labels: Sequence[str]) -> str:
    """``BDF2 and BDF3, degree 1`` or ``BDF2, degrees 1 and 2`` for two names that share a part."""
    if len(labels) == 1:
        return labels[0]
    parts = [label.partition(", ")[::2] for label in labels]
    heads, tails = (
        list(dict.fromkeys(p[0] for p in parts)),
        list(dict.fromkeys(p[1] for p in parts)),
    )

    def listed(words: Sequence[str]) -> str:
        return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)

    if len(tails) == 1:
        return ", ".join(filter(None, (listed(heads), tails[0])))
    if len(heads) > 1:
        return "; ".join(labels)
    degrees = [tail.removeprefix("degree ") for tail in tails]
    are_degrees = all(degree.isdigit() for degree in degrees)
    return f"{heads[0]}, {f'degrees {listed(degrees)}' if are_degrees else listed(tails)}"
