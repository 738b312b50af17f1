"""What the knots of a sampled force cost."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import TOLERANCE
from fvi_cli.mathematics.arrays import Array


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
        _on_grid(component.knots, scene.final_time, n_steps) for component in samples
    ):
        return order
    memory = [term.order for term in scene.active_damping if not term.is_integer_order]
    return order + 3.0 - max(memory) if memory else math.inf


def _on_grid(knots: Array, final_time: float, n_steps: int) -> bool:
    inside = knots[(knots > 0) & (knots < final_time)]
    places = inside / final_time * n_steps
    return bool(np.all(np.abs(places - np.rint(places)) <= TOLERANCE * np.maximum(1.0, places)))


def interpolation_remarks(scene: Scene, n_steps: int, *, grading: float = 1.0) -> tuple[str, ...]:
    """What the reader of a table should know about samples of the force."""
    samples = () if scene.forcing is None else scene.forcing.samples
    limit = interpolation_limit(scene, n_steps, grading=grading)
    if not samples or math.isinf(limit):
        return ()
    names = ", ".join(dict.fromkeys(component.source for component in samples))
    return (f"forcing: the interpolation of {names} allows order {limit:g} at most",)
