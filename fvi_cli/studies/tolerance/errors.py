r"""The error of a run, from a second run and from its own polynomials.

On the same mesh a run with two stages more is so much better that the difference of the runs is the
error of the worse one. Between the points of the mesh the error is that of the velocity polynomial.
At both ends of a step it is known: there the momenta give the velocity as accurately as positions
are.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array

MEASURED = 3.0
"""The estimated error of a polynomial is so many times the error found at the ends of its step."""


def differences_of(coarse: Trajectory, fine: Trajectory) -> tuple[Array, Array]:
    """Mesh times of a run, and differences of its positions from another run at these times."""
    steps = coarse.steps
    if steps is None:
        raise ValueError("tolerance: a run without its polynomials")
    times = np.concatenate([steps.time[:-1], [min(steps.time[-1], fine.time[-1])]])
    at_points = np.abs(steps.position - fine(times)).max(axis=1)
    return times, np.where(np.isfinite(at_points), at_points, math.inf)


def between_points(scene: Scene, steps: RunSteps) -> Array:
    """Estimated largest error of the polynomial of every step of a run, a length."""
    m, sizes = steps.tables.points.size, steps.step_size[:, None]
    ends = steps.tables.stage_basis.values([0.0, 1.0])
    with np.errstate(all="ignore"):
        velocity = scene.velocity(steps.position, steps.momentum, steps.time)
    reached = np.einsum("re,nrd->end", ends, steps.velocity)
    missed = np.stack([velocity[:-1], velocity[1:]]) - reached
    # the error (a + b x) P_m(x) of the velocity vanishes at the stages and fits both ends
    left, right = (-1.0) ** m * missed[0], missed[1]
    shares = np.abs(np.stack([0.5 * (right + left), 0.5 * (right - left)]))
    measured = np.einsum("c,cnd->nd", _reaches(m), shares)
    last, fall = _tails(steps)
    # the tails bound it where the velocity is singular at an end and its value there is useless
    found = sizes * np.minimum(MEASURED * measured, last * np.sqrt(fall) / (2 * m + 1))
    return np.asarray(np.where(np.isfinite(found), found, math.inf).max(axis=1))


@functools.cache
def _reaches(m: int) -> Array:
    """Half the largest integrals of P_m and x P_m from -1 to any x, shape ``(2,)``."""
    polynomial = np.polynomial.Legendre.basis(m)
    x = np.linspace(-1.0, 1.0, 50 * m + 1)
    integrals = (
        (polynomial * factor).integ(lbnd=-1)(x) for factor in (1.0, np.polynomial.Legendre([0, 1]))
    )
    return np.array([0.5 * np.abs(values).max() for values in integrals])


def _tails(steps: RunSteps) -> tuple[Array, Array]:
    """The larger of the last two Legendre coefficients of velocities, and their ratio of decay.

    Even and odd coefficients may decay differently, so pairs are compared. A ratio of 1 says that
    coefficients do not decay. Shapes ``(n, d)``.
    """
    kept = steps.tables.to_legendre[-4:]
    found = np.abs(np.einsum("kr,nrd->knd", kept, steps.velocity))
    last = found[-2:].max(axis=0)
    before = found[:-2].max(axis=0, initial=0.0)
    return last, np.minimum(1.0, last / np.maximum(before, 1e-300))
