"""Break points of the forcing on the grid of steps."""

from __future__ import annotations

import math

from fvi_cli.effects.scene import Scene

TOLERANCE = 1e-9


def steps_at_break_points(scene: Scene, n_steps: int) -> tuple[int, ...]:
    """Indices k with t_k at the break points of `scene`.

    Raises
    ------
    ValueError
        If a break point lies between two steps; the message names the nearest N that fit.
    """
    indices = []
    for break_point in scene.break_points:
        place = break_point / scene.final_time * n_steps
        if abs(place - round(place)) > TOLERANCE * max(1.0, place):
            below, above = nearest_fitting(scene, n_steps)
            fits = " and ".join(str(n) for n in (below, above) if n)
            hint = f"the nearest that fit are {fits}" if fits else "no number of steps fits"
            raise ValueError(
                f"n_steps: {n_steps} puts the break point t = {break_point:g} between two steps; "
                f"{hint}"
            )
        indices.append(round(place))
    return tuple(indices)


def nearest_fitting(scene: Scene, n_steps: int, *, limit: int = 2**20) -> tuple[int, int]:
    """The nearest step counts below and above that put every break point on the grid (0: none)."""
    return (
        next(
            (n for n in range(n_steps, max(0, n_steps - limit), -1) if fits_break_points(scene, n)),
            0,
        ),
        next((n for n in range(n_steps, n_steps + limit) if fits_break_points(scene, n)), 0),
    )


def fits_break_points(scene: Scene, n_steps: int) -> bool:
    """Whether all break points lie on the grid of N equal steps."""
    places = [t / scene.final_time * n_steps for t in scene.break_points]
    return all(
        math.isclose(p, round(p), rel_tol=0, abs_tol=TOLERANCE * max(1.0, p)) for p in places
    )
