"""What explains a ladder: lost runs in a strip, the floor, and triangles where there is room."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator
from matplotlib.transforms import blended_transform_factory
from numpy.typing import NDArray

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
# points between a triangle and anything else: a marker's radius and some air, or less if it must
_CLEARANCES = (5.0, 3.5, 2.5)
_GAPS = (0.0, 0.02, 0.04, 0.07, 0.1)
_RUNS = (0.24, 0.19, 0.15, 0.11, 0.08, 0.06)
_HIGHEST_RISE = 0.4
_SAME_SLOPE, _FAR_SLOPE = 0.4, 2.0
# a triangle belongs to small steps: it stands beside this share of a curve, in decades of h
_ASYMPTOTIC = 0.7


def explain(axes: Axes, curves: Sequence[Curve]) -> None:
    """Add to a panel whose layout has settled lost runs, the floor, and slope triangles."""
    taken = np.concatenate([_draw_lost(axes, curves), *_draw_floor(axes, curves)])
    ladders = [ladder for one in curves if (ladder := _Ladder.of(one)).x.size]
    if ladders:
        _draw_slopes(axes, ladders, _orders(ladders), taken)


@dataclass(frozen=True, eq=False)
class _Ladder:
    """A curve without its gaps, steps increasing, as decimal logarithms."""

    x: Array
    y: Array
    above: NDArray[np.intp]  # indices above the floor
    orders: Array
    stated: float
    is_broken: bool  # whether a run without an error lies between the smallest that have one

    @classmethod
    def of(cls, curve: Curve) -> _Ladder:
        rising = np.argsort(curve.x)
        y = curve.y[rising]
        drawn = np.flatnonzero(y > 0)
        order = np.broadcast_to(np.asarray(curve.order, dtype=float), curve.x.shape)[rising]
        return cls(
            x=np.log10(curve.x[rising][drawn]),
            y=np.log10(y[drawn]),
            above=np.flatnonzero(y[drawn] > curve.floor),
            orders=order[drawn],
            stated=curve.stated,
            is_broken=bool(np.any(np.diff(drawn[:3]) > 1)),
        )

    @property
    def order(self) -> float:
        """What theory expects at the smallest step above the floor; nan where it says nothing."""
        return float(self.orders[self.above[0]]) if self.above.size else math.nan

    @property
    def slope(self) -> float:
        """Slope of the last three points above the floor on the side of small steps."""
        last = self.above[:3]
        if last.size < 2 or self.is_broken:
            return math.nan
        return float(np.polyfit(self.x[last], self.y[last], 1)[0])

    def span(self, order: float) -> tuple[float, float]:
        """Smallest and largest step of the points above the floor that may have that order."""
        there = self.above
        if self.order == order:
            there = there[self.orders[there] == order]
        steps = self.x[there] if there.size else self.x
        return float(steps[0]), float(steps[0] + _ASYMPTOTIC * (steps[-1] - steps[0]))


def _orders(ladders: Sequence[_Ladder]) -> list[float]:
    """Orders worth a triangle: what theory expects, else observed slopes to the half."""
    expected = {one.order for one in ladders if math.isfinite(one.order)}
    slopes = [one.slope for one in ladders]
    observed = {round(2 * slope) / 2 for slope in slopes if math.isfinite(slope) and slope > 0.25}
    return sorted(expected or observed)[:_MOST_GUIDES]


def _draw_lost(axes: Axes, curves: Sequence[Curve]) -> Array:
    """Hollow marks in a strip at the top, one row for every status and curve."""
    groups: dict[str, list[tuple[Curve, Look, list[float]]]] = {}
    shown = looks(curves, marked=True)
    for one, look in zip(curves, shown, strict=True):
        for word in dict.fromkeys(word for _, word in one.lost):
            steps = [h for h, other in one.lost if other == word]
            groups.setdefault(word, []).append((one, look, steps))
    if not groups:
        return np.zeros((0, 2))
    points, width = _size(axes)[1], _size(axes)[0]
    x0, x1 = np.log10(axes.get_xlim())
    # hollow marks, unless that already distinguishes two methods
    is_hollow = all(look.is_filled for look in shown)
    across = blended_transform_factory(axes.transData, axes.transAxes)
    top = 1.0
    for status, members in groups.items():
        places = [(np.log10(h) - x0) / (x1 - x0) for _, _, steps in members for h in steps]
        room = 72 * text_width(status) / width + 0.06
        is_right, is_left = 1 - max(places) > room, min(places) > room
        # where the word has no room beside the marks it has a row of its own
        n_rows = len(members) + (not (is_right or is_left))
        bottom = top - (max(n_rows * _ROW_HEIGHT, small()) + 4) / points
        row = (top - bottom - 4 / points) / n_rows
        first = top - 2 / points - row * (n_rows - len(members))
        for number, (one, look, steps) in enumerate(members):
            properties = look.properties()
            properties["linestyle"] = "none"
            properties["markeredgecolor"], properties["markeredgewidth"] = look.colour, 0.8
            if is_hollow:
                properties["markerfacecolor"] = "none"
            level = [first - (number + 0.5) * row] * len(steps)
            label = f"_{one.label}: {status}"
            line = axes.plot(steps, level, transform=across, label=label, **properties)[0]
            line.set(gid="failure", zorder=4)
        if is_right or is_left:
            at, side = (0.97, "right") if is_right else (0.03, "left")
            note(axes, at, 0.5 * (top + bottom), status, ha=side)
        else:
            note(axes, 0.5, top - 2 / points - row / 2, status, va="center_baseline")
        edge = axes.plot([0, 1], [bottom, bottom], transform=axes.transAxes, **DECORATION)[0]
        edge.set(color=GUIDE_COLOUR, linewidth=0.5, label="_edge")
        top = bottom
    make_room(axes, 1 - top)
    strip = Rectangle((0, top), 1, 1 - top, transform=axes.transAxes, facecolor="#f0f0f0", zorder=0)
    axes.add_patch(strip)
    return _inside(0.0, top, 1.0, 1.0)


def make_room(axes: Axes, share: float) -> None:
    """Raise the upper limit so that `share` of the panel at the top holds no curve, nor a tick."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, low * (high / low) ** (1 / (1 - share)))
    for is_minor in (False, True):
        ticks = [t for t in axes.yaxis.get_ticklocs(minor=is_minor) if low <= t <= high]
        set_locator = axes.yaxis.set_minor_locator if is_minor else axes.yaxis.set_major_locator
        set_locator(FixedLocator(ticks))


