"""Explanations in a ladder: lost runs in a strip, the floor, and slope triangles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator
from matplotlib.transforms import blended_transform_factory
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.curves import Curve, looks
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.style import (
    DECORATION,
    GUIDE_COLOUR,
    hatch_rounding,
    note,
    small,
    text_width,
)
from fvi_cli.plotting.words import fraction_in_words

GUIDE = "guide"
"""Group id of the lines that show a reference slope."""

_ROW_HEIGHT = 7.0  # points of one row in the strip of runs without an error
_MOST_GUIDES = 5
_LARGE, _SMALL = (0.24, 0.19, 0.15, 0.11), (0.08, 0.06)
_FAR = (5.0, 10.0, 18.0, 25.0, 35.0, 50.0, 70.0)
# tried in this order: widths of a triangle, as shares of the panel's; distances from its curve, in
# points; least distance from everything else, in points; whether it must be next to small steps
# (else it may be anywhere, but only if it is needed)
_CHOICES = (
    (_LARGE, (5.0, 8.0, 12.0), 5.0, True),
    (_LARGE, (3.5, 2.5), 2.5, True),
    (_LARGE, _FAR, 5.0, False),
    (_SMALL, (5.0, 3.5, 2.5), 2.5, True),
    (_LARGE + _SMALL, _FAR, 2.5, False),
)
_MARGIN = 2  # least distance from the frame, in points
_HIGHEST_RISE = 0.4
_SAME_SLOPE, _FAR_SLOPE = 0.4, 2.0
_SHOWN_SLOPE = 0.12  # a curve that falls faster than theory by more shows its order only later
# a triangle is next to small steps: within this share of a curve, measured in decades of h
_ASYMPTOTIC = 0.7
# points that cover a triangle (weights of its corners), and points that cover a unit box
_LATTICE = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8.0
_BOX = np.stack(np.meshgrid(np.linspace(0, 1, 12), np.linspace(0, 1, 4)), axis=-1).reshape(-1, 2)


def explain(axes: Axes, curves: Sequence[Curve]) -> None:
    """Add lost runs, the floor and slope triangles to a panel whose layout is final."""
    (strip, leads), floor = _draw_lost(axes, curves), _draw_floor(axes, curves)
    ladders = [ladder for one in curves if (ladder := _Ladder.of(axes, one)).points.size]
    if ladders:
        _draw_slopes(axes, ladders, floor, strip, [_places(axes, *lead) for lead in leads])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ladder:
    """A curve without its gaps, in the order of increasing steps."""

    points: Array  # places in the panel, in points of type, shape ``(n, 2)``
    above: NDArray[np.intp]  # indices of points above the floor
    orders: Array  # orders that theory expects; nan where it expects none
    stated: float
    tilt: float  # slope in the panel of a line of order 1
    is_broken: bool  # whether a run without an error lies between the smallest steps with one

    @classmethod
    def of(cls, axes: Axes, curve: Curve) -> _Ladder:
        rising = np.argsort(curve.x)
        drawn = np.flatnonzero(curve.y[rising] > 0)
        x, y = curve.x[rising][drawn], curve.y[rising][drawn]
        width, height = _size(axes) / np.ptp(np.log10([axes.get_xlim(), axes.get_ylim()]), axis=1)
        return cls(
            points=_places(axes, x, y),
            above=np.flatnonzero(y > curve.floor),
            orders=np.full_like(curve.x, curve.order)[rising][drawn],
            stated=curve.stated,
            tilt=height / width,
            is_broken=bool(np.any(np.diff(drawn[:3]) > 1)),
        )

    @property
    def order(self) -> float:
        """The order that theory expects at the smallest step above the floor; nan: none."""
        return float(self.orders[self.above[0]]) if self.above.size else math.nan

    @property
    def slope(self) -> float:
        """Order of the last three points above the floor on the side of small steps."""
        last = self.above[:3]
        if last.size < 2 or self.is_broken:
            return math.nan
        x, y = self.points[last].T
        return float(np.polyfit(x, y, 1)[0]) / self.tilt

    def span(self, order: float) -> tuple[float, float]:
        """First and last abscissa in the panel next to which a triangle of that order may be."""
        there = self.above
        if self.order == order:
            there = there[self.orders[there] == order]
        across = self.points[there, 0] if there.size else self.points[:, 0]
        return float(across[0]), float(across[0] + _ASYMPTOTIC * (across[-1] - across[0]))


def _orders(ladders: Sequence[_Ladder]) -> list[float]:
    """Orders that get a triangle: those of theory, else observed slopes, rounded to halves."""
    expected = {one.order for one in ladders if math.isfinite(one.order)}
    slopes = [one.slope for one in ladders]
    observed = {round(2 * slope) / 2 for slope in slopes if math.isfinite(slope) and slope > 0.25}
    return sorted(expected or observed)[:_MOST_GUIDES]


def _places(axes: Axes, x: ArrayLike, y: ArrayLike) -> Array:
    """Places of points in the panel, in points of type, shape ``(n, 2)``."""
    places: Array = axes.transData.transform(np.stack([x, y], axis=1))
    places -= axes.get_window_extent().p0
    return places * _per_dot(axes)


def _draw_lost(axes: Axes, curves: Sequence[Curve]) -> tuple[float, list[tuple[Array, Array]]]:
    """Draw hollow marks with their status in a strip at the top; returns its begin, and leads."""
    groups: dict[str, list[tuple[Curve, Look, list[float]]]] = {}
    shown = looks(curves, marked=True)
    for one, look in zip(curves, shown, strict=True):
        for word in dict.fromkeys(word for _, word in one.lost):
            steps = [step for step, other in one.lost if other == word]
            groups.setdefault(word, []).append((one, look, steps))
    width, height = _size(axes)
    # hollow marks, unless hollow marks distinguish methods
    face = {"markerfacecolor": "none"} if all(look.is_filled for look in shown) else {}
    across = blended_transform_factory(axes.transData, axes.transAxes)
    low, high = np.log10(axes.get_xlim())
    row, level = _ROW_HEIGHT / height, 1.0
    for status, members in groups.items():
        places = (np.log10([s for *_, steps in members for s in steps]) - low) / (high - low)
        is_right = 1.0 - places.max() > places.min()
        room = 1.0 - places.max() if is_right else places.min()
        # a word that does not fit next to the marks has a row of its own
        rows = len(members) + (room < 72 * text_width(status) / width + 0.06)
        bottom = level - max(rows * row, small() / height) - 0.6 * row
        middle = (level + bottom) / 2 if rows == len(members) else level - 0.8 * row
        note(axes, 0.97 if is_right else 0.03, middle, status, ha="right" if is_right else "left")
        for number, (one, look, steps) in enumerate(members, start=1):
            at = [bottom + (len(members) - number + 0.8) * row] * len(steps)
            line = axes.plot(steps, at, transform=across, **look.properties())[0]
            line.set(label=f"_{one.label}: {status}", gid="failure", zorder=4, linestyle="none")
            line.set(markeredgecolor=look.colour, markeredgewidth=0.8, **face)
        edge = axes.plot([0, 1], [bottom, bottom], transform=axes.transAxes, **DECORATION)[0]
        edge.set(color=GUIDE_COLOUR, linewidth=0.5, label="_edge")
        level = bottom
    leads: list[tuple[Array, Array]] = []
    if groups:
        make_room(axes, 1 - level)
        for one, look in zip(curves, shown, strict=True):
            for lead in _leads_to_strip(axes, one, level):
                line = axes.plot(*lead, gid="decoration", label="_lead to the strip")[0]
                line.set(color=look.colour, linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=2.5)
                leads.append(lead)
        strip = Rectangle((0, level), 1, 1 - level, transform=axes.transAxes, zorder=0)
        strip.set_facecolor("#f0f0f0")
        axes.add_patch(strip)
    return level, leads


def _leads_to_strip(axes: Axes, one: Curve, level: float) -> Iterator[tuple[Array, Array]]:
    """Ends of the lines between a curve and the strip, before and after diverged runs."""
    bottom, top = axes.get_ylim()
    edge = bottom * (top / bottom) ** level
    diverged = {step for step, word in one.lost if word == "diverged"}
    rising = np.argsort(one.x)
    for pair in pairwise(zip(one.x[rising].tolist(), one.y[rising].tolist(), strict=True)):
        if sum(step in diverged for step, _ in pair) == 1:
            heights = [edge if step in diverged else value for step, value in pair]
            yield np.array([step for step, _ in pair]), np.array(heights)


def make_room(axes: Axes, share: float) -> None:
    """Raise the upper limit so that the top `share` of the panel has neither curves nor ticks."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, low * (high / low) ** (1 / (1 - share)))
    for is_minor in (False, True):
        ticks = [t for t in axes.yaxis.get_ticklocs(minor=is_minor) if low <= t <= high]
        set_locator = axes.yaxis.set_minor_locator if is_minor else axes.yaxis.set_major_locator
        set_locator(FixedLocator(ticks))


