"""The baseline of product integration: the twice integrated equation by the trapezoidal rule."""

from __future__ import annotations

import math
import time

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.advance import STRIDE, advanced
from fvi_cli.integrator.baselines.gruenwald_letnikov import taken_off
from fvi_cli.integrator.baselines.implicit_equation import solve_implicit
from fvi_cli.integrator.baselines.results import baseline_operations, baseline_trajectory
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.growth_bound import beyond, bound_at_end
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array


def integrate_product_trapezoidal(scene: Scene, n_steps: int) -> Trajectory:
    r"""Second-order product integration of the integral equation of the scene.

    Integrated twice the equation of motion is

    .. math:: M (x - q_0 - v_0 t) + \sum_j \mu_j I^{2-\gamma_j} y_j + I^2 (\nabla V(x) - f) = 0

    with :math:`y_j` what Caputo's derivative leaves of x. Every integrand is replaced by its
    piecewise linear interpolant and integrated exactly against the kernel
    :math:`t^{1-\gamma}/\Gamma(2-\gamma)` (K. Diethelm, *The Analysis of Fractional Differential
    Equations*, Springer 2010, appendix C.1). The fractional integrals are NumPy dot products over
    the past; the classical ones (order 2, and 1 for damping of order 1) are running sums. Implicit:
    Newton's iteration with the exact Jacobian where the scene is not linear. Order 2.

    Returns
    -------
    Trajectory
        Positions only: the integrated equation has no velocities.
    """
    began = time.perf_counter()
    h = scene.final_time / n_steps
    d = scene.dimension
    grid = h * np.arange(n_steps + 1, dtype=float)
    line = scene.initial_position + grid[:, None] * scene.initial_velocity
    known = line @ scene.inertia.mass + _forcing_twice_integrated(scene, n_steps)
    linear = scene.inertia.mass.copy()
    terms = []
    for term in scene.active_damping:
        weights = trapezoidal_weights(2 - term.order, h, 2 if term.is_integer_order else n_steps)
        shift = taken_off(scene, term, grid)
        linear = linear + weights[0] * term.coefficient
        known = known + weights[0] * shift @ term.coefficient
        backwards = np.ascontiguousarray(weights[::-1])
        terms.append((backwards, term.coefficient, shift, term.is_integer_order))
    bound = bound_at_end(scene, n_steps)
    ready = time.perf_counter()
    position = np.empty((n_steps + 1, d))
    position[0] = scene.initial_position
    samples = [np.zeros_like(position) for _ in terms]
    sums = [np.zeros(d) for _ in terms]
    pull = _pull(scene, position[0])
    # first and second integral of the pull up to t_k
    once, twice = np.zeros(d), np.zeros(d)
    iterations, done = 0, 0
    failure: Failure | None = None
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n_steps):
            if k % STRIDE == 0:
                advanced(k, n_steps)
            constant = known[k + 1] - twice - h * once - h * h / 3 * pull
            for index, (backwards, matrix, _, is_integer) in enumerate(terms):
                left = samples[index]
                if is_integer:
                    # all weights but the newest are equal: a running sum
                    sums[index] = sums[index] + backwards[0] * left[k]
                    constant = constant - sums[index] @ matrix
                elif k:
                    # left[0] is 0
                    end = backwards.size - 1
                    constant = constant - backwards[end - k : end] @ left[1 : k + 1] @ matrix
            try:
                solved, used = solve_implicit(
                    linear,
                    constant,
                    scene.potential,
                    position[k],
                    base=np.zeros(d),
                    factor=1.0,
                    weight=h * h / 6,
                )
            except StepFailedError as error:
                failure = Failure.in_step(k, k * h, error)
                break
            iterations += 0 if scene.is_linear else used
            position[k + 1] = solved
            newest = _pull(scene, solved)
            twice = twice + h * once + h * h * (pull / 3 + newest / 6)
            once = once + h / 2 * (pull + newest)
            pull = newest
            for left, (_, _, shift, _) in zip(samples, terms, strict=True):
                left[k + 1] = solved - shift[k + 1]
            done = k + 1
            failure = beyond(solved, (solved - position[k]) / h, bound, done, h)
            if failure:
                break
    return baseline_trajectory(
        scene,
        position[: done + 1],
        None,
        n_steps,
        failure=failure,
        operations=baseline_operations("product-integration", scene, done),
        iterations=iterations,
        began=began,
        ready=ready,
    )


def trapezoidal_weights(order: float, step_size: float, n_weights: int) -> Array:
    r"""Weights of the fractional integral of a piecewise linear function that starts at 0.

    .. math:: b_0 = c, \qquad b_n = c \left((n+1)^{a+1} - 2 n^{a+1} + (n-1)^{a+1}\right),
              \qquad c = h^a / \Gamma(a + 2)

    Parameters
    ----------
    order
        a > 0, the order of the integral.
    step_size
        h.
    n_weights
        How many; :math:`I^a y(t_k) = \sum_{n=0}^{k} b_n y_{k-n}` where y_0 = 0.
    """
    n = np.arange(2, n_weights, dtype=float)
    # the second difference of n^(a+1) as differences from n^(a+1), which lose less
    tail = n ** (order + 1) * (
        np.expm1((order + 1) * np.log1p(1 / n)) + np.expm1((order + 1) * np.log1p(-1 / n))
    )
    weights = np.concatenate(([1.0, 2 ** (order + 1) - 2], tail))[:n_weights]
    return np.asarray(step_size**order / math.gamma(order + 2) * weights)


def _pull(scene: Scene, position: Array) -> Array:
    if scene.potential is None:
        return np.zeros(scene.dimension)
    return scene.potential.gradient(position)


def _forcing_twice_integrated(scene: Scene, n_steps: int) -> Array:
    """I^2 f at t_0 .. t_N for the interpolant of f, which may jump between steps."""
    d, h = scene.dimension, scene.final_time / n_steps
    twice = np.zeros((n_steps + 1, d))
    if scene.forcing is None:
        return twice
    ends = scene.forcing.on_steps(h * np.arange(n_steps, dtype=float), h, np.array([0.0, 1.0]))
    once = np.zeros((n_steps, d))
    once[1:] = np.cumsum(h / 2 * ends.sum(axis=1), axis=0)[:-1]
    twice[1:] = np.cumsum(h * once + h * h * (ends[:, 0] / 3 + ends[:, 1] / 6), axis=0)
    return twice
