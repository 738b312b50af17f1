r"""Baselines: methods that users would write otherwise, on equal steps.

Their damping is a sum :math:`\sum_j D_j \sum_{n=0}^{k} w_n^{(j)} (y_{k-n} - s_{k-n}^{(j)})` over
all samples y before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.potential import Potential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.failure import no_unique_solution, not_finite
from fvi_cli.integrator.method import Baseline
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import convolution_weights
from fvi_cli.mathematics.convergence import find_roots


def baseline_objection(scene: Scene, method: Baseline) -> str:
    """Why `method` is not made for `scene`; empty where it is."""
    if scene.lagrangian is not None:
        return f"{method.name} is not made for a Lagrangian without a constant mass matrix"
    if scene.derivative == "riemann-liouville" and scene.initial_position.any():
        return f"{method.name} needs derivative: caputo, or an initial position of 0"
    return ""


def integrate_baseline(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    """The trajectory of a baseline on t_k = k T / N.

    Raises
    ------
    ValueError
        For scenes that the method is not made for.
    """
    if objection := baseline_objection(scene, method):
        raise ValueError(f"baseline: {objection}")
    steps = _EqualSteps(scene, n_steps)
    points = [_Point(scene.initial_position, scene.initial_velocity)]
    scheme, failure = SCHEMES[method.name](steps), ""
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            for k, point in enumerate(scheme):
                if not np.isfinite(point.position).all():
                    failure = not_finite(k, (k + 1) * steps.h)
                    break
                points.append(point)
        except np.linalg.LinAlgError:
            k = len(points) - 1
            failure = f"step {k}, t = {k * steps.h:.6g}: {no_unique_solution(steps.h)}"
        position = np.array([point.position for point in points])
        times, momentum, energy = steps.times[: len(points)], None, None
        if points[-1].velocity is not None:
            momentum = np.array([point.velocity for point in points]) @ scene.inertia.mass
            energy = scene.energy(position, momentum, times)
    return Trajectory(
        time=times,
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=n_steps,
        step_size=steps.h,
        status="failed" if failure else "ok",
        message=failure,
        history_operations=steps.operations,
        newton_iterations=sum(point.iterations for point in points),
    )


class _Point(NamedTuple):
    """The end of a step."""

    position: Array  # (d,)
    velocity: Array | None = None  # None where the method has none by itself
    iterations: int = 0  # of Newton


class _EqualSteps:
    """The times t_k = k T / N of a scene, and its damping as sums over all samples before.

    Of every term j there are weights :math:`w^{(j)}`, and s, which its derivative subtracts from
    the samples.
    """

    def __init__(self, scene: Scene, n_steps: int) -> None:
        self.scene, self.n_steps, self.h = scene, n_steps, scene.final_time / n_steps
        none = QuadraticPotential(stiffness=np.zeros((scene.dimension, scene.dimension)))
        self.potential: Potential = scene.potential or none
        # as products: with other formulas round-off may put break points off the grid
        self.times = self.h * np.arange(n_steps + 1, dtype=float)
        self.forcing = np.zeros((n_steps + 1, scene.dimension))
        if scene.forcing is not None:
            self.forcing = scene.forcing(self.times)
        self.line = scene.initial_position + self.times[:, None] * scene.initial_velocity
        self.operations = 0  # multiply-adds of the sums over the past

    def sum_samples(self, weights: Callable[[float], Array], below: Array, above: Array) -> None:
        """Prepare sums with weights by the order; s up to order 1, and above it."""
        terms, (n, d) = self.scene.active_damping, self.line.shape
        matrices = np.array([term.matrix for term in terms]).reshape(-1, d, d)
        # from the sums of all terms, one after another, to the force
        self._to_force = matrices.swapaxes(1, 2).reshape(-1, d)
        self._backwards = np.empty((len(terms), 1, n))
        self._samples = np.empty((len(terms), n, d))
        for j, term in enumerate(terms):
            self._backwards[j, 0] = weights(term.order)[::-1]
            self._samples[j] = -(above if term.order > 1 else below)
        # the factor of the newest sample
        self.newest = (self._backwards[..., -1:] * matrices).sum(axis=0)

    def sum_velocities(self) -> None:
        r"""Take :math:`h^{1-\gamma} \sum_n w_n v_{k-n}`, for order 1 the velocity itself."""
        start = self.scene.initial_velocity
        above = start if self.scene.derivative == "caputo" else 0 * start
        self.sum_samples(lambda order: self.gruenwald(order - 1), 0 * start, above)
        self.keep(0, start)

    def sum_positions(self, weights: Callable[[float], Array]) -> None:
        """Take positions without what Caputo's derivative does not see.

        That is q0, or q0 + v0 t above order 1; order 1 does not depend on q0, which is subtracted
        so that the first difference is 0.
        """
        start = self.scene.initial_position
        self.sum_samples(weights, start, self.line if self.scene.derivative == "caputo" else start)
        self.keep(0, start)

    def gruenwald(self, order: float) -> Array:
        r"""The coefficients of :math:`h^{-\gamma} (1 - z)^\gamma`."""
        return np.asarray(self.h**-order * convolution_weights(1, order, self.times.size))

    def keep(self, k: int, sample: Array) -> None:
        """Keep the sample y of time k."""
        self._samples[:, k] += sample

    def damping(self, k: int) -> Array:
        """The force at time k; without its factor of the newest sample before that is kept."""
        self.operations += len(self._to_force) * (k + 1)
        weights = self._backwards[..., self.n_steps - k :]
        sums = (weights @ self._samples[:, : k + 1])[:, 0]
        return np.asarray(sums.ravel() @ self._to_force)


def _explicit_euler(steps: _EqualSteps) -> Iterator[_Point]:
    """Position and velocity, with all forces at the beginning of a step."""
    steps.sum_velocities()
    inverse_mass = np.linalg.inv(steps.scene.inertia.mass)
    position, velocity = steps.scene.initial_position, steps.scene.initial_velocity
    for k in range(steps.n_steps):
        force = steps.forcing[k] - steps.damping(k) - steps.potential.gradient(position)
        position = position + steps.h * velocity
        velocity = velocity + steps.h * (inverse_mass @ force)
        steps.keep(k + 1, velocity)
        yield _Point(position, velocity)


def _implicit_euler(steps: _EqualSteps) -> Iterator[_Point]:
    """Position and velocity, with all forces at the end of a step."""
    steps.sum_velocities()
    inertia = steps.scene.inertia.mass / steps.h
    position, velocity = steps.scene.initial_position, steps.scene.initial_velocity
    for k in range(steps.n_steps):
        known = inertia @ velocity - steps.damping(k + 1) + steps.forcing[k + 1]
        velocity, iterations = _solve(
            inertia + steps.newest, known, steps.potential, velocity, position, steps.h
        )
        position = position + steps.h * velocity
        steps.keep(k + 1, velocity)
        yield _Point(position, velocity, iterations)


def _gruenwald_letnikov(steps: _EqualSteps) -> Iterator[_Point]:
    r"""Central differences with the Gruenwald-Letnikov derivative of the positions.

    .. math:: M \frac{x_{k+1} - 2 x_k + x_{k-1}}{h^2}
              + \sum_j \mu_j h^{-\gamma_j} \sum_{n=0}^{k} w_n^{(j)} y_{k-n}
              + \nabla V(x_k) = f(t_k)

    with the coefficients of :math:`(1 - z)^{\gamma_j}` and y the part of x that Caputo's derivative
    acts on. Explicit. Order 1, that of the derivative. On a linear scene it is stable while
    h^2 k + mu (2/h)^gamma h^2 < 4. Positions only.
    """
    scene, h = steps.scene, steps.h
    steps.sum_positions(steps.gruenwald)
    inverse_mass = np.linalg.inv(scene.inertia.mass)
    # the last difference x_k - x_(k-1), so that 1 / h^2 never multiplies a rounded position
    position, difference = scene.initial_position, h * scene.initial_velocity
    for k in range(steps.n_steps):
        force = steps.forcing[k] - steps.damping(k) - steps.potential.gradient(position)
        if k == 0:
            # the first difference of order 1 is 0 in place of v0, and the first step is half a step
            viscous = [term.matrix for term in scene.active_damping if term.is_integer_order]
            force = 0.5 * (force - sum(viscous, np.zeros_like(inverse_mass)) @ difference / h)
        difference = difference + h**2 * (inverse_mass @ force)
        position = position + difference
        steps.keep(k + 1, position)
        yield _Point(position)


def _product_integration(steps: _EqualSteps) -> Iterator[_Point]:
    r"""Second-order product integration of the integral equation of the scene.

    Integrated twice the equation of motion is

    .. math:: M (x - q_0 - v_0 t) + \sum_j \mu_j I^{2-\gamma_j} y_j + I^2 (\nabla V(x) - f) = 0

    with :math:`y_j` as for Gruenwald-Letnikov. Every integrand is replaced by its piecewise linear
    interpolant and integrated exactly against the kernel :math:`t^{1-\gamma}/\Gamma(2-\gamma)`
    (K. Diethelm, *The Analysis of Fractional Differential Equations*, Springer 2010, appendix C.1);
    the classical integrals of order 2 are running sums. Implicit. Order 2. Positions only.
    """
    scene, h = steps.scene, steps.h
    steps.sum_positions(lambda order: trapezoidal_weights(2 - order, h, steps.n_steps + 1))
    # forces at both ends of every step: they may jump between steps
    given = np.zeros((steps.n_steps, 2, scene.dimension))
    if scene.forcing is not None:
        given = scene.forcing.on_steps(steps.times[:-1], h, np.array([0.0, 1.0]))
    line, weight = steps.line @ scene.inertia.mass, h * h / 6
    matrix, position = (scene.inertia.mass + steps.newest) / weight, scene.initial_position
    gradient = steps.potential.gradient(position)
    # first and second integral of the forces up to t_k
    once = twice = origin = np.zeros(scene.dimension)
    for k in range(steps.n_steps):
        first, last = gradient - given[k, 0], -given[k, 1]
        twice = twice + h * once + weight * (2 * first + last)
        known = line[k + 1] - steps.damping(k + 1) - twice
        position, iterations = _solve(
            matrix, known / weight, steps.potential, position, origin, 1.0
        )
        gradient = steps.potential.gradient(position)
        twice = twice + weight * gradient
        once = once + h / 2 * (first + last + gradient)
        steps.keep(k + 1, position)
        yield _Point(position, iterations=iterations)


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


def _solve(
    linear: Array, constant: Array, potential: Potential, guess: Array, base: Array, factor: float
) -> tuple[Array, int]:
    r"""Solve :math:`A u + \nabla V(b + c u) = r`, by Newton's iteration with the exact Jacobian.

    Returns u ``(d,)`` and the number of iterations, which is 0 if the equation is linear.

    Raises
    ------
    LinAlgError
        If no solution was found.
    """
    if isinstance(potential, QuadraticPotential):
        matrix = linear + factor * potential.hessian(base)
        return np.asarray(np.linalg.solve(matrix, constant - potential.gradient(base))), 0

    def equation(unknown: Array) -> tuple[Array, Array, Array]:
        at = base + factor * unknown
        inner, force, curvature = unknown @ linear.T, potential.gradient(at), potential.hessian(at)
        # round-off of positions, which enters through the second derivatives
        terms = np.abs(unknown) @ np.abs(linear.T) + np.abs(force) + np.abs(constant)
        terms = terms + np.einsum("nab,nb->na", np.abs(curvature), np.abs(base) + np.abs(at))
        return inner + force - constant, linear + factor * curvature, terms

    roots, converged, iterations = find_roots(equation, guess[None])
    if not converged.all():
        raise np.linalg.LinAlgError("Newton's iteration did not converge")
    return np.asarray(roots[0]), iterations


SCHEMES: dict[str, Callable[[_EqualSteps], Iterator[_Point]]] = {
    "explicit-euler": _explicit_euler,
    "implicit-euler": _implicit_euler,
    "gruenwald-letnikov": _gruenwald_letnikov,
    "product-integration": _product_integration,
}
"""Give the ends of the steps of a run, one by one."""