def _draw_floor(axes: Axes, curves: Sequence[Curve]) -> float:
    """Hatch the region below the floor if a curve reaches it; returns its share of the panel."""
    level = max((one.floor for one in curves if np.any(one.y < one.floor)), default=0.0)
    if not level:
        return 0.0
    low, high = axes.get_ylim()
    hatch_rounding(axes, low, level)
    return max(float(np.log(level / low) / np.log(high / low)), 0.12)


def _size(axes: Axes) -> Array:
    """Width and height of a panel in points."""
    extent = axes.get_window_extent()
    return np.array([extent.width, extent.height]) * _per_dot(axes)


def _per_dot(axes: Axes) -> float:
    """Points of type in a dot."""
    return 72.0 / axes.figure.dpi


def _draw_slopes(
    axes: Axes, ladders: Sequence[_Ladder], floor: float, strip: float, leads: Sequence[Array]
) -> None:
    """Draw one triangle for every order next to a curve of this slope; dashed: a stated order.

    If there is no space near such curves the triangle is left out. Only if it would be the only
    one, or shows a stated order, it may be far from them.
    """
    width, height = (int(length) for length in _size(axes))
    taken = np.zeros((height, width), dtype=bool)  # occupied cells, each one point (of type) wide
    taken[: round(floor * height)] = taken[round(strip * height) :] = True
    for points in (*(one.points for one in ladders), *leads):
        fine = np.linspace(points[0, 0], points[-1, 0], 2 * width)
        _take(taken, np.stack([fine, np.interp(fine, *points.T)], axis=1))
        _take(taken, points)
    expected = _orders(ladders)
    stated = {one.stated for one in ladders if math.isfinite(one.stated)}.difference(expected)
    is_drawn = False
    for order in (*expected, *sorted(stated)):
        is_stated = order in stated
        near = [one for one in ladders if is_stated and one.stated == order]
        near = near or _nearest(ladders, order)
        label = f"claimed order {order:g}" if is_stated else f"order {fraction_in_words(order)}"
        if near and near[0].order == order and near[0].slope > order + _SHOWN_SLOPE:
            label = f"limit {label}"
        box = np.array([72 * text_width(label), small()])
        is_needed = is_stated or not near or (order == expected[-1] and not is_drawn)
        room: Array = distance_transform_edt(~taken)
        places = (
            triangle
            for runs, distances, clearance, is_close in _CHOICES
            if is_needed or is_close
            for run in runs
            if order * ladders[0].tilt * run * width < _HIGHEST_RISE * height
            for distance in distances
            for one in near or ladders
            for triangle in _triangles(
                one, order, run * width, distance, one.span(order) if is_close else (0, width)
            )
            if _is_free(triangle, box, room, clearance)
        )
        if (triangle := next(places, None)) is not None:
            is_drawn = True
            _take(taken, _all_over(triangle, box))
            _draw_triangle(axes, triangle, label, is_stated=is_stated)


