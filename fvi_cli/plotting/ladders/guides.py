"""Slope triangles: where in a log-log panel there is room for one beside the curve it explains."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from matplotlib.axes import Axes

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.style import GUIDE_COLOUR, SMALL_TEXT, fraction

Box = tuple[float, float, float, float]

GUIDE = "guide"
"""Group id of the lines that show a reference slope."""

# points between a triangle and anything else: a marker's radius and some air, or less if it must
_CLEARANCES = (5.0, 3.5)
_GAPS = (0.0, 0.02, 0.04, 0.07, 0.1)
_RUNS = (0.24, 0.19, 0.15, 0.11, 0.08)
_HIGHEST_RISE = 0.4
_SAME_SLOPE = 0.4
_FAR_SLOPE = 2.0
# a triangle belongs to small steps: it stands beside this share of a curve, in decades of h
_ASYMPTOTIC = 0.7


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A curve that a reference slope may explain, as decimal logarithms.

    Parameters
    ----------
    log_step, log_error
        Points, shape ``(n,)``.
    log_floor
        Below this errors say nothing about the order.
    expected_orders
        What theory says of the slope at every point, shape ``(n,)``; nan where it says nothing,
        None where it never does. It changes along a curve where samples of a force lie
        off some of its grids.
    is_broken
        Whether runs without an error lie between the three smallest steps that have one.
    stated_order
        What the source of the curve states, true or not; nan where it states nothing.
    """

    log_step: Array
    log_error: Array
    log_floor: float = -np.inf
    expected_orders: Array | None = None
    is_broken: bool = False
    stated_order: float = np.nan

    def expected_order(self) -> float:
        """What theory expects at the smallest step above the floor; nan when it says nothing."""
        above = np.flatnonzero(self.log_error > self.log_floor)
        if self.expected_orders is None or above.size == 0:
            return float("nan")
        return float(self.expected_orders[above[np.argmin(self.log_step[above])]])

    def span(self, order: float) -> tuple[float, float]:
        """Smallest and largest step of the points above the floor that may have that order."""
        there = self.log_error > self.log_floor
        if self.expected_orders is not None and self.expected_order() == order:
            there = there & (self.expected_orders == order)
        steps = self.log_step[there] if there.any() else self.log_step
        first, last = float(steps.min()), float(steps.max())
        return first, first + _ASYMPTOTIC * (last - first)

    def slope(self) -> float:
        """Slope of the last three points above the floor on the side of small steps."""
        above = np.flatnonzero(self.log_error > self.log_floor)
        if above.size < 2 or self.is_broken:
            return float("nan")
        last = above[np.argsort(self.log_step[above])[:3]]
        return float(np.polyfit(self.log_step[last], self.log_error[last], 1)[0])


@dataclass(frozen=True, kw_only=True)
class _Triangle:
    """In fractions of the panel: hypotenuse from (left, low) to (right, high), corner on a side."""

    left: float
    right: float
    low: float
    high: float
    below: bool


