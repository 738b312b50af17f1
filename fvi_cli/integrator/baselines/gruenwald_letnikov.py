"""The baseline of Gruenwald and Letnikov: central differences, and one dot product per step."""

from __future__ import annotations

import time

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.advance import STRIDE, advanced
from fvi_cli.integrator.baselines.results import (
    baseline_operations,
    baseline_trajectory,
    forces_on_grid,
)
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.growth_bound import beyond, bound_at_end
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import convolution_weights


def integrate_gruenwald_letnikov(scene: Scene, n_steps: int) -> Trajectory:
    r"""Central differences with the Gruenwald-Letnikov derivative of the positions.

    .. math:: M \frac{x_{k+1} - 2 x_k + x_{k-1}}{h^2}
              + \sum_j \mu_j h^{-\gamma_j} \sum_{n=0}^{k} w_n^{(j)} y_{k-n}
              + \nabla V(x_k) = f(t_k)

    with the coefficients of :math:`(1 - z)^{\gamma_j}` and y what Caputo's derivative leaves of x
    (x - q0 - v0 t above order 1). Explicit; the sums are NumPy dot products. Order 1, that of the
    derivative. On a linear scene it is stable while h^2 k + mu (2/h)^gamma h^2 < 4.

    Returns
    -------
    Trajectory
        Momenta are those of the central differences.
    """
    began = time.perf_counter()
    h = scene.final_time / n_steps
    d = scene.dimension
    inverse_mass = np.linalg.inv(scene.inertia.mass)
    grid = h * np.arange(n_steps + 1, dtype=float)
    forces = forces_on_grid(scene, n_steps)
    terms = []
    for term in scene.active_damping:
        length = 2 if term.is_integer_order else n_steps + 1
        weights = h**-term.order * convolution_weights(1, term.order, length)
        shift = taken_off(scene, term, grid)
        terms.append((np.ascontiguousarray(weights[::-1]), term.coefficient, shift))
    bound = bound_at_end(scene, n_steps)
    ready = time.perf_counter()
    position = np.empty((n_steps + 1, d))
    position[0] = scene.initial_position
    # what is left of x for each derivative: the samples of its dot products
    samples = [np.empty_like(position) for _ in terms]
    # the last difference x_k - x_(k-1), so that 1 / h^2 never meets a rounded position
    difference = h * scene.initial_velocity
    done = 0
    failure: Failure | None = None
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n_steps):
            if k % STRIDE == 0:
                advanced(k, n_steps)
            force = forces[k]
            for (backwards, matrix, shift), left in zip(terms, samples, strict=True):
                left[k] = position[k] - shift[k]
                length = min(k + 1, backwards.size)
                derivative = backwards[backwards.size - length :] @ left[k + 1 - length : k + 1]
                force = force - derivative @ matrix
            if scene.potential is not None:
                force = force - scene.potential.gradient(position[k])
            if k == 0:
                for term in scene.active_damping:
                    if term.is_integer_order:
                        force = force - scene.initial_velocity @ term.coefficient
            difference = difference + (0.5 if k == 0 else 1.0) * h * h * (inverse_mass @ force)
            position[k + 1] = position[k] + difference
            done = k + 1
            failure = beyond(position[done], difference / h, bound, done, h)
            if failure:
                break
        position = position[: done + 1]
        velocity: Array = np.asarray(
            np.gradient(position, h, axis=0, edge_order=2 if done > 1 else 1)
        )
        velocity[0] = scene.initial_velocity
    return baseline_trajectory(
        scene,
        position,
        velocity,
        n_steps,
        failure=failure,
        operations=baseline_operations("gruenwald-letnikov", scene, done),
        iterations=0,
        began=began,
        ready=ready,
    )


def taken_off(scene: Scene, term: FractionalDamping, grid: Array) -> Array:
    """What the derivative of `term` takes off the positions on `grid` first, shape ``(n, d)``.

    The start q0, and above order 1 the straight line q0 + v0 t (Caputo). The derivative of order
    1 is that of x itself: q0 is taken off all the same, so that the first difference is 0.
    """
    if scene.derivative == "caputo" and term.order > 1:
        return np.asarray(scene.initial_position + grid[:, None] * scene.initial_velocity)
    return np.broadcast_to(scene.initial_position, (grid.size, scene.dimension))