def _take(taken: NDArray[np.bool_], points: Array) -> None:
    """Mark the cells of some points as occupied."""
    column, row = points.astype(int).T
    taken[row.clip(0, taken.shape[0] - 1), column.clip(0, taken.shape[1] - 1)] = True


def _nearest(ladders: Sequence[_Ladder], order: float) -> list[_Ladder]:
    """Ladders whose expected order is that slope, or else with a similar slope, the best first."""
    # a curve that blows up shows no order, even if theory expects one
    own = [one for one in ladders if one.order == order and abs(one.slope - order) < _FAR_SLOPE]
    alike = [one for one in ladders if abs(one.slope - order) < _SAME_SLOPE]
    return sorted(own or alike, key=lambda one: abs(one.slope - order))


def _triangles(
    one: _Ladder, order: float, run: float, distance: float, span: tuple[float, float]
) -> Iterator[Array]:
    """Corners of triangles at a distance from a ladder, those at small steps first.

    Shape ``(3, 2)``: lower end, right angle, upper end; the right angle lies below or above the
    hypotenuse.
    """
    slope = order * one.tilt
    if run > span[1] - span[0]:
        return
    for left in np.linspace(span[0], span[1] - run, 25):
        along = left + np.linspace(0.0, run, 20)
        offset = np.interp(along, *one.points.T) - slope * (along - left)
        for low, right_angle in (
            (offset.min() - 1.05 * distance, (run, 0.0)),
            (offset.max() + 1.05 * distance, (0.0, slope * run)),
        ):
            yield np.array([left, low]) + np.array([(0, 0), right_angle, (run, slope * run)])