def draw_slopes(
    axes: Axes,
    curves: Sequence[Curve],
    orders: Sequence[float],
    *,
    blocked: Sequence[Box] = (),
) -> None:
    """Draw one slope triangle for every order, near the curve that comes closest to it.

    Orders that are stated of curves and are none of these are dashed.

    A triangle stands beside a curve of its slope. Where all these are hemmed in it is left out,
    unless it would be the only one: that one may stand anywhere. Without curves there is none.

    Parameters
    ----------
    axes
        Log-log panel with its final limits, in a figure whose layout has settled.
    curves
        What is drawn already.
    orders
        Reference slopes.
    blocked
        Further boxes ``(left, bottom, right, top)`` to keep clear, in fractions of the panel.
    """
    if not curves:
        return
    x0, x1 = np.log10(axes.get_xlim())
    y0, y1 = np.log10(axes.get_ylim())
    extent = axes.get_window_extent()
    points = 72.0 / axes.figure.dpi
    width, height = extent.width * points, extent.height * points
    tilt = (x1 - x0) / (y1 - y0)
    scaled = [((c.log_step - x0) / (x1 - x0), (c.log_error - y0) / (y1 - y0)) for c in curves]
    samples = _samples(scaled)
    taken = list(blocked)
    drawn = 0
    stated = {curve.stated_order for curve in curves if np.isfinite(curve.stated_order)}
    wanted = [(order, False) for order in orders]
    wanted += [(order, True) for order in sorted(stated.difference(orders))]
    for order, is_stated in wanted:
        label = f"stated {order:g}" if is_stated else f"order {fraction(order)}"
        size = (0.42 * SMALL_TEXT * len(label) / width, 1.0 * SMALL_TEXT / height)
        targets = []
        stating = [k for k, curve in enumerate(curves) if curve.stated_order == order]
        for k in stating if is_stated else _targets(curves, order):
            first, last = curves[k].span(order)
            targets.append((*scaled[k], (first - x0) / (x1 - x0), (last - x0) / (x1 - x0)))
        for clearance in _CLEARANCES:
            pad = (clearance / width, clearance / height)
            candidates = _beside_targets(order * tilt, targets, pad[1])
            if not targets or (drawn == 0 and order == orders[-1]) or is_stated:
                candidates = chain(candidates, _anywhere(order * tilt))
            free = (
                (triangle, boxes)
                for triangle in candidates
                if _is_free(triangle, boxes := _boxes(triangle, size, pad), samples, taken, pad)
            )
            chosen = next(free, None)
            if chosen is not None:
                taken.extend(chosen[1])
                _draw_triangle(axes, chosen[0], label, (x0, x1, y0, y1), is_stated=is_stated)
                drawn += 1
                break


def _targets(curves: Sequence[Curve], order: float) -> list[int]:
    """Curves that are expected to have that slope, or else nearly have it, the best first."""
    distances = [abs(curve.slope() - order) for curve in curves]
    near = [
        k
        for k, curve in enumerate(curves)
        # a curve that blows up shows no order, whatever is expected of it
        if curve.expected_order() == order and distances[k] < _FAR_SLOPE
    ]
    if not near:
        near = [k for k, distance in enumerate(distances) if distance < _SAME_SLOPE]
    return sorted(near, key=distances.__getitem__)


def _samples(scaled: Sequence[tuple[Array, Array]]) -> Array:
    """Points along all curves, shape ``(n, 2)``."""
    parts = [np.empty((0, 2))]
    for u, v in scaled:
        order = np.argsort(u)
        if order.size:
            fine = np.linspace(u[order[0]], u[order[-1]], 200)
            parts.append(np.column_stack([fine, np.interp(fine, u[order], v[order])]))
            parts.append(np.column_stack([u, v]))
    return np.concatenate(parts)


def _beside_targets(
    tilt: float, targets: Sequence[tuple[Array, Array, float, float]], clearance: float
) -> Iterator[_Triangle]:
    """Triangles of slope `tilt` beside the targets: large and close ones first."""
    for run in _runs(tilt):
        for gap in _GAPS:
            for target in targets:
                yield from _beside(*target, tilt, run, gap + 1.05 * clearance)


def _anywhere(tilt: float) -> Iterator[_Triangle]:
    """Triangles of slope `tilt` all over the panel."""
    for run in _runs(tilt):
        for low in np.linspace(0.03, 0.97 - tilt * run, 15):
            for left in np.linspace(0.03, 0.97 - run, 25):
                for below in (True, False):
                    yield _Triangle(
                        left=left, right=left + run, low=low, high=low + tilt * run, below=below
                    )


def _runs(tilt: float) -> list[float]:
    return [run for run in _RUNS if tilt * run < _HIGHEST_RISE]


