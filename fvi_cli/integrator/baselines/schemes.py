"""The baselines with a memory of their own: what a step of each is, and the loop over all."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.advance import STRIDE, report_progress
from fvi_cli.integrator.baselines.past import Past, solve_implicit, without_start
from fvi_cli.integrator.baselines.results import baseline_operations, baseline_trajectory
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.growth_bound import beyond, bound_at_end
from fvi_cli.integrator.method import Baseline
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import convolution_weights


class Scheme(ABC):
    """A run by single steps of one size h."""

    iterations = 0
    """Of Newton, so far."""

    def __init__(self, scene: Scene, n_steps: int) -> None:
        self.scene = scene
        self.h = scene.final_time / n_steps
        self.inverse_mass = np.linalg.inv(scene.inertia.mass)
        # as products: quotients of sums would put break points beside the grid
        self.times = self.h * np.arange(n_steps + 1, dtype=float)
        self.position = np.empty((n_steps + 1, scene.dimension))
        self.position[0] = scene.initial_position

    @abstractmethod
    def advance(self, k: int) -> None:
        """From t_k to t_(k+1)."""

    def velocities(self, done: int) -> Array | None:
        """At the first points, shape ``(done + 1, d)``; None where the method has none."""
        return None

    def forcing(self) -> Array:
        """The forcing at all times, shape ``(N + 1, d)``."""
        if self.scene.forcing is None:
            return np.zeros_like(self.position)
        return self.scene.forcing(self.times)

    def potential_gradient(self, position: Array) -> Array:
        """Gradient of the potential."""
        if self.scene.potential is None:
            return np.zeros(self.scene.dimension)
        return self.scene.potential.gradient(position)


class Euler(Scheme):
    r"""Explicit or implicit Euler for position and velocity.

    The damping is :math:`h^{1-\gamma} \sum_n w_n v_{k-n}` with the weights of
    :math:`(1 - z)^{\gamma - 1}` (Gruenwald-Letnikov on the velocity), which for
    :math:`\gamma = 1` is the velocity itself, so that the schemes are the classical ones there.
    """

    def __init__(self, scene: Scene, n_steps: int) -> None:
        super().__init__(scene, n_steps)
        self.velocity = np.empty_like(self.position)
        self.velocity[0] = scene.initial_velocity
        self.forces = self.forcing()

        def weights(order: float, count: int) -> Array:
            return np.asarray(
                self.h ** (1 - order) * convolution_weights(1, order - 1, count), dtype=float
            )

        def offset(term: FractionalDamping) -> Array:
            is_shifted = term.order > 1 and scene.derivative == "caputo"
            return np.broadcast_to(is_shifted * scene.initial_velocity, self.velocity.shape)

        self.past = Past(scene, n_steps, weights, offset)
        self.past.keep(0, self.velocity[0])

    def velocities(self, done: int) -> Array:
        """Those of the scheme."""
        return self.velocity[: done + 1]


class ExplicitEuler(Euler):
    """Everything at the beginning of a step."""

    def advance(self, k: int) -> None:
        """From t_k to t_(k+1)."""
        force = self.forces[k] - self.past.force(k, k) - self.potential_gradient(self.position[k])
        self.velocity[k + 1] = self.velocity[k] + self.h * (self.inverse_mass @ force)
        self.position[k + 1] = self.position[k] + self.h * self.velocity[k]
        self.past.keep(k + 1, self.velocity[k + 1])


class ImplicitEuler(Euler):
    """Everything at the end of a step."""

    def __init__(self, scene: Scene, n_steps: int) -> None:
        super().__init__(scene, n_steps)
        self.inertia = scene.inertia.mass / self.h
        self.matrix = self.inertia + self.past.newest
        self.forces = self.forces + self.past.newest_offset

    def advance(self, k: int) -> None:
        """From t_k to t_(k+1)."""
        self.velocity[k + 1], used = solve_implicit(
            self.matrix,
            self.inertia @ self.velocity[k] - self.past.force(k + 1, k) + self.forces[k + 1],
            self.scene.potential,
            self.velocity[k],
            base=self.position[k],
            factor=self.h,
            weight=1.0,
        )
        self.iterations += used
        self.position[k + 1] = self.position[k] + self.h * self.velocity[k + 1]
        self.past.keep(k + 1, self.velocity[k + 1])


class GruenwaldLetnikov(Scheme):
    r"""Central differences with the Gruenwald-Letnikov derivative of the positions.

    .. math:: M \frac{x_{k+1} - 2 x_k + x_{k-1}}{h^2}
              + \sum_j \mu_j h^{-\gamma_j} \sum_{n=0}^{k} w_n^{(j)} y_{k-n}
              + \nabla V(x_k) = f(t_k)

    with the coefficients of :math:`(1 - z)^{\gamma_j}` and y what Caputo's derivative leaves of x
    (x - q0 - v0 t above order 1). Explicit. Order 1, that of the derivative. On a linear scene it
    is stable while h^2 k + mu (2/h)^gamma h^2 < 4.
    """

    def __init__(self, scene: Scene, n_steps: int) -> None:
        super().__init__(scene, n_steps)
        self.forces = self.forcing()
        # the last difference x_k - x_(k-1), so that 1 / h^2 never meets a rounded position
        self.difference = self.h * scene.initial_velocity

        def weights(order: float, count: int) -> Array:
            return np.asarray(self.h**-order * convolution_weights(1, order, count), dtype=float)

        self.past = Past(scene, n_steps, weights, without_start(scene, self.times))

    def advance(self, k: int) -> None:
        """From t_k to t_(k+1)."""
        scene = self.scene
        self.past.keep(k, self.position[k])
        force = self.forces[k] - self.past.force(k, k) - self.potential_gradient(self.position[k])
        if k == 0:
            for term in scene.active_damping:
                if term.is_integer_order:
                    force = force - scene.initial_velocity @ term.matrix
        share = 0.5 if k == 0 else 1.0
        self.difference = self.difference + share * self.h**2 * (self.inverse_mass @ force)
        self.position[k + 1] = self.position[k] + self.difference

    def velocities(self, done: int) -> Array:
        """Central differences."""
        points = self.position[: done + 1]
        velocity: Array = np.gradient(points, self.h, axis=0, edge_order=2 if done > 1 else 1)
        velocity[0] = self.scene.initial_velocity
        return velocity


class ProductIntegration(Scheme):
    r"""Second-order product integration of the integral equation of the scene.

    Integrated twice the equation of motion is

    .. math:: M (x - q_0 - v_0 t) + \sum_j \mu_j I^{2-\gamma_j} y_j + I^2 (\nabla V(x) - f) = 0

    with :math:`y_j` what Caputo's derivative leaves of x. Every integrand is replaced by its
    piecewise linear interpolant and integrated exactly against the kernel
    :math:`t^{1-\gamma}/\Gamma(2-\gamma)` (K. Diethelm, *The Analysis of Fractional Differential
    Equations*, Springer 2010, appendix C.1); the classical integrals (order 2, and 1 for damping of
    order 1) are running sums. Implicit. Order 2. It has positions only.
    """

    def __init__(self, scene: Scene, n_steps: int) -> None:
        super().__init__(scene, n_steps)
        line = scene.initial_position + self.times[:, None] * scene.initial_velocity
        self.known = line @ scene.inertia.mass + self._forcing_twice_integrated()

        def weights(order: float, count: int) -> Array:
            return trapezoidal_weights(2 - order, self.h, count)

        self.past = Past(scene, n_steps, weights, without_start(scene, self.times))
        self.past.keep(0, self.position[0])
        self.matrix = scene.inertia.mass + self.past.newest
        self.known = self.known + self.past.newest_offset
        self.newest = self.potential_gradient(self.position[0])
        # first and second integral of the potential force up to t_k
        self.once = self.twice = self.origin = np.zeros(scene.dimension)

    def advance(self, k: int) -> None:
        """From t_k to t_(k+1)."""
        h, gradient = self.h, self.newest
        known = self.known[k + 1] - self.twice - h * self.once - h * h / 3 * gradient
        solved, used = solve_implicit(
            self.matrix,
            known - self.past.force(k + 1, k),
            self.scene.potential,
            self.position[k],
            base=self.origin,
            factor=1.0,
            weight=h * h / 6,
        )
        self.iterations += 0 if self.scene.is_linear else used
        self.position[k + 1], self.newest = solved, self.potential_gradient(solved)
        self.twice = self.twice + h * self.once + h * h * (gradient / 3 + self.newest / 6)
        self.once = self.once + h / 2 * (gradient + self.newest)
        self.past.keep(k + 1, solved)

    def _forcing_twice_integrated(self) -> Array:
        """I^2 f at t_0 .. t_N for the interpolant of f, which may jump between steps."""
        twice = np.zeros_like(self.position)
        if self.scene.forcing is None:
            return twice
        h = self.h
        ends = self.scene.forcing.on_steps(self.times[:-1], h, np.array([0.0, 1.0]))
        once = np.zeros_like(twice[1:])
        once[1:] = np.cumsum(h / 2 * ends.sum(axis=1), axis=0)[:-1]
        twice[1:] = np.cumsum(h * once + h * h * (ends[:, 0] / 3 + ends[:, 1] / 6), axis=0)
        return twice


def trapezoidal_weights(order: float, step_size: float, n_weights: int) -> Array:
    r"""Weights of the fractional integral of a piecewise linear function that starts at 0.

    .. math:: b_0 = c, \qquad b_n = c \left((n+1)^{a+1} - 2 n^{a+1} + (n-1)^{a+1}\right),
              \qquad c = h^a / \Gamma(a + 2)

    Of order a > 0, so that :math:`I^a y(t_k) = \sum_{n=0}^{k} b_n y_{k-n}` where y_0 = 0.
    """
    n = np.arange(2, n_weights, dtype=float)
    # the second difference of n^(a+1) as differences from n^(a+1), which lose less
    tail = n ** (order + 1) * (
        np.expm1((order + 1) * np.log1p(1 / n)) + np.expm1((order + 1) * np.log1p(-1 / n))
    )
    weights = np.concatenate(([1.0, 2 ** (order + 1) - 2], tail))[:n_weights]
    return np.asarray(step_size**order / math.gamma(order + 2) * weights)


SCHEMES: dict[str, type[Scheme]] = {
    "explicit-euler": ExplicitEuler,
    "implicit-euler": ImplicitEuler,
    "gruenwald-letnikov": GruenwaldLetnikov,
    "product-integration": ProductIntegration,
}


def integrate_by_scheme(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    """The trajectory of a baseline of :data:`SCHEMES`."""
    began = time.perf_counter()
    scheme = SCHEMES[method.name](scene, n_steps)
    bound = bound_at_end(scene, n_steps)
    ready = time.perf_counter()
    position, h = scheme.position, scheme.h
    done, failure = 0, None
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n_steps):
            if k % STRIDE == 0:
                report_progress(k, n_steps)
            try:
                scheme.advance(k)
            except StepFailedError as error:
                failure = Failure.in_step(k, k * h, error)
                break
            done = k + 1
            failure = beyond(position[done], (position[done] - position[k]) / h, bound, done, h)
            if failure:
                break
        velocity = scheme.velocities(done)
    return baseline_trajectory(
        scene,
        position[: done + 1],
        velocity,
        n_steps,
        failure=failure,
        operations=baseline_operations(method.name, scene, done) or 0,
        iterations=scheme.iterations,
        began=began,
        ready=ready,
    )
