"""Slope triangles: where in a log-log panel there is room for one beside the curve it explains."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from fvi_cli.output.figures.style import GUIDE_COLOUR, SMALL_TEXT

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

GUIDE = "guide"
"""Group id of the lines that show a reference slope."""

_CLEARANCE = 5.0  # points between a triangle and anything else: a marker's radius and some air
_GAPS = (0.0, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A curve that a reference slope may explain, as decimal logarithms."""

    log_step: Array
    log_error: Array

    def slope(self) -> float:
        """Slope of the last three points on the side of small steps."""
        if self.log_step.size < 2:
            return float("nan")
        order = np.argsort(self.log_step)[:3]
        return float(np.polyfit(self.log_step[order], self.log_error[order], 1)[0])


@dataclass(frozen=True, kw_only=True)
class _Triangle:
    """In fractions of the panel: hypotenuse from (left, low) to (right, high), corner on a side."""

    left: float
    right: float
    low: float
    high: float
    below: bool


def order_label(order: float) -> str:
    """``order 2``, ``order 1.5``."""
    return f"order {order:g}"


def draw_slopes(
    axes: Axes, curves: Sequence[Curve], orders: Sequence[float], *, blocked: Sequence[Box] = ()
) -> None:
    """Draw one slope triangle for every order, near the curve that comes closest to it.

    Where nothing is free a dashed line of that slope crosses the panel instead.

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
    x0, x1 = np.log10(axes.get_xlim())
    y0, y1 = np.log10(axes.get_ylim())
    extent = axes.get_window_extent()
    points = 72.0 / axes.figure.dpi
    width, height = extent.width * points, extent.height * points
    tilt = (x1 - x0) / (y1 - y0)
    scaled = [((c.log_step - x0) / (x1 - x0), (c.log_error - y0) / (y1 - y0)) for c in curves]
    samples = _samples(scaled)
    taken = list(blocked)
    pad = (_CLEARANCE / width, _CLEARANCE / height)
    for order in orders:
        label = order_label(order)
        size = (0.42 * SMALL_TEXT * len(label) / width, 1.0 * SMALL_TEXT / height)
        nearest = _nearest(curves, order)
        target = scaled[nearest] if nearest is not None else None
        for triangle in _candidates(order * tilt, target):
            boxes = _boxes(triangle, size, pad)
            if _is_free(triangle, boxes, samples, taken, pad):
                taken.extend(boxes)
                _draw_triangle(axes, triangle, label, (x0, x1, y0, y1))
                break
        else:
            _draw_line(axes, order, label, (x0, x1, y0, y1))


def _nearest(curves: Sequence[Curve], order: float) -> int | None:
    distances = [abs(curve.slope() - order) for curve in curves]
    finite = [k for k, distance in enumerate(distances) if np.isfinite(distance)]
    return min(finite, key=distances.__getitem__) if finite else None


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


def _candidates(tilt: float, target: tuple[Array, Array] | None) -> Iterator[_Triangle]:
    """Triangles of slope `tilt` in the panel: close to the target first, then anywhere."""
    for run in (0.26, 0.2, 0.15, 0.1):
        rise = tilt * run
        if rise > 0.45:
            continue
        lefts = np.linspace(0.03, 0.97 - run, 25)
        if target is not None and target[0].size > 1:
            order = np.argsort(target[0])
            u, v = target[0][order], target[1][order]
            for gap in _GAPS:
                for left in lefts:
                    along = np.linspace(max(left, u[0]), min(left + run, u[-1]), 20)
                    if left < u[0] - 0.02 or left + run > u[-1] + 0.02:
                        continue
                    offset = np.interp(along, u, v) - tilt * (along - left)
                    for below in (True, False):
                        low = offset.min() - gap - 0.03 if below else offset.max() + gap + 0.03
                        yield _Triangle(
                            left=left, right=left + run, low=low, high=low + rise, below=below
                        )
        for low in np.linspace(0.03, 0.97 - rise, 15):
            for left in lefts:
                for below in (True, False):
                    yield _Triangle(
                        left=left, right=left + run, low=low, high=low + rise, below=below
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
    axes: Axes, triangle: _Triangle, label: str, limits: tuple[float, float, float, float]
) -> None:
    x0, x1, y0, y1 = limits
    h = 10 ** (x0 + np.array([triangle.left, triangle.right]) * (x1 - x0))
    e = 10 ** (y0 + np.array([triangle.low, triangle.high]) * (y1 - y0))
    corner = (h[1], e[0]) if triangle.below else (h[0], e[1])
    axes.plot(h, e, color=GUIDE_COLOUR, linewidth=0.8, label=f"_{label}", gid=GUIDE, zorder=1.5)
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


def _draw_line(
    axes: Axes, order: float, label: str, limits: tuple[float, float, float, float]
) -> None:
    """Dashed line through the middle of the panel, named in the legend of the panel."""
    x0, x1, y0, y1 = limits
    x = np.array([x0, x1])
    y = 0.5 * (y0 + y1) + order * (x - x.mean())
    axes.plot(
        10**x,
        10**y,
        color=GUIDE_COLOUR,
        linewidth=0.8,
        linestyle=(0, (4, 3)),
        label=f"_{label}",
        gid=GUIDE,
        zorder=1.5,
        scalex=False,
        scaley=False,
    )
    top = min(float(y[1]), y1 - 0.03 * (y1 - y0))
    axes.annotate(
        label,
        xy=(float(10 ** (x.mean() + (top - y.mean()) / order)), float(10**top)),
        xytext=(-4, 0),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=SMALL_TEXT,
        color=GUIDE_COLOUR,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
    )