def _beside(
    u: Array, v: Array, first: float, last: float, tilt: float, run: float, gap: float
) -> Iterator[_Triangle]:
    """Triangles whose hypotenuse keeps `gap` from one curve between `first` and `last`."""
    if run > last - first and run > _RUNS[-1]:
        return
    order = np.argsort(u)
    u, v = u[order], v[order]
    for left in np.linspace(first, max(first, last - run), 25):
        along = np.linspace(left, left + run, 20)
        offset = np.interp(along, u, v) - tilt * (along - left)
        for below in (True, False):
            low = float(offset.min() - gap if below else offset.max() + gap)
            yield _Triangle(
                left=left, right=left + run, low=low, high=low + tilt * run, below=below
            )


def _boxes(triangle: _Triangle, size: tuple[float, float], pad: tuple[float, float]) -> list[Box]:
    """Boxes of the triangle and of its label, which stands on the outer side of the flat leg."""
    centre = 0.5 * (triangle.left + triangle.right)
    if triangle.below:
        bottom, top = triangle.low - size[1] - 0.3 * pad[1], triangle.low
    else:
        bottom, top = triangle.high, triangle.high + size[1] + 0.3 * pad[1]
    return [
        (triangle.left, triangle.low, triangle.right, triangle.high),
        (centre - size[0] / 2, bottom, centre + size[0] / 2, top),
    ]


def _is_free(
    triangle: _Triangle,
    boxes: Sequence[Box],
    samples: Array,
    taken: Sequence[Box],
    pad: tuple[float, float],
) -> bool:
    for box in boxes:
        if box[0] < 0.02 or box[1] < 0.02 or box[2] > 0.98 or box[3] > 0.98:
            return False
        for other in taken:
            if (
                box[0] - pad[0] < other[2]
                and other[0] < box[2] + pad[0]
                and box[1] - pad[1] < other[3]
                and other[1] < box[3] + pad[1]
            ):
                return False
    u, v = samples[:, 0], samples[:, 1]
    label = boxes[1]
    in_label = (
        (u > label[0] - pad[0])
        & (u < label[2] + pad[0])
        & (v > label[1] - pad[1])
        & (v < label[3] + pad[1])
    )
    inside = (u > triangle.left - pad[0]) & (u < triangle.right + pad[0])
    share = np.clip((u - triangle.left) / (triangle.right - triangle.left), 0, 1)
    edge = triangle.low + share * (triangle.high - triangle.low)
    floor = np.where(triangle.below, triangle.low, edge)
    ceiling = np.where(triangle.below, edge, triangle.high)
    in_triangle = inside & (v > floor - pad[1]) & (v < ceiling + pad[1])
    return not bool(np.any(in_label | in_triangle))


def _draw_triangle(
    axes: Axes,
    triangle: _Triangle,
    label: str,
    limits: tuple[float, float, float, float],
    *,
    is_stated: bool,
) -> None:
    x0, x1, y0, y1 = limits
    h = 10 ** (x0 + np.array([triangle.left, triangle.right]) * (x1 - x0))
    e = 10 ** (y0 + np.array([triangle.low, triangle.high]) * (y1 - y0))
    corner = (h[1], e[0]) if triangle.below else (h[0], e[1])
    axes.plot(
        h,
        e,
        color=GUIDE_COLOUR,
        linewidth=0.8,
        linestyle=(0, (3, 1.5)) if is_stated else "-",
        label=f"_{label}",
        gid=GUIDE,
        zorder=1.5,
    )
    axes.plot(
        [h[0], corner[0], h[1]],
        [e[0], corner[1], e[1]],
        color=GUIDE_COLOUR,
        linewidth=0.5,
        label="_legs",
        gid="decoration",
        zorder=1.5,
    )
    axes.annotate(
        label,
        xy=(float(np.sqrt(h[0] * h[1])), e[0] if triangle.below else e[1]),
        xytext=(0, -1.5 if triangle.below else 1.5),
        textcoords="offset points",
        ha="center",
        va="top" if triangle.below else "bottom",
        fontsize=SMALL_TEXT,
        color=GUIDE_COLOUR,
    )
