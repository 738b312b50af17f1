"""Curves, and panels of curves, from which figures are drawn."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.looks import EXACT, Look, pale
from fvi_cli.plotting.style import COLOURS, DECORATION, LINE_STYLES, MARKERS

FEW_POINTS = 2001
"""Up to so many points of a line all are drawn; of more only as many as its shape needs."""
MOST_POINTS = 20_000
"""Up to so many points a line is a vector graphic in files; a longer one is a bitmap."""
_VISIBLE = 2e-3  # smallest visible deviation, as a share of the extent of a line
_WIDTH, _LAYER = 1.1, 1.4  # points of a line; of one below another, broader by this
_ON_IT = 2.0 * _WIDTH  # points within which marks and lines hide others
_LEAST_DISTANCE = 3.0  # points between marks in turn that are seen beside each other
_IN_IT = 1.5  # of marks at one place, the lower is larger by this factor
PEAK: Mapping[str, Any] = {
    "linestyle": "none",
    "markersize": 4.5,
    "markerfacecolor": "none",
    "markeredgewidth": 1.1,
    "zorder": 6,
    "clip_on": False,
}
"""Properties of the mark at a peak."""
HIDDEN = "_hidden"
"""Label of the part of a line that other lines cover."""
_SAME = 0.5 * _WIDTH  # lines that differ by fewer points (of type) look like one


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
    lost: Sequence[tuple[float, str]] = ()  # pairs (abscissa without a value, status of the run)
    # slopes: of theory (one, or one for every point), and the one that the source states; nan: none
    order: float | Array = math.nan
    stated: float = math.nan
    floor: float = 0.0  # values below are round-off
    marked: Sequence[int] | None = None  # points of a ladder that have a mark; None: all

    def stride(self) -> int:
        """Number n such that every n-th point of a long line is drawn without visible change."""
        every = max(1, self.x.size // FEW_POINTS)
        while every > 1 and self._bends_between(every):
            every //= 2
        return every

    def _bends_between(self, every: int) -> bool:
        """Whether points that are left out visibly deviate from the line through the others."""
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
    y: str  # labels of the axes, with units
    x: str = ""
    title: str = ""  # above the panel; `remark` is above it on the right, in small letters
    remark: str = ""
    height: float = 2.0  # inches, without legend and labels
    is_log: bool = False  # whether the ordinate is logarithmic, if the kind of figure has a choice
    is_ensemble: bool = False  # whether the curves are members of a sweep; many become bands
    has_slopes: bool = True  # whether triangles show the slopes of a ladder
    # whether a large curve may leave the panel, so that the others stay visible
    may_run_away: bool = False
    rounding: float = 0.0  # values below are hatched as round-off
    levels: Sequence[float] = ()  # thin horizontal lines

    @property
    def gaps(self) -> str:
        """A remark where a logarithmic axis cannot show a value after the first."""
        is_broken = self.is_log and any(np.any(curve.y[1:] == 0) for curve in self.curves)
        return "gaps: exactly 0" if is_broken else ""


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


def merge_alike(panels: Sequence[Panel]) -> list[Panel]:
    """The panels, with one curve and a joint label for curves that coincide in all panels."""
    count = len(panels[0].curves)
    if any(p.is_ensemble or p.is_log or len(p.curves) != count for p in panels):
        return list(panels)
    groups = in_groups(count, lambda one, other: all(_coincide(p, one, other) for p in panels))
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


def in_groups(count: int, is_alike: Callable[[int, int], bool]) -> list[list[int]]:
    """The numbers below `count` in groups; all numbers of a group are alike to its first one."""
    groups: list[list[int]] = []
    for k in range(count):
        own = next((group for group in groups if is_alike(group[0], k)), None)
        if own is None:
            groups.append([k])
        else:
            own.append(k)
    return groups


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
    return bool(np.abs(a - b).max() <= _SAME / (72 * panel.height) * np.ptp([a, b]))


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


def draw_hidden(axes: Axes, *, is_ladder: bool) -> None:
    """Draw lines with marks broad and pale where later ones lie upon them.

    Not of a ladder, only where these have the same colour, upon which their dashes are not seen.
    """
    lines = [
        one
        for one in axes.lines
        if one.get_zorder() >= 3 and "None" not in (one.get_linestyle(), one.get_marker() or "None")
    ]
    points = [np.array(sorted(np.asarray(one.get_xydata()).tolist())) for one in lines]
    places = [axes.transData.transform(own).T * 72 / axes.figure.dpi for own in points]
    for k, (lower, own, (x, y)) in enumerate(zip(lines, points, places, strict=True)):
        upper = [
            np.interp(x, a, b, left=np.nan, right=np.nan)
            for other, (a, b) in zip(lines[k + 1 :], places[k + 1 :], strict=True)
            if is_ladder or other.get_color() == lower.get_color()
        ]
        count = np.sum([np.abs(one - y) < _ON_IT for one in upper], axis=0)
        for layers in range(1, len(upper) + 1):
            parts = (count[1:] >= layers) & (count[:-1] >= layers)
            if parts.any():
                ends = np.append(parts, False) | np.append(False, parts)
                seen = np.where(ends, own[:, 1], np.nan)
                line = axes.plot(own[:, 0], seen, **DECORATION)[0]
                line.set(label=HIDDEN, color=pale(str(lower.get_color())))
                line.set(linewidth=_WIDTH + _LAYER * layers, solid_capstyle="butt")
                line.set(zorder=2.5 - 0.01 * layers, rasterized=x.size > MOST_POINTS)


_Place = tuple[float, float, int, tuple[float, ...]]
"""Of a mark in points of type, which line it belongs to, and its numbers."""


def draw_marks(axes: Axes) -> None:
    """Draw the marks of a ladder above all lines, at one place the smaller upon the larger.

    Where a line is pale, it and those upon it show theirs in turn.
    """
    named = [one for one in axes.lines if str(one.get_label())[0] != "_" and one.get_zorder() >= 3]
    points = [np.asarray(one.get_xydata()) for one in axes.lines if one.get_label() == HIDDEN]
    hidden = {tuple(at) for one in points for at in one.tolist()}
    left: list[_Place] = []
    for k, line in enumerate(named):
        every, own = line.get_markevery(), np.asarray(line.get_xydata())
        for at in (own if every is None else own[np.array(every, int)]).tolist():
            place = axes.transData.transform(at) / axes.figure.dpi * 72
            if np.isfinite(place).all():
                left.append((*place.tolist(), k, tuple(at)))
        line.set_markevery([])
    left.sort()
    full = [one[:2] for one in left if named[one[2]].get_markerfacecolor() != "white"]
    turns = [0] * len(named)
    while left:
        pile = [left[0]]
        for one in pile:
            pile += [o for o in left if o not in pile and math.dist(o[:2], one[:2]) < _ON_IT]
        if any(at in hidden for *_, at in pile):
            nests, rest = [], pile
            while rest:
                chosen = min(rest, key=lambda one: turns[one[2]])
                turns[chosen[2]] += 1
                nests.append([chosen])
                rest = [one for one in rest if math.dist(one[:2], chosen[:2]) > _LEAST_DISTANCE]
        else:
            pile = [one for one in pile if math.dist(one[:2], left[0][:2]) < _ON_IT]
            nests = [sorted(pile, key=lambda one: named[one[2]].get_zorder())]
        left = [one for one in left if one not in pile]
        for nest in nests:
            _draw_nest(axes, nest, named, full)


def _draw_nest(
    axes: Axes,
    nest: Sequence[_Place],
    named: Sequence[Line2D],
    full: Sequence[tuple[float, float]],
) -> None:
    """Marks at one place, the lowest first, where those in the places `full` hide others."""
    for above, (x, y, k, at) in enumerate(nest):
        mark, size = Line2D(*np.transpose([at])), named[k].get_markersize()
        mark.update_from(named[k])
        mark.set(markersize=size * _IN_IT ** ((len(nest) - 1) / 2 - above), markevery=None)
        is_upon = any(math.dist(one, (x, y)) < size for one in full)
        if is_upon and mark.get_markerfacecolor() == "white":
            mark.set_markerfacecolor("none")  # what is full is seen through what is hollow
        mark.set(label=f"_mark of {named[k].get_label()}", gid="decoration", linestyle="none")
        mark.set_zorder(named[k].get_zorder() + 2)
        axes.add_line(mark)
