"""Jumps of forces that a program computes, at times that are no break points.

A formula shows where it may jump, samples have knots, a Python function shows neither. A function
is evaluated in the middle of every step; where the difference of two neighbouring values stands
out, the interval is halved as long as its ends are distinct numbers. The difference of a smooth
function shrinks with the interval, and so does that of a kink, a noisy record or a fast
oscillation; the difference over a jump does not.
"""

from __future__ import annotations

import itertools

import numpy as np

from fvi_cli.effects.forcing import ForceComponent
from fvi_cli.effects.sampled import FunctionForce
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array

MOST_INTERVALS = 2**16
"""Most evaluations of a function in a long run: a guess."""
FEWEST_INTERVALS = 512
"""Fewest evaluations in a short run: among fast changes, jumps show in short intervals: a guess."""
FIRST_JUMPS, MOST_JUMPS = 256, 8
"""Intervals that are halved, at first and at last; after each halving half of them are kept."""
LEAST_JUMP = 1e-6
"""Relative to the largest force that was met: smaller differences may be round-off."""
HELD, LAST = 0.9, 8
"""A jump keeps this share of its difference over the last 8 halvings; a smooth function keeps 2**-8
of it, ``abs(t - b)**0.1`` keeps 0.57."""
LEAST_SPACINGS = 16.0
"""Halving ends at so many units in the last place of the final time."""
MARGIN = 1e-12
"""Relative to the final time: jumps are not searched for this close to a given break point."""


def jump_remarks(scene: Scene, times: Array) -> tuple[str, ...]:
    """Remarks on a force from functions that jumps between given break points.

    `times` are those of the mesh.
    """
    if scene.forcing is None or not scene.forcing.has_functions:
        return ()
    margin = MARGIN * scene.final_time
    middles = 0.5 * (times[:-1] + times[1:])
    middles = middles[:: max(1, middles.size // MOST_INTERVALS)]
    if middles.size < FEWEST_INTERVALS:
        own = scene.final_time / FEWEST_INTERVALS * np.arange(0.5, FEWEST_INTERVALS)
        middles = np.union1d(middles, own)
    ends = [0.0, *scene.break_points, scene.final_time]
    found: set[str] = set()
    where: set[int] = set()
    for piece, (begin, end) in zip(scene.forcing.pieces, itertools.pairwise(ends), strict=False):
        inside = middles[(middles > begin + margin) & (middles < end - margin)]
        seen = np.concatenate([[begin + margin], inside, [end - margin]])
        for component, places in piece.distinct:
            if isinstance(component, FunctionForce):
                jumps = _jumps(component, seen, scene.final_time)
                found.update(jumps)
                where.update(places if jumps else ())
    if not found:
        return ()
    listed = ", ".join(sorted(found, key=float))
    what = "it jumps"
    if scene.forcing.dimension > 1:
        what = f"component {min(where) + 1} jumps"
    more = " and perhaps at others" if len(found) >= MOST_JUMPS else ""
    points = ", ".join(sorted({*found, *map(repr, scene.break_points)}, key=float))
    return (
        f"forcing: {what} at t = {listed}{more}, where no break point is given: errors are larger, "
        f"and estimates of them less sure; write break_points=[{points}] in Forcing.from_functions",
    )


def _jumps(component: ForceComponent, seen: Array, final_time: float) -> list[str]:
    """Times at which a component jumps, between two times of `seen`."""

    def force(time: Array) -> Array:
        with np.errstate(all="ignore"):
            return np.asarray(component.evaluate({"t": time}), dtype=float)

    least = LEAST_SPACINGS * float(np.spacing(final_time))
    values, sizes = force(seen), np.diff(seen)
    if not np.isfinite(values).all() or seen.size < 3:
        return []
    differences = np.diff(values)
    slopes = differences / sizes
    # slopes of the neighbours, of which there is one at the ends
    outer = np.concatenate([slopes[1:2], 0.5 * (slopes[:-2] + slopes[2:]), slopes[-2:-1]])
    excess = np.abs(differences - outer * sizes)
    smallest = LEAST_JUMP * np.abs(values).max()
    chosen = np.argsort(excess)[-FIRST_JUMPS:]
    chosen = chosen[excess[chosen] > smallest]
    if not chosen.size:
        return []
    low, high, slope = seen[chosen], seen[chosen + 1], outer[chosen]
    at_low, at_high = values[chosen], values[chosen + 1]
    heights: list[Array] = []
    while (high - low).max() > least:
        middle = 0.5 * (low + high)
        between = force(middle)
        expected = slope * (middle - low)
        left, right = (np.abs(one - expected) for one in (between - at_low, at_high - between))
        is_left = left >= right
        low, high = np.where(is_left, low, middle), np.where(is_left, middle, high)
        at_low, at_high = np.where(is_left, at_low, between), np.where(is_left, between, at_high)
        heights.append(np.abs(at_high - at_low))
        if low.size > MOST_JUMPS:
            kept = np.argsort(np.maximum(left, right))[-max(MOST_JUMPS, low.size // 2) :]
            low, high, slope, at_low, at_high = (
                one[kept] for one in (low, high, slope, at_low, at_high)
            )
            heights = []
    if len(heights) <= LAST:
        return []
    is_jump = (heights[-1] > smallest) & (heights[-1] >= HELD * heights[-1 - LAST])
    return [_shortest(*ends) for ends in zip(low[is_jump], high[is_jump], strict=True)]


def _shortest(low: float, high: float) -> str:
    """The number with the fewest digits in or next to an interval."""
    width = high - low
    for digits in range(3, 18):
        text = f"{0.5 * (low + high):.{digits}g}"
        if low - width <= float(text) <= high + width:
            break
    return text
