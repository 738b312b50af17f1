r"""Runge-Kutta steps with every sum of the memory written out: the other route of many tests.

The equations are those of :mod:`fvi_cli.integrator.engine.step`. The force of a
term is

.. math:: F_k = \mu h^{1 - \gamma} \sum_{n=0}^{k} W_n (V_{k-n} - \sigma v_0), \qquad
          \sum_n W_n z^n = \Delta(z)^{\gamma - 1},

with the weights :math:`W_n` from an integral over a circle inside of the unit one. Nothing is
shared with the engine but the tableaux and the derivatives of the scene.
"""

import contextlib
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
from runge_kutta_symbol import ButcherTableau, symbol_power, tableau

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.memory import lags
from fvi_cli.integrator.meshes.mesh import uniform_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import StepTables, step_tables

Array = np.ndarray

POINTS_PER_WEIGHT = 16
"""Points of the circle for each weight: the radius is that root of the round-off."""
NEWTON_LIMIT = 40


def power_weights(method: ButcherTableau, theta: float, count: int) -> Array:
    """The first `count` coefficients of ``Delta(z)**theta``, shape ``(count, m, m)``."""
    size = max(POINTS_PER_WEIGHT * count, 64)
    radius = np.exp(np.log(np.finfo(float).eps) / size)
    z = radius * np.exp(2j * np.pi * np.arange(size) / size)
    values = symbol_power(method, theta, z)
    found = np.fft.fft(values, axis=0).real[:count] / size
    return found * radius ** -np.arange(count, dtype=float)[:, None, None]


def left_operator_rk(method: ButcherTableau, theta: float, h: float, values: Array) -> Array:
    """``(Delta / h)**theta`` applied to stage values of all steps, shape ``(N, m, ...)``."""
    weights = power_weights(method, theta, values.shape[0])
    result = np.zeros_like(values)
    for k in range(values.shape[0]):
        result[k] = np.einsum("nij,nj...->i...", weights[: k + 1], values[k::-1])
    return h**-theta * result


@dataclass(frozen=True, kw_only=True)
class WrittenOut:
    """Positions and momenta on the grid, ``(N + 1, d)``, and stage velocities, ``(N, m, d)``."""

    position: Array
    momentum: Array
    velocity: Array


def known_moments(scene: Scene, method: Method, n_steps: int) -> Array:
    """Load vectors of the forcing and of what Riemann-Liouville adds to Caputo."""
    tables, h = step_tables(method), scene.final_time / n_steps
    total = np.zeros((n_steps, tables.degree + 1, scene.dimension))
    loads = StepLoads(scene, method, tables)
    parts = uniform_mesh(scene.final_time, n_steps, scene.break_points).stretches
    ends = itertools.accumulate((one.n_steps for one in parts), initial=0)
    for first, end in itertools.pairwise(ends):
        part = loads.of_steps(first * h, h, end - first, is_fresh=True)
        total[first:end] += 0.0 if part is None else part
    return total


def integrate_written_out(scene: Scene, method: Method, n_steps: int) -> WrittenOut:
    """N equal steps of a Runge-Kutta method with ``start: none``."""
    tables, h = step_tables(method), scene.final_time / n_steps
    m, d = tables.points.size, scene.dimension
    own = tableau(method.cq, method.stages)
    terms = []
    for term in scene.active_damping:
        weights = power_weights(own, term.order - 1.0, n_steps)
        away = scene.initial_velocity if scene.derivative == "caputo" and term.order > 1 else 0.0
        terms.append((h ** (1.0 - term.order) * weights, away, term.coefficient))
    moments = known_moments(scene, method, n_steps)
    rates = tables.slopes[1:].T / h
    position, momentum = np.empty((n_steps + 1, d)), np.empty((n_steps + 1, d))
    position[0] = scene.initial_position
    momentum[0] = _start_momentum(scene)
    velocity = np.empty((n_steps, m, d))
    increments = np.outer(h * tables.control_points[1:], scene.initial_velocity)
    for k in range(n_steps):
        past = np.zeros((m, d))
        for weights, away, matrix in terms:
            finished = velocity[:k] - away
            past += (
                np.einsum("nij,njd->id", weights[k:0:-1], finished)
                - weights[0].sum(1)[:, None] * away
            ) @ matrix
        time = h * (k + tables.points)
        increments = _solve(
            scene, tables, terms, position[k], momentum[k], past, moments[k], time, increments, h
        )
        velocity[k] = rates @ increments
        force = past + sum(
            ((w[0] @ velocity[k]) @ matrix for w, _, matrix in terms), start=np.zeros((m, d))
        )
        points = position[k] + tables.basis[1:].T @ increments
        pull = _derivatives(scene, points, velocity[k], time)[1]
        position[k + 1] = position[k] + increments[-1]
        momentum[k + 1] = momentum[k] + h * tables.weights @ (pull - force) + moments[k].sum(axis=0)
    return WrittenOut(position=position, momentum=momentum, velocity=velocity)


