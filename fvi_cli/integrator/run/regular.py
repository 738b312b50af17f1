"""How far a motion is regular: where it has a positive mass matrix and an energy."""

from __future__ import annotations

import numpy as np

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.integrator.failure import Failure
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.matrices.definite import least_scaled_eigenvalue


def regular_until(
    lagrangian: Lagrangian, position: Array, momentum: Array, energy: Array, grid: Array
) -> tuple[int, Failure | None]:
    """How many points of the grid have a positive definite mass matrix and an energy.

    Parameters
    ----------
    lagrangian
        L.
    position, momentum, energy, grid
        The path and its times; its end may be not finite.

    Returns
    -------
    int, Failure or None
        The number of points, and what comes then.
    """
    with np.errstate(all="ignore"):
        velocity = lagrangian.velocity(position, momentum, grid)
        mass = lagrangian.derivatives(position, velocity, grid).mass
    wrong = np.logical_not(np.isfinite(mass.reshape(grid.size, -1)).all(axis=1))
    mass = np.where(np.expand_dims(wrong, (1, 2)), 0.0, mass)
    smallest = least_scaled_eigenvalue(mass)
    bad = np.flatnonzero(~(smallest > 0) | ~np.isfinite(energy))
    if not bad.size:
        return grid.size, None
    first = int(bad[0])
    step, time = max(first - 1, 0), float(grid[first])
    place = f"step {step}, t = {time:.6g}: "
    if smallest[first] > 0:
        # derivatives may well be numbers where L is none, beyond the end of a logarithm
        near = ", ".join(f"{value:.4g}" for value in position[first])
        words = f"{place}the Lagrangian is not finite near q = [{near}]"
        return first, Failure(words, "irregular", step, time)
    words = (
        f"{place}the mass matrix d2L/dv2 is not positive definite any more "
        f"(smallest eigenvalue {np.linalg.eigvalsh(mass[first])[0]:.3g})"
    )
    return first, Failure(words, "irregular", step, time)
