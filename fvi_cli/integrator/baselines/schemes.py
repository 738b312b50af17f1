"""The baselines with a memory of their own: the steps of each, and the loop over all."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines.past import Past, caputo_offset, solve_implicit
from fvi_cli.integrator.baselines.results import baseline_operations, baseline_trajectory
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.method import Baseline
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import convolution_weights


class Point(NamedTuple):
    """The end of a step."""

    position: Array  # (d,)
    velocity: Array | None = None  # None where the method has none by itself
    iterations: int = 0  # of Newton


class EqualSteps:
    """The times t_k = k T / N of a scene, and its forces there."""

    def __init__(self, scene: Scene, n_steps: int) -> None:
        self.scene, self.n_steps, self.h = scene, n_steps, scene.final_time / n_steps
        # as products: with other formulas round-off may put break points off the grid
        self.times = self.h * np.arange(n_steps + 1, dtype=float)
        self.inverse_mass = np.linalg.inv(scene.inertia.mass)

    def forcing(self) -> Array:
        """The forcing at all times, shape ``(N + 1, d)``."""
        if self.scene.forcing is None:
            return np.zeros((self.times.size, self.scene.dimension))
        return self.scene.forcing(self.times)

    def potential_gradient(self, position: Array) -> Array:
        """Gradient of the potential."""
        if self.scene.potential is None:
            return np.zeros(self.scene.dimension)
        return self.scene.potential.gradient(position)


Scheme = Callable[[EqualSteps], Iterator[Point]]
"""Gives the points of a run, the start first, by single steps of one size h."""


def _past_of_velocities(steps: EqualSteps) -> Past:
    r"""The past of the damping :math:`h^{1-\gamma} \sum_n w_n v_{k-n}` of Euler's methods.

    The weights are those of :math:`(1 - z)^{\gamma - 1}` (Gruenwald-Letnikov on the velocity). For
    :math:`\gamma = 1` the sum is the velocity itself, and the schemes are the classical ones.
    """
    scene, h = steps.scene, steps.h

    def weights(order: float, count: int) -> Array:
        return np.asarray(h ** (1 - order) * convolution_weights(1, order - 1, count), dtype=float)

    def offset(term: FractionalDamping) -> Array:
        is_shifted = term.order > 1 and scene.derivative == "caputo"
        shape = steps.times.size, scene.dimension
        return np.broadcast_to(is_shifted * scene.initial_velocity, shape)

    past = Past(scene, steps.n_steps, weights, offset)
    past.keep(0, scene.initial_velocity)
    return past


def explicit_euler(steps: EqualSteps) -> Iterator[Point]:
    """Position and velocity, with all forces at the beginning of a step."""
    past, forces = _past_of_velocities(steps), steps.forcing()
    position, velocity = steps.scene.initial_position, steps.scene.initial_velocity
    yield Point(position, velocity)
    for k in range(steps.n_steps):
        force = forces[k] - past.force(k, k) - steps.potential_gradient(position)
        position = position + steps.h * velocity
        velocity = velocity + steps.h * (steps.inverse_mass @ force)
        yield Point(position, velocity)
        past.keep(k + 1, velocity)


def implicit_euler(steps: EqualSteps) -> Iterator[Point]:
    """Position and velocity, with all forces at the end of a step."""
    scene, past = steps.scene, _past_of_velocities(steps)
    inertia = scene.inertia.mass / steps.h
    matrix, forces = inertia + past.newest, steps.forcing() + past.newest_offset
    position, velocity = scene.initial_position, scene.initial_velocity
    yield Point(position, velocity)
    for k in range(steps.n_steps):
        velocity, used = solve_implicit(
            matrix,
            inertia @ velocity - past.force(k + 1, k) + forces[k + 1],
            scene.potential,
            velocity,
            base=position,
            factor=steps.h,
            weight=1.0,
        )
        position = position + steps.h * velocity
        yield Point(position, velocity, used)
        past.keep(k + 1, velocity)


def gruenwald_letnikov(steps: EqualSteps) -> Iterator[Point]:
    r"""Central differences with the Gruenwald-Letnikov derivative of the positions.

    .. math:: M \frac{x_{k+1} - 2 x_k + x_{k-1}}{h^2}
              + \sum_j \mu_j h^{-\gamma_j} \sum_{n=0}^{k} w_n^{(j)} y_{k-n}
              + \nabla V(x_k) = f(t_k)

    with the coefficients of :math:`(1 - z)^{\gamma_j}` and y the part of x that Caputo's derivative
    acts on (x - q0, above order 1 x - q0 - v0 t). Explicit. Order 1, that of the derivative. On a
    linear scene it is stable while h^2 k + mu (2/h)^gamma h^2 < 4.
    """
    scene, h, forces = steps.scene, steps.h, steps.forcing()

    def weights(order: float, count: int) -> Array:
        return np.asarray(h**-order * convolution_weights(1, order, count), dtype=float)

    past = Past(scene, steps.n_steps, weights, caputo_offset(scene, steps.times))
    # the last difference x_k - x_(k-1), so that 1 / h^2 never multiplies a rounded position
    position, difference = scene.initial_position, h * scene.initial_velocity
    yield Point(position)
    for k in range(steps.n_steps):
        past.keep(k, position)
        force = forces[k] - past.force(k, k) - steps.potential_gradient(position)
        if k == 0:
            for term in scene.active_damping:
                if term.is_integer_order:
                    force = force - scene.initial_velocity @ term.matrix
        share = 0.5 if k == 0 else 1.0
        difference = difference + share * h**2 * (steps.inverse_mass @ force)
        position = position + difference
        yield Point(position)


def product_integration(steps: EqualSteps) -> Iterator[Point]:
    r"""Second-order product integration of the integral equation of the scene.

    Integrated twice the equation of motion is

    .. math:: M (x - q_0 - v_0 t) + \sum_j \mu_j I^{2-\gamma_j} y_j + I^2 (\nabla V(x) - f) = 0

    with :math:`y_j` as in :func:`gruenwald_letnikov`. Every integrand is replaced by its
    piecewise linear interpolant and integrated exactly against the kernel
    :math:`t^{1-\gamma}/\Gamma(2-\gamma)` (K. Diethelm, *The Analysis of Fractional Differential
    Equations*, Springer 2010, appendix C.1); the classical integrals (order 2, and 1 for damping of
    order 1) are running sums. Implicit. Order 2. It computes positions only.
    """
    scene, h = steps.scene, steps.h

    def weights(order: float, count: int) -> Array:
        return trapezoidal_weights(2 - order, h, count)

    past = Past(scene, steps.n_steps, weights, caputo_offset(scene, steps.times))
    past.keep(0, scene.initial_position)
    line = scene.initial_position + steps.times[:, None] * scene.initial_velocity
    every = line @ scene.inertia.mass + _forcing_twice_integrated(steps) + past.newest_offset
    matrix = scene.inertia.mass + past.newest
    position = scene.initial_position
    newest = steps.potential_gradient(position)
    # first and second integral of the potential force up to t_k
    once = twice = origin = np.zeros(scene.dimension)
    yield Point(position)
    for k in range(steps.n_steps):
        gradient = newest
        known = every[k + 1] - twice - h * once - h * h / 3 * gradient
        position, used = solve_implicit(
            matrix,
            known - past.force(k + 1, k),
            scene.potential,
            position,
            base=origin,
            factor=1.0,
            weight=h * h / 6,
        )
        newest = steps.potential_gradient(position)
        twice = twice + h * once + h * h * (gradient / 3 + newest / 6)
        once = once + h / 2 * (gradient + newest)
        yield Point(position, iterations=0 if scene.is_linear else used)
        past.keep(k + 1, position)


def _forcing_twice_integrated(steps: EqualSteps) -> Array:
    """I^2 f at t_0 .. t_N for the interpolant of f, which may jump between steps."""
    twice, h = np.zeros((steps.times.size, steps.scene.dimension)), steps.h
    if steps.scene.forcing is None:
        return twice
    ends = steps.scene.forcing.on_steps(steps.times[:-1], h, np.array([0.0, 1.0]))
    once = np.zeros_like(twice[1:])
    once[1:] = np.cumsum(h / 2 * ends.sum(axis=1), axis=0)[:-1]
    twice[1:] = np.cumsum(h * once + h * h * (ends[:, 0] / 3 + ends[:, 1] / 6), axis=0)
    return twice


def trapezoidal_weights(order: float, step_size: float, n_weights: int) -> Array:
    r"""Weights of the fractional integral of a piecewise linear function that starts at 0.

    .. math:: b_0 = c, \qquad b_n = c \left((n+1)^{a+1} - 2 n^{a+1} + (n-1)^{a+1}\right),
              \qquad c = h^a / \Gamma(a + 2)

    The order is a > 0, and :math:`I^a y(t_k) = \sum_{n=0}^{k} b_n y_{k-n}` where y_0 = 0.
    """
    n = np.arange(2, n_weights, dtype=float)
    # the second difference of n^(a+1) as differences from n^(a+1), which lose less
    tail = n ** (order + 1) * (
        np.expm1((order + 1) * np.log1p(1 / n)) + np.expm1((order + 1) * np.log1p(-1 / n))
    )
    weights = np.concatenate(([1.0, 2 ** (order + 1) - 2], tail))[:n_weights]
    return np.asarray(step_size**order / math.gamma(order + 2) * weights)


SCHEMES: dict[str, Scheme] = {
    "explicit-euler": explicit_euler,
    "implicit-euler": implicit_euler,
    "gruenwald-letnikov": gruenwald_letnikov,
    "product-integration": product_integration,
}


def integrate_by_scheme(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    """The trajectory of a baseline of :data:`SCHEMES`."""
    began = time.perf_counter()
    steps = EqualSteps(scene, n_steps)
    scheme, h = SCHEMES[method.name](steps), steps.h
    # the steps themselves need the newest point alone
    positions, velocities = np.empty((2, n_steps + 1, scene.dimension))
    point, done, iterations = next(scheme), 0, 0
    positions[0], velocities[0] = point.position, scene.initial_velocity
    ready = time.perf_counter()
    failure: Failure | None = None
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n_steps):
            try:
                point = next(scheme)
            except StepFailedError as error:
                failure = Failure.in_step(k, k * h, error)
                break
            iterations += point.iterations
            if not np.isfinite(point.position).all():
                failure = Failure.not_finite(k, (k + 1) * h)
                break
            done, positions[k + 1] = k + 1, point.position
            if point.velocity is not None:
                velocities[done] = point.velocity
        positions, velocity = positions[: done + 1], None
        if method.name == "gruenwald-letnikov":
            velocity = np.gradient(positions, h, axis=0, edge_order=2 if done > 1 else 1)
            velocity[0] = scene.initial_velocity
        elif point.velocity is not None:
            velocity = velocities[: done + 1]
    return baseline_trajectory(
        scene,
        positions,
        velocity,
        n_steps,
        failure=failure,
        operations=baseline_operations(method.name, scene, done),
        iterations=iterations,
        began=began,
        ready=ready,
    )