def _draw_floor(axes: Axes, curves: Sequence[Curve]) -> list[Array]:
    """Hatched region below the floor, where a curve reaches it."""
    level = max((one.floor for one in curves if np.any(one.y < one.floor)), default=0.0)
    if not level:
        return []
    low, high = axes.get_ylim()
    hatch_rounding(axes, low, level)
    top = float(np.log(level / low) / np.log(high / low))
    return [_inside(0.0, 0.0, 1.0, top), _inside(0.65, 0.0, 1.0, 0.12)]


def _inside(left: float, bottom: float, right: float, top: float) -> Array:
    """Points all over a box, shape ``(n, 2)``."""
    u, v = np.meshgrid(np.linspace(left, right, 40), np.linspace(bottom, top, 20))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def _size(axes: Axes) -> Array:
    """Width and height of a panel in points."""
    extent = axes.get_window_extent()
    return np.array([extent.width, extent.height]) * 72.0 / axes.figure.dpi


def _draw_slopes(
    axes: Axes, curves: Sequence[_Ladder], orders: Sequence[float], taken: Array
) -> None:
    """One triangle for every order, beside a curve of its slope; dashed for what is stated.

    Where all such curves are hemmed in it is left out, unless it would be the only one or is
    stated: that one may stand anywhere. Places are fractions of the panel; `taken` are points.
    """
    limits = np.log10([axes.get_xlim(), axes.get_ylim()])
    start, spread = limits[:, 0], np.ptp(limits, axis=1)
    size, tilt = _size(axes), spread[0] / spread[1]
    scaled = [(np.stack([c.x, c.y], axis=1) - start) / spread for c in curves]
    for points in scaled:
        fine = np.linspace(points[0, 0], points[-1, 0], 200)
        line = np.stack([fine, np.interp(fine, *points.T)], axis=1)
        taken = np.concatenate([taken, points, line])
    stated = {c.stated for c in curves if math.isfinite(c.stated)}.difference(orders)
    drawn = 0
    for order in (*orders, *sorted(stated)):
        is_stated = order in stated
        label = f"stated {order:g}" if is_stated else f"order {fraction_in_words(order)}"
        box = np.array([72 * text_width(label), small()]) / size
        own = [k for k, c in enumerate(curves) if is_stated and c.stated == order]
        targets = []
        for k in own if is_stated else _nearest(curves, order):
            ends = (np.array(curves[k].span(order)) - start[0]) / spread[0]
            targets.append((scaled[k], *ends.tolist()))
        for clearance in _CLEARANCES:
            pad = clearance / size
            candidates = _candidates(order * tilt, targets, float(pad[1]))
            if not targets or is_stated or (drawn == 0 and order == orders[-1]):
                candidates = chain(candidates, _anywhere(order * tilt))
            chosen = next((t for t in candidates if t.is_free(box, taken, pad)), None)
            if chosen is not None:
                low, high = chosen.label(box, pad)
                ends = (chosen.left, chosen.low, chosen.right, chosen.high)
                taken = np.concatenate([taken, _inside(*ends), _inside(*low, *high)])
                corners = 10 ** (start + spread * np.array(chosen.corners()))
                _draw_triangle(axes, corners, label, chosen.below, is_stated=is_stated)
                drawn += 1
                break


