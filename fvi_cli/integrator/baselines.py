r"""Baselines: methods that users would write otherwise, on equal steps.

Their damping is a sum :math:`\sum_j D_j \sum_{n=0}^{k} w_n^{(j)} (y_{k-n} - s_{k-n}^{(j)})` over
all samples y before.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.potential import Potential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.failure import StepFailedError, no_unique_solution, not_finite
from fvi_cli.integrator.method import Baseline
from fvi_cli.integrator.trajectory import NewtonRecord, Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import convolution_weights
from fvi_cli.mathematics.convergence import find_roots
from fvi_cli.mathematics.threads import in_one_thread


def baseline_objection(scene: Scene, method: Baseline) -> str:
    """Why `method` is not made for `scene`; empty where it is."""
    if scene.lagrangian is not None:
        return f"{method.name} is not made for a Lagrangian without a constant mass matrix"
    if scene.derivative == "riemann-liouville" and scene.initial_position.any():
        return f"{method.name} needs derivative: caputo, or an initial position of 0"
    return ""


@in_one_thread
def integrate_baseline(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    """The trajectory of a baseline on t_k = k T / N.

    Raises
    ------
    ValueError
        For scenes that the method is not made for.
    """
    if objection := baseline_objection(scene, method):
        raise ValueError(f"baseline: {objection}")
    began = time.perf_counter()
    steps = _EqualSteps(scene, n_steps)
    points = [_Point(scene.initial_position, scene.initial_velocity)]
    scheme, failure = SCHEMES[method.name](steps), ""
    ready = time.perf_counter()
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n_steps):
            try:
                point = next(scheme)
            except (StepFailedError, np.linalg.LinAlgError) as error:
                is_singular = isinstance(error, np.linalg.LinAlgError)
                words = no_unique_solution(steps.h) if is_singular else error
                failure = f"step {k}, t = {k * steps.h:.6g}: {words}"
                break
            if not np.isfinite(point.position).all():
                failure = not_finite(k, (k + 1) * steps.h)
                break
            points.append(point)
        position = np.array([point.position for point in points])
        velocity = _velocities(method, points, position, steps.h)
        momentum = None if velocity is None else velocity @ scene.inertia.mass
        times = steps.times[: len(points)]
        energy = None if momentum is None else scene.energy(position, momentum, times)
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
        newton=NewtonRecord(iterations=sum(point.iterations for point in points)),
        setup_seconds=ready - began,
        stepping_seconds=time.perf_counter() - ready,
    )


class _Point(NamedTuple):
    """The end of a step."""

    position: Array  # (d,)
    velocity: Array | None = None  # None where the method has none by itself
    iterations: int = 0  # of Newton


def _velocities(method: Baseline, points: list[_Point], position: Array, h: float) -> Array | None:
    """Velocities of the points; of Gruenwald-Letnikov differences of its positions."""
    if method.name == "product-integration":
        return None
    if method.name != "gruenwald-letnikov" or len(points) == 1:
        return np.array([point.velocity for point in points])
    velocity = np.gradient(position, h, axis=0, edge_order=2 if len(points) > 2 else 1)
    velocity[0] = points[0].velocity
    return np.asarray(velocity)


class _EqualSteps:
    """The times t_k = k T / N of a scene, its forces there, and the damping of a scheme."""

    def __init__(self, scene: Scene, n_steps: int) -> None:
        self.scene, self.n_steps, self.h = scene, n_steps, scene.final_time / n_steps
        none = QuadraticPotential(stiffness=np.zeros((scene.dimension, scene.dimension)))
        self.potential: Potential = scene.potential or none
        # as products: with other formulas round-off may put break points off the grid
        self.times = self.h * np.arange(n_steps + 1, dtype=float)
        self.operations = 0  # multiply-adds of the sums over the past

    def forcing(self) -> Array:
        """The forcing at all times, shape ``(N + 1, d)``."""
        if self.scene.forcing is None:
            return np.zeros((self.times.size, self.scene.dimension))
        return self.scene.forcing(self.times)


class _Past:
    """The sums over kept samples for all terms of the damping.

    ``weights(order, count)`` gives the first weights w of an order; ``offset(term)`` gives s, which
    the derivative of a term subtracts from the samples, ``(N + 1, d)`` or one for all times.
    """

    def __init__(
        self,
        steps: _EqualSteps,
        weights: Callable[[float, int], Array],
        offset: Callable[[FractionalDamping], Array],
    ) -> None:
        terms, (n, d) = steps.scene.active_damping, (steps.times.size, steps.scene.dimension)
        self._steps = steps
        matrices = np.array([term.matrix for term in terms]).reshape(-1, d, d)
        # from the sums of all terms, one after another, to the force
        self._to_force = matrices.swapaxes(1, 2).reshape(-1, d)
        self._backwards = np.empty((len(terms), 1, n))
        self._offsets, self._samples = np.empty((2, len(terms), n, d))
        for j, term in enumerate(terms):
            self._backwards[j, 0] = weights(term.order, n)[::-1]
            self._offsets[j] = offset(term)
        # D w_0, and its product with s at all times: for equations of the newest sample
        newest = self._backwards[..., -1:] * matrices
        self.newest = newest.sum(axis=0)
        self.newest_offset = (self._offsets @ newest.swapaxes(1, 2)).sum(axis=0)

    def keep(self, k: int, sample: Array) -> None:
        """Keep the sample y of time k."""
        self._samples[:, k] = sample - self._offsets[:, k]

    def force(self, k: int, newest: int) -> Array:
        """The force at time k from the samples of the times 0 to `newest`, k - 1 or k."""
        behind = self._steps.n_steps - k
        weights = self._backwards[..., behind : behind + newest + 1]
        self._steps.operations += len(self._to_force) * (newest + 1)
        sums = (weights @ self._samples[:, : newest + 1])[:, 0]
        return np.asarray(sums.ravel() @ self._to_force)


def _past_of_velocities(steps: _EqualSteps) -> _Past:
    r"""The damping :math:`h^{1-\gamma} \sum_n w_n v_{k-n}` of Euler's methods.

    The weights are those of :math:`(1 - z)^{\gamma - 1}` (Gruenwald-Letnikov on the velocity). For
    :math:`\gamma = 1` the sum is the velocity itself, and the schemes are the classical ones.
    """
    scene, h = steps.scene, steps.h
    past = _Past(
        steps,
        lambda order, count: h ** (1 - order) * convolution_weights(1, order - 1, count),
        lambda term: (term.order > 1 and scene.derivative == "caputo") * scene.initial_velocity,
    )
    past.keep(0, scene.initial_velocity)
    return past


def _past_of_positions(steps: _EqualSteps, weights: Callable[[float, int], Array]) -> _Past:
    """The damping by positions without what Caputo's derivative does not see.

    That is q0, or q0 + v0 t above order 1; order 1 does not depend on q0, which is subtracted so
    that the first difference is 0.
    """
    scene = steps.scene
    line = scene.initial_position + steps.times[:, None] * scene.initial_velocity

    def offset(term: FractionalDamping) -> Array:
        is_line = scene.derivative == "caputo" and term.order > 1
        return line if is_line else scene.initial_position

    past = _Past(steps, weights, offset)
    past.keep(0, scene.initial_position)
    return past


def _explicit_euler(steps: _EqualSteps) -> Iterator[_Point]:
    """Position and velocity, with all forces at the beginning of a step."""
    past, forces = _past_of_velocities(steps), steps.forcing()
    inverse_mass = np.linalg.inv(steps.scene.inertia.mass)
    position, velocity = steps.scene.initial_position, steps.scene.initial_velocity
    for k in range(steps.n_steps):
        force = forces[k] - past.force(k, k) - steps.potential.gradient(position)
        position = position + steps.h * velocity
        velocity = velocity + steps.h * (inverse_mass @ force)
        past.keep(k + 1, velocity)
        yield _Point(position, velocity)


def _implicit_euler(steps: _EqualSteps) -> Iterator[_Point]:
    """Position and velocity, with all forces at the end of a step."""
    scene, past = steps.scene, _past_of_velocities(steps)
    inertia, forces = scene.inertia.mass / steps.h, steps.forcing() + past.newest_offset
    matrix = inertia + past.newest
    position, velocity = scene.initial_position, scene.initial_velocity
    for k in range(steps.n_steps):
        velocity, iterations = solve_implicit(
            matrix,
            inertia @ velocity - past.force(k + 1, k) + forces[k + 1],
            steps.potential,
            velocity,
            base=position,
            factor=steps.h,
        )
        position = position + steps.h * velocity
        past.keep(k + 1, velocity)
        yield _Point(position, velocity, iterations)


def _gruenwald_letnikov(steps: _EqualSteps) -> Iterator[_Point]:
    r"""Central differences with the Gruenwald-Letnikov derivative of the positions.

    .. math:: M \frac{x_{k+1} - 2 x_k + x_{k-1}}{h^2}
              + \sum_j \mu_j h^{-\gamma_j} \sum_{n=0}^{k} w_n^{(j)} y_{k-n}
              + \nabla V(x_k) = f(t_k)

    with the coefficients of :math:`(1 - z)^{\gamma_j}` and y the part of x that Caputo's derivative
    acts on. Explicit. Order 1, that of the derivative. On a linear scene it is stable while
    h^2 k + mu (2/h)^gamma h^2 < 4.
    """
    scene, h, forces = steps.scene, steps.h, steps.forcing()
    past = _past_of_positions(
        steps, lambda order, count: h**-order * convolution_weights(1, order, count)
    )
    inverse_mass = np.linalg.inv(scene.inertia.mass)
    # the last difference x_k - x_(k-1), so that 1 / h^2 never multiplies a rounded position
    position, difference = scene.initial_position, h * scene.initial_velocity
    for k in range(steps.n_steps):
        force = forces[k] - past.force(k, k) - steps.potential.gradient(position)
        if k == 0:
            # the first difference of order 1 is 0 in place of v0, and the first step is half a step
            viscous = [term.matrix for term in scene.active_damping if term.is_integer_order]
            force = 0.5 * (force - sum(viscous, np.zeros_like(inverse_mass)) @ difference / h)
        difference = difference + h**2 * (inverse_mass @ force)
        position = position + difference
        past.keep(k + 1, position)
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
    past = _past_of_positions(steps, lambda order, count: trapezoidal_weights(2 - order, h, count))
    line = scene.initial_position + steps.times[:, None] * scene.initial_velocity
    known = line @ scene.inertia.mass + _forcing_twice_integrated(steps) + past.newest_offset
    matrix = scene.inertia.mass + past.newest
    position = scene.initial_position
    newest = steps.potential.gradient(position)
    # first and second integral of the potential force up to t_k
    once = twice = origin = np.zeros(scene.dimension)
    for k in range(steps.n_steps):
        gradient = newest
        position, iterations = solve_implicit(
            matrix,
            known[k + 1] - twice - h * once - h * h / 3 * gradient - past.force(k + 1, k),
            steps.potential,
            position,
            base=origin,
            weight=h * h / 6,
        )
        newest = steps.potential.gradient(position)
        twice = twice + h * once + h * h * (gradient / 3 + newest / 6)
        once = once + h / 2 * (gradient + newest)
        past.keep(k + 1, position)
        yield _Point(position, iterations=iterations)


def _forcing_twice_integrated(steps: _EqualSteps) -> Array:
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


def solve_implicit(
    linear: Array,
    constant: Array,
    potential: Potential,
    guess: Array,
    *,
    base: Array,
    factor: float = 1.0,
    weight: float = 1.0,
) -> tuple[Array, int]:
    r"""Solve :math:`A u + w \nabla V(b + c u) = r`, by Newton's iteration with the exact Jacobian.

    Returns u ``(d,)`` and the number of iterations, which is 0 if the equation is linear.

    Raises
    ------
    StepFailedError
        If no solution was found.
    """

    def equation(unknown: Array) -> tuple[Array, Array, Array]:
        at = base + factor * unknown
        inner, force = unknown @ linear.T, weight * potential.gradient(at)
        curvature = weight * potential.hessian(at)
        # round-off of positions, which enters through the second derivatives
        terms = np.abs(unknown) @ np.abs(linear.T) + np.abs(force) + np.abs(constant)
        shifted = np.abs(base) + np.abs(factor * unknown)
        terms = terms + np.einsum("nab,nb->na", np.abs(curvature), shifted)
        return inner + force - constant, linear + factor * curvature, terms

    if isinstance(potential, QuadraticPotential):
        (residual,), (jacobian,), _ = equation(guess[None])
        return guess - np.linalg.solve(jacobian, residual), 0
    roots, converged, iterations = find_roots(equation, guess[None])
    if not converged.all():
        raise StepFailedError(
            f"Newton's iteration did not converge in {iterations} iterations; take a smaller step"
        )
    return np.asarray(roots[0]), iterations


SCHEMES: dict[str, Callable[[_EqualSteps], Iterator[_Point]]] = {
    "explicit-euler": _explicit_euler,
    "implicit-euler": _implicit_euler,
    "gruenwald-letnikov": _gruenwald_letnikov,
    "product-integration": _product_integration,
}
"""Give the ends of the steps of a run, one by one."""
