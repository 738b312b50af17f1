"""Break points of the forcing, and knots of its samples, on the grid of steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array

ON_GRID = 1e-9
"""A time lies on the grid if it is this close, in steps, to a multiple of the step."""
MOST_STEPS, LARGEST_DENOMINATOR = 2**30, 2**20
"""Limits of the search: number of steps, denominator of a break point as a fraction of T."""


def are_on_grid(places: Array) -> NDArray[np.bool_]:
    """Whether times, given in steps, lie on the grid."""
    found = np.abs(places - np.rint(places)) <= ON_GRID * np.maximum(1.0, places)
    return np.asarray(found)


def steps_at_break_points(scene: Scene, n_steps: int) -> tuple[int, ...]:
    """Indices k with t_k at the break points of `scene`.

    Raises
    ------
    ValueError
        If a break point lies inside a step; the message names the nearest N that fit.
    """
    if words := misplaced_break_point(scene.break_points, scene.final_time, n_steps):
        raise ValueError(f"n_steps: {n_steps} puts {words}")
    places = np.array(scene.break_points) / scene.final_time * n_steps
    return tuple(np.rint(places).astype(int).tolist())


def misplaced_break_point(break_points: Sequence[float], final_time: float, n_steps: int) -> str:
    """Which break point lies inside one of N equal steps, and which N fit; empty if none does."""
    places = np.array(break_points) / final_time * n_steps
    between = np.array(break_points)[~are_on_grid(places)]
    if not between.size:
        return ""
    near = [n for n in nearest_fitting(break_points, final_time, n_steps) if n]
    hint = "no number of steps fits"
    if near:
        hint = f"the nearest that fits is {near[0]}"
    if len(near) > 1:
        hint = f"the nearest that fit are {near[0]} and {near[1]}"
    return f"the break point t = {between[0]:g} inside a step; {hint}"


def nearest_fitting(
    break_points: Sequence[float], final_time: float, n_steps: int
) -> tuple[int, int]:
    """The nearest step counts below and above that put every break point on the grid (0: none).

    Break points are taken for fractions of the interval.
    """
    parts = np.array(break_points) / final_time
    divisor = math.lcm(
        *(Fraction(part).limit_denominator(LARGEST_DENOMINATOR).denominator for part in parts)
    )
    below, above = n_steps // divisor * divisor, -(-n_steps // divisor) * divisor
    below, above = (
        n if 0 < n <= MOST_STEPS and are_on_grid(parts * n).all() else 0 for n in (below, above)
    )
    return below, above


def fits_break_points(scene: Scene, n_steps: int) -> bool:
    """Whether all break points lie on the grid of N equal steps."""
    return bool(are_on_grid(np.array(scene.break_points) / scene.final_time * n_steps).all())
