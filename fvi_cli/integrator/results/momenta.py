"""Momenta at mesh points from velocities at the stages, where those of the method are rough."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array

AT_A_TIME = 2048
"""Points whose velocities are computed together."""


def velocities_near(ends: Array, sizes: Array, stages: Array, points: Array, at: Array) -> Array:
    r"""Velocities at times from the stages of steps near them, by one polynomial each.

    After a jump of the velocity, or of its rate as by a Riemann-Liouville derivative of order
    above 1 with an initial velocity, the momentum of a Gauss method at mesh points keeps an error
    like :math:`\tau^{2 - \gamma}` of the first step :math:`\tau`, since its stability function
    has the size 1 at infinity; the velocities at the stages do not have it.

    Takes k steps for every time, ``(n, k)``, and velocities at their stages, ``(n, k, r, d)``;
    returns ``(n, d)``.
    """
    n, count = sizes.shape
    places = (ends - at[:, None] - sizes)[..., None] + sizes[..., None] * points
    places = (places / sizes.max(axis=1)[:, None, None]).reshape(n, -1)
    own = np.eye(places.shape[1], dtype=bool)
    distance = np.where(own, 1.0, places[:, :, None] - places[:, None, :])
    weights = np.where(own, 1.0, -places[:, None, :] / distance).prod(axis=2)
    values = stages.reshape(n, count * points.size, -1)
    return np.asarray(np.einsum("nk,nkd->nd", weights, values))


def smooth_momenta(
    steps: RunSteps, to_momentum: Callable[[Array, Array, Array], Array], breaks: Sequence[float]
) -> Array:
    """Momenta at the points of a mesh from the velocities at the stages, shape ``(n + 1, d)``.

    `to_momentum` takes positions, velocities and times, ``(n, d)``, ``(n, d)``, ``(n,)``; at the
    breaks the motion may be singular.
    """
    n, found = steps.n_steps, steps.momentum.copy()
    jumps = np.zeros_like(found) if steps.jump is None else steps.jump
    is_edge = np.any(jumps != 0.0, axis=1) | np.isin(steps.time, breaks)
    is_edge[[0, n]] = True
    # the steps on both sides; at the end of a flight, and at its first point, on one
    point = np.arange(1, n + 1)
    before, after = is_edge[:-1], np.append(is_edge[2:], True)
    first, last = point - 1, point.copy()
    ends, begins = is_edge[1:], before & ~is_edge[1:]
    last[ends] -= 1
    first[ends & ~before] -= 1
    first[begins] += 1
    last[begins & ~after] += 1
    velocity = np.empty_like(found[1:])
    for count in (1, 2):
        (chosen,) = np.nonzero(last - first + 1 == count)
        for begin in range(0, chosen.size, AT_A_TIME):
            one = chosen[begin : begin + AT_A_TIME]
            steps_near = first[one, None] + np.arange(count)
            velocity[one] = velocities_near(
                steps.time[steps_near + 1],
                steps.step_size[steps_near],
                steps.velocity[steps_near],
                steps.tables.points,
                steps.time[one + 1],
            )
    if n > 1:
        # after the first step the polynomial may leave the range of the velocities next to it
        before, behind = steps.velocity[0, -1], steps.velocity[1, 0]
        sizes = steps.step_size[:2] * (1.0 - steps.tables.points[-1], steps.tables.points[0])
        chord = (before * sizes[1] + behind * sizes[0]) / sizes.sum()
        leaves = np.abs(velocity[0] - chord) > np.abs(behind - before)
        velocity[0] = np.where(leaves, chord, velocity[0])
    found[1:] = to_momentum(steps.position[1:], velocity, steps.time[1:]) + jumps[1:]
    return found
