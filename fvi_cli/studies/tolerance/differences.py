r"""How far a run is from the truth, by another one and by its own polynomials.

On one mesh a run with two stages more is so much better that the difference is the error of the
first one; between the points of the mesh a polynomial of degree M errs by the part that its
velocity leaves out, :math:`h |a_M| / (2 M + 1)`, where the Legendre coefficients that it has tell
how they fall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.run.steps_of_run import RunSteps
from fvi_cli.integrator.trajectory import Trajectory

Array = NDArray[np.float64]


def on_same_mesh(one: Trajectory, other: Trajectory) -> Array:
    """Largest difference of positions at the points of a common mesh, shape ``(n,)``."""
    if one.position.shape != other.position.shape:
        return np.array([math.inf])
    found = np.abs(one.position - other.position).max(axis=1)
    return np.where(np.isfinite(found), found, math.inf)


def on_other_mesh(coarse: Trajectory, fine: Trajectory) -> tuple[Array, Array]:
    """Times, and differences of positions there, of runs on unrelated meshes."""
    steps = coarse.steps
    if steps is None or coarse.status != "ok" or fine.status != "ok":
        return np.zeros(1), np.array([math.inf])
    times = np.concatenate([steps.time[:-1], [min(steps.time[-1], fine.time[-1])]])
    at_points = np.abs(steps.position - fine(times)).max(axis=1)
    return times, np.where(np.isfinite(at_points), at_points, math.inf)


def between_points(run: Trajectory) -> Array:
    """Estimated error of the polynomials of a run between its points, shape ``(steps,)``."""
    steps = run.steps
    if steps is None:
        return np.array([math.inf])
    return polynomial_errors(steps)


def polynomial_errors(steps: RunSteps) -> Array:
    """Estimated largest error of the polynomial of every step, a length."""
    points = steps.tables.points
    m = points.size
    legendre = np.linalg.inv(np.polynomial.legendre.legvander(2.0 * points - 1.0, m - 1))
    kept = min(4, m)
    found = np.abs(np.einsum("kr,nrd->knd", legendre[-kept:], steps.velocity))
    last = found[-2:].max(axis=0)
    before = found[:-2].max(axis=0) if kept > 2 else last
    with np.errstate(all="ignore"):
        # coefficients may fall unevenly, by parity above all: pairs are compared, and the next one
        # may be the larger of the next pair
        fall = np.sqrt(np.minimum(1.0, np.where(before > 0, last / before, 1.0)))
    errors = (last * fall).max(axis=1) * steps.step_size / (2 * m + 1)
    return np.where(np.isfinite(errors), errors, math.inf)


@dataclass(frozen=True, kw_only=True)
class Growth:
    """How the difference of two runs grows.

    Parameters
    ----------
    time
        From when on it is above the tolerance.
    place
        Where the motion is then.
    factor
        By how much it grows in the run, from where it first is above round-off.
    since
        When that was.
    """

    time: float
    place: tuple[float, ...]
    factor: float
    since: float


def growth_of(run: Trajectory, times: Array, differences: Array, tolerance: float) -> Growth:
    """Where differences at these times leave the tolerance, and how they came to that."""
    above = np.flatnonzero(~(differences <= tolerance))
    index = int(above[0]) if above.size else differences.size - 1
    scale = float(np.abs(run.position).max()) or 1.0
    seen = np.flatnonzero(differences > 1e-15 * scale)
    begin = int(seen[0]) if seen.size else index
    finite = differences[np.isfinite(differences)]
    largest = float(finite.max()) if finite.size else math.inf
    least = max(float(differences[begin]), 1e-300)
    nearest = int(np.abs(run.time - times[index]).argmin())
    return Growth(
        time=float(times[index]),
        place=tuple(run.position[nearest].tolist()),
        factor=largest / least,
        since=float(times[begin]),
    )