def _is_free(corners: Array, box: Array, room: Array, clearance: float) -> bool:
    """Whether a triangle with its label lies in the panel at a distance from everything else."""
    column, row = _all_over(corners, box).astype(int).T
    height, width = (size - _MARGIN for size in room.shape)
    if min(column.min(), row.min()) < _MARGIN or column.max() >= width or row.max() >= height:
        return False
    return bool(room[row, column].min() >= clearance)


def _all_over(corners: Array, box: Array) -> Array:
    """Points that cover a triangle and the box of its label next to the horizontal leg."""
    start, right_angle, end = corners
    lowest = start[1] - box[1] - 1.5 if right_angle[1] == start[1] else end[1]
    label = np.array([0.5 * (start[0] + end[0] - box[0]), lowest]) + _BOX * box
    return np.concatenate([_LATTICE @ corners, label])


def _draw_triangle(axes: Axes, corners: Array, label: str, *, is_stated: bool) -> None:
    places = corners / _per_dot(axes) + axes.get_window_extent().p0
    start, right_angle, end = axes.transData.inverted().transform(places)
    is_below = corners[0, 1] == corners[1, 1]
    side = axes.plot(*zip(start, end, strict=True), label=f"_{label}", gid=GUIDE)[0]
    side.set(linewidth=0.8, linestyle=(0, (3, 1.5)) if is_stated else "-")
    legs = axes.plot(*zip(start, right_angle, end, strict=True), label="_legs", gid="decoration")[0]
    legs.set(linewidth=0.5)
    for line in (side, legs):
        line.set(color=GUIDE_COLOUR, zorder=1.5)
    axes.annotate(
        label,
        xy=(math.sqrt(start[0] * end[0]), right_angle[1]),
        xytext=(0, -1.5 if is_below else 1.5),
        textcoords="offset points",
        ha="center",
        va="top" if is_below else "bottom",
        fontsize=small(),
        color=GUIDE_COLOUR,
    )
