"""Break points of the forcing, and knots of its samples, on the grid of steps."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array

ON_GRID = 1e-9
"""What is as close to a multiple of the step as this, in steps, lies on the grid."""


def are_on_grid(places: Array) -> NDArray[np.bool_]:
    """Whether times, given in steps, lie on the grid."""
    found = np.abs(places - np.rint(places)) <= ON_GRID * np.maximum(1.0, places)
    return np.asarray(found)


def steps_at_break_points(scene: Scene, n_steps: int) -> tuple[int, ...]:
    """Indices k with t_k at the break points of `scene`.

    Raises
    ------
    ValueError
        If a break point lies between two steps; the message names the nearest N that fit.
    """
    places = np.array(scene.break_points) / scene.final_time * n_steps
    for break_point, fits in zip(scene.break_points, are_on_grid(places), strict=True):
        if not fits:
            below, above = nearest_fitting(scene, n_steps)
            known = " and ".join(str(n) for n in (below, above) if n)
            hint = f"the nearest that fit are {known}" if known else "no number of steps fits"
            raise ValueError(
                f"n_steps: {n_steps} puts the break point t = {break_point:g} between two steps; "
                f"{hint}"
            )
    return tuple(np.rint(places).astype(int).tolist())


def nearest_fitting(scene: Scene, n_steps: int, *, limit: int = 2**20) -> tuple[int, int]:
    """The nearest step counts below and above that put every break point on the grid (0: none)."""
    fits = [
        next((n for n in range(n_steps, end, step) if fits_break_points(scene, n)), 0)
        for end, step in ((max(0, n_steps - limit), -1), (n_steps + limit, 1))
    ]
    return fits[0], fits[1]


def fits_break_points(scene: Scene, n_steps: int) -> bool:
    """Whether all break points lie on the grid of N equal steps."""
    return bool(are_on_grid(np.array(scene.break_points) / scene.final_time * n_steps).all())


def interpolation_limit(scene: Scene, n_steps: int, *, grading: float = 1.0) -> float:
    """Limit that the knots of a sampled force set; infinite without samples.

    A knot between two points of the grid costs the order p of the interpolation (linear 2, cubic
    4). Where all knots lie on the grid, only the memory of the damping sees them: a kink of the
    p-th kind starts a fractional power, p + 3 - gamma. Measured for gamma = 0.5, 1 and 1.5 and
    none, on Gauss methods of degree 2 and 3. On a graded mesh no knot is looked for.
    """
    samples = () if scene.forcing is None else scene.forcing.samples
    if not samples:
        return math.inf
    order = float(min(component.order for component in samples))
    if grading != 1.0 or not all(
        are_on_grid(
            knots[(knots > 0) & (knots < scene.final_time)] / scene.final_time * n_steps
        ).all()
        for knots in (component.knots for component in samples)
    ):
        return order
    memory = [term.order for term in scene.active_damping if not term.is_integer_order]
    return order + 3.0 - max(memory) if memory else math.inf


def interpolation_remarks(scene: Scene, n_steps: int, *, grading: float = 1.0) -> tuple[str, ...]:
    """What the reader of a table should know about samples of the force."""
    samples = () if scene.forcing is None else scene.forcing.samples
    limit = interpolation_limit(scene, n_steps, grading=grading)
    if not samples or math.isinf(limit):
        return ()
    names = ", ".join(dict.fromkeys(component.source for component in samples))
    return (f"forcing: the interpolation of {names} allows order {limit:g} at most",)