def _nearest(curves: Sequence[_Ladder], order: float) -> list[int]:
    """Curves that are expected to have that slope, or else nearly have it, the best first."""
    distances = [abs(curve.slope - order) for curve in curves]
    # a curve that blows up shows no order, whatever is expected of it
    near = [k for k, c in enumerate(curves) if c.order == order and distances[k] < _FAR_SLOPE]
    near = near or [k for k, distance in enumerate(distances) if distance < _SAME_SLOPE]
    return sorted(near, key=distances.__getitem__)


@dataclass(frozen=True)
class _Triangle:
    """In fractions of a panel: from (left, low) up to (right, high), with a corner on a side."""

    left: float
    right: float
    low: float
    high: float
    below: bool

    def corners(self) -> list[tuple[float, float]]:
        corner = (self.right, self.low) if self.below else (self.left, self.high)
        return [(self.left, self.low), corner, (self.right, self.high)]

    def label(self, size: Array, pad: Array) -> tuple[Array, Array]:
        """Lower left and upper right of the label on the outer side of the flat leg."""
        left, tall = 0.5 * (self.left + self.right - size[0]), size[1] + 0.3 * pad[1]
        low = np.array([left, self.low - tall if self.below else self.high])
        return low, low + np.array([size[0], tall])

    def is_free(self, size: Array, taken: Array, pad: Array) -> bool:
        """Whether it lies in the panel, and nothing that is taken comes nearer than `pad`."""
        low, high = self.label(size, pad)
        ends = np.array([*low, *high, self.left, self.low, self.right, self.high])
        if ends.min() < 0.02 or ends.max() > 0.98:
            return False
        if ((taken > low - pad) & (taken < high + pad)).all(axis=1).any():
            return False
        u, v = taken.T
        share = np.clip((u - self.left) / (self.right - self.left), 0, 1)
        edge = self.low + share * (self.high - self.low)
        floor, ceiling = (self.low, edge) if self.below else (edge, self.high)
        across = (u > self.left - pad[0]) & (u < self.right + pad[0])
        return not (across & (v > floor - pad[1]) & (v < ceiling + pad[1])).any()


def _candidates(
    tilt: float, targets: Sequence[tuple[Array, float, float]], clearance: float
) -> Iterator[_Triangle]:
    """Triangles of slope `tilt` whose hypotenuse keeps its distance: large and close ones first."""
    for run in (run for run in _RUNS if tilt * run < _HIGHEST_RISE):
        for gap in _GAPS:
            for points, first, last in targets:
                if run > last - first and run > _RUNS[-1]:
                    continue
                for left in np.linspace(first, max(first, last - run), 25):
                    along = np.linspace(left, left + run, 20)
                    offset = np.interp(along, *points.T) - tilt * (along - left)
                    for below in (True, False):
                        away = gap + 1.05 * clearance
                        low = float(offset.min() - away if below else offset.max() + away)
                        yield _Triangle(left, left + run, low, low + tilt * run, below)


def _anywhere(tilt: float) -> Iterator[_Triangle]:
    """Triangles of slope `tilt` all over the panel."""
    for run in (run for run in _RUNS if tilt * run < _HIGHEST_RISE):
        for low in np.linspace(0.03, 0.97 - tilt * run, 15):
            for left in np.linspace(0.03, 0.97 - run, 25):
                for below in (True, False):
                    yield _Triangle(left, left + run, low, low + tilt * run, below)


def _draw_triangle(axes: Axes, corners: Array, label: str, below: bool, *, is_stated: bool) -> None:
    side = axes.plot(*corners[[0, 2]].T, label=f"_{label}", gid=GUIDE)[0]
    side.set(linewidth=0.8, linestyle=(0, (3, 1.5)) if is_stated else "-")
    legs = axes.plot(*corners.T, label="_legs", gid="decoration")[0]
    legs.set(linewidth=0.5)
    for line in (side, legs):
        line.set(color=GUIDE_COLOUR, zorder=1.5)
    axes.annotate(
        label,
        xy=(float(np.sqrt(corners[0, 0] * corners[2, 0])), corners[0 if below else 2, 1]),
        xytext=(0, -1.5 if below else 1.5),
        textcoords="offset points",
        ha="center",
        va="top" if below else "bottom",
        fontsize=small(),
        color=GUIDE_COLOUR,
    )
