"""Regions of parameters in which a motion is a smooth function of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.intervals import JUMP
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.profile import Minimum
from fvi_cli.studies.fits.search import Found, least_squares_from

ABOVE_JUMP = 1e-6


def regions(model: MotionModel) -> list[tuple[Array, Array]]:
    """Bounds within which the motion is a smooth function of the parameters.

    A Caputo derivative of order above 1 subtracts the start velocity: the motion jumps at order 1.
    """
    low, high = model.bounds
    values = model.values(model.start)
    motions = [number for number, data in enumerate(model.data) if not data.forces]
    moving = bool(motions) and any("velocity" in one.key for one in model.free)
    for scene in (model.scene(number, values) for number in motions):
        moving |= scene.derivative == "caputo" and bool(np.any(scene.initial_velocity != 0))
    split = [
        index
        for index, one in enumerate(model.free)
        if moving and one.key.partition("@")[0].endswith("order") and low[index] < 1 < high[index]
    ]
    found = []
    for sides in itertools.product((False, True), repeat=min(len(split), 2)):
        below, above = low.copy(), high.copy()
        for index, is_above in zip(split, sides, strict=False):
            if is_above:
                below[index] = JUMP + ABOVE_JUMP
            else:
                above[index] = JUMP
        found.append((below, above))
    return found


def holds(bounds: tuple[Array, Array], point: Array) -> bool:
    """Whether a point lies within bounds."""
    return bool(np.all(point >= bounds[0]) and np.all(point <= bounds[1]))


def region_of(model: MotionModel, point: Array) -> tuple[Array, Array]:
    """The first region that holds a point."""
    return next(b for b in regions(model) if holds(b, point))


def other_sides(best: Minimum, others: Sequence[Found]) -> list[Minimum]:
    """The least misfit in every other region, across an order at which the motion jumps."""
    found, model = [], best.model
    for bounds in regions(model):
        if np.array_equal(bounds, best.bounds):
            continue
        begin = next((one.point for one in others if holds(bounds, one.point)), None)
        least = least_squares_from(
            model, np.clip(best.point, *bounds) if begin is None else begin, bounds
        )
        if least is None:
            continue
        try:
            evaluation = model.evaluate(least.point)
        except ValueError:
            continue
        found.append(Minimum(model=model, point=least.point, evaluation=evaluation, bounds=bounds))
    return found