def _start_momentum(scene: Scene) -> Array:
    if scene.lagrangian is None:
        return scene.inertia.mass @ scene.initial_velocity
    return scene.lagrangian.forces(scene.initial_position, scene.initial_velocity, 0.0)[0]


def _derivatives(
    scene: Scene, points: Array, velocity: Array, time: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Momentum, force, and the second derivatives of L by v v, v q and q q."""
    if scene.lagrangian is not None:
        at = scene.lagrangian.derivatives(points, velocity, time)
        return at.momentum, at.force, at.mass, at.mixed, at.stiffness
    m, d = points.shape
    zero = np.zeros((m, d, d))
    mass = np.broadcast_to(scene.inertia.mass, zero.shape)
    if scene.potential is None:
        return velocity @ scene.inertia.mass, np.zeros((m, d)), mass, zero, zero
    hessian = np.broadcast_to(scene.potential.hessian(points), zero.shape)
    return (velocity @ scene.inertia.mass, -scene.potential.gradient(points), mass, zero, -hessian)


def _solve(
    scene: Scene,
    tables: StepTables,
    terms: list,
    start: Array,
    momentum: Array,
    past: Array,
    moments: Array,
    time: Array,
    guess: Array,
    h: float,
) -> Array:
    """Increments of a step by Newton's iteration, down to round-off."""
    s, d = tables.degree, scene.dimension
    values, slopes = tables.weights * tables.basis[:-1], tables.weights * tables.slopes[:-1]
    places, rates = tables.basis[1:], tables.slopes[1:] / h
    increments, previous = guess.copy(), np.inf
    for _ in range(NEWTON_LIMIT):
        points, velocity = start + places.T @ increments, rates.T @ increments
        p, f, mass, mixed, stiffness = _derivatives(scene, points, velocity, time)
        force = past.copy()
        damping = np.zeros((s * d, s * d))
        for weights, _, matrix in terms:
            force += (weights[0] @ velocity) @ matrix
            damping += np.kron(h * values @ weights[0] @ rates.T, matrix.T)
        residual = slopes @ p + h * values @ (f - force) + moments[:-1]
        residual[0] += momentum
        jacobian = np.einsum("ni,mi,iab->namb", slopes, rates, mass)
        jacobian += np.einsum("ni,mi,iab->namb", slopes, places, mixed)
        jacobian += np.einsum("ni,mi,iba->namb", h * values, rates, mixed)
        jacobian += np.einsum("ni,mi,iab->namb", h * values, places, stiffness)
        update = np.linalg.solve(jacobian.reshape(s * d, -1) - damping, residual.ravel())
        increments = increments - update.reshape(s, d)
        size = float(np.abs(update).max())
        if size == 0 or (size >= 0.5 * previous and size < 1e-9 * np.abs(increments).max()):
            break
        previous = size
    return increments


@contextlib.contextmanager
def every_lag_written_out() -> Iterator[None]:
    """Let backward differences keep all lags, so that their sums are the direct ones."""
    near = dict.fromkeys(lags.NEAR_LAGS, 2**40)
    with patch.object(lags, "NEAR_LAGS", near):
        yield
