r"""Works, energy balance and momentum maps along a discrete motion.

The balances are formed with the scheme's own quadrature. With the increments of step k in the
polynomial :math:`x_d`, the forces enter the equations of motion by their moments
:math:`g_{k\nu} = h \sum_i b_i l_\nu(c_i) f_{k,i}` against the basis, and their work and their pull
along :math:`\xi` are

.. math:: W_k = \sum_\nu g_{k\nu} \cdot x_d'(d_\nu h; k), \qquad
          \Lambda_k = \sum_\nu g_{k\nu} \cdot \xi(x_k^\nu).

What holds exactly, whatever the step size:

- the balance of every momentum map, for every variational method (`nodes`, `points`, Runge-Kutta)
  without a start series: the discrete equations tested with :math:`\xi(x_k^\nu)` (Marsden, West,
  *Discrete mechanics and variational integrators*, Acta Numerica 2001, section 3.2);
- the balance of the energy, for a constant mass matrix, a quadratic potential, as many Gauss
  points as the degree, ``forcing_quadrature: galerkin`` and no start series: the action's step is
  then a Gauss method, which keeps quadratic invariants, and a kick at a node does its work at the
  mean of the velocities before and after it.

Otherwise the defects fall with the order of the method. Beside a known part S of the motion the
works in which S takes part are integrated to round-off, since S begins with fractional powers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.known_part import KnownPart
from fvi_cli.integrator.memory import Memory
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.moments import StepFunction, exact_integrals, exact_moments
from fvi_cli.integrator.stage_basis import legendre_stages
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.stepping import Stepped
from fvi_cli.mathematics.lagrange import LagrangeBasis, lobatto_basis

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Asked:
    """Which diagnostics are computed beside a trajectory; by default none.

    Parameters
    ----------
    energy_balance
        Dissipated work, work of the forcing, and the defect of the energy balance.
    symmetries
        Symmetries whose momentum maps are followed.
    """

    energy_balance: bool = False
    symmetries: tuple[Symmetry, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether nothing is asked for."""
        return not (self.energy_balance or self.symmetries)


NOTHING = Asked()


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnostics:
    r"""Diagnostics on the grid of a trajectory of n points; None where they were not asked for.

    Parameters
    ----------
    dissipated_work
        :math:`W_d(t) = \int_0^t v \cdot \sum_j \mu_j D^{\gamma_j} q`, shape ``(n,)``.
    forcing_work
        :math:`W_f(t) = \int_0^t v \cdot f`, less :math:`\int_0^t \partial_t L`, shape ``(n,)``.
    energy_defect
        :math:`E(t) - E(0) + W_d(t) - W_f(t)`, shape ``(n,)``.
    momentum_map
        :math:`J_a = p \cdot \xi_a(q)`, one column for every symmetry, shape ``(n, a)``.
    momentum_map_defect
        :math:`J_a(t) - J_a(0) + \int_0^t (\sum_j \mu_j D^{\gamma_j} q - f) \cdot \xi_a(q)`.
    map_names
        Names of the symmetries.
    """

    dissipated_work: Array | None = None
    forcing_work: Array | None = None
    energy_defect: Array | None = None
    momentum_map: Array | None = None
    momentum_map_defect: Array | None = None
    map_names: tuple[str, ...] = ()

    def at(self, kept: NDArray[np.intp]) -> Diagnostics:
        """The same on some points of the grid."""

        def picked(values: Array | None) -> Array | None:
            return None if values is None else values[kept]

        return replace(
            self,
            dissipated_work=picked(self.dissipated_work),
            forcing_work=picked(self.forcing_work),
            energy_defect=picked(self.energy_defect),
            momentum_map=picked(self.momentum_map),
            momentum_map_defect=picked(self.momentum_map_defect),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What the steps of a scene gave, with what is needed to form its balances.

    Parameters
    ----------
    scene, method, tables, memory, step_size
        What was integrated and how.
    stepped
        The steps, with their increments, cut where the trajectory ends.
    moments
        Moments of the known force, shape ``(N, s + 1, d)``; None when there is none.
    forcing_moments
        The part of `moments` that belongs to the forcing of the scene.
    known
        Part of the motion that is known in advance; None: the steps gave all of it.
    jump
        Force by which Riemann-Liouville differs from Caputo, where `known` does not hold it.
    position, momentum, energy
        On the grid, as in the trajectory.
    """

    scene: Scene
    method: Method
    tables: StepTables
    memory: Memory
    step_size: float
    stepped: Stepped
    moments: Array | None
    forcing_moments: Array | None
    known: KnownPart | None
    jump: StepFunction | None
    position: Array
    momentum: Array
    energy: Array

    @property
    def n_steps(self) -> int:
        """Number of finished steps."""
        return int(self.position.shape[0]) - 1

    @property
    def increments(self) -> Array:
        """Increments of the finished steps, shape ``(n, s, d)``.

        Raises
        ------
        ValueError
            If the steps have not kept them.
        """
        if self.stepped.increments is None:
            raise ValueError("diagnostics: the increments of the steps were not kept")
        return self.stepped.increments[: self.n_steps]

    def damping_moments(self) -> Array:
        """Moments of the damping force, opposite in sign to its action, shape ``(n, s + 1, d)``."""
        n = self.n_steps
        force = self.stepped.end_force[:n]
        total = self.step_size * np.einsum("vm,kmd->kvd", self.memory.force_weights, force)
        if self.known is None and self.moments is not None:
            # what is known of the damping force itself: the jump of Riemann-Liouville at 0
            total = total - self.moments[:n]
            if self.forcing_moments is not None:
                total = total + self.forcing_moments[:n]
        return np.asarray(total)


def diagnose(motion: Motion, asked: Asked) -> Diagnostics:
    """The diagnostics that are asked for, on the whole grid of the motion."""
    result = Diagnostics()
    if asked.energy_balance:
        result = _energy_balance(motion)
    if not asked.symmetries:
        return result
    maps = [one.momentum(motion.position, motion.momentum) for one in asked.symmetries]
    defects = [
        values - values[0] + _damping_along(motion, one) - _forcing_along(motion, one)
        for one, values in zip(asked.symmetries, maps, strict=True)
    ]
    return replace(
        result,
        momentum_map=np.stack(maps, axis=1),
        momentum_map_defect=np.stack(defects, axis=1),
        map_names=tuple(one.name for one in asked.symmetries),
    )


def _energy_balance(motion: Motion) -> Diagnostics:
    rates = _rates(motion)
    if motion.known is not None:
        known = motion.known
        dissipated = _with_known(motion, rates, known.velocity)
        worked = _forcing_with_known(motion, rates, known.velocity)
    else:
        worked = _running(_paired(motion.forcing_moments, rates, motion.n_steps))
        if motion.method.sampling == "nodes":
            dissipated = _work_of_kicks(motion)
        else:
            dissipated = _running(_paired(motion.damping_moments(), rates, motion.n_steps))
    worked = worked - _running(_rate_of_lagrangian(motion, rates))
    return Diagnostics(
        dissipated_work=dissipated,
        forcing_work=worked,
        energy_defect=motion.energy - motion.energy[0] + dissipated - worked,
    )


def _rates(motion: Motion) -> Array:
    """Velocity of the unknown at the control points, shape ``(n, s + 1, d)``."""
    basis = lobatto_basis(motion.tables.degree)
    slopes = basis.derivatives(motion.tables.control_points)[1:]
    return np.asarray(np.einsum("vj,kvd->kjd", slopes, motion.increments) / motion.step_size)


def _places(motion: Motion) -> Array:
    """Positions of the unknown at the control points, shape ``(n, s + 1, d)``."""
    start = motion.stepped.position[: motion.n_steps, None]
    return np.concatenate([start, start + motion.increments], axis=1)


def _paired(moments: Array | None, values: Array, n_steps: int) -> Array:
    """Sum of moments times values at the control points, shape ``(n,)``."""
    if moments is None:
        return np.zeros(n_steps)
    return np.asarray(np.einsum("kvd,kvd->k", moments[:n_steps], values))


def _running(changes: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(changes)])


def _work_of_kicks(motion: Motion) -> Array:
    """Work against kicks at the nodes, up to the middle of the kick at every grid point.

    The stored momentum is the one in the middle of a kick, so its velocity is the mean of those
    before and after it, and half a kick from there has its mean velocity a quarter of it earlier.
    """
    h, n = motion.step_size, motion.n_steps
    kick = h * motion.stepped.end_force[: n + 1, 0]
    middle = _velocity(motion, motion.momentum)
    whole = np.einsum("kd,kd->k", kick, middle)
    half = 0.5 * np.einsum("kd,kd->k", kick, _velocity(motion, motion.momentum + 0.25 * kick))
    return np.asarray(_running(whole[:-1]) + half)


def _velocity(motion: Motion, momentum: Array) -> Array:
    lagrangian = motion.scene.lagrangian
    if lagrangian is None:
        return np.asarray(np.linalg.solve(motion.scene.inertia.mass, momentum[..., None])[..., 0])
    time = motion.step_size * np.arange(momentum.shape[0], dtype=float)
    return lagrangian.velocity(motion.position, momentum, time)


def _rate_of_lagrangian(motion: Motion, rates: Array) -> Array:
    """Integral of the partial derivative of L by time over every step, shape ``(n,)``."""
    lagrangian, tables = motion.scene.lagrangian, motion.tables
    if lagrangian is None or not lagrangian.depends_on_time:
        return np.zeros(motion.n_steps)
    position = np.einsum("vm,kvd->kmd", tables.basis, _places(motion))
    velocity = np.einsum("vm,kvd->kmd", tables.basis, rates)
    left = motion.step_size * np.arange(motion.n_steps, dtype=float)
    if motion.known is not None:
        position = position + motion.known.position(left, motion.step_size, tables.points)
        velocity = velocity + motion.known.velocity(left, motion.step_size, tables.points)
    time = left[:, None] + motion.step_size * tables.points
    rate = lagrangian.time_derivative(position, velocity, time)
    return np.asarray(motion.step_size * rate @ tables.weights)


def _damping_along(motion: Motion, symmetry: Symmetry) -> Array:
    """Running integral of the damping force along a symmetry, shape ``(n + 1,)``."""
    places = _places(motion)
    if motion.known is not None:
        turned = places @ symmetry.generator.T
        return _with_known(motion, turned, _direction_of(motion.known, symmetry))
    total = _running(_paired(motion.damping_moments(), symmetry.direction(places), motion.n_steps))
    if motion.method.sampling != "nodes":
        return total
    kick = motion.step_size * motion.stepped.end_force[: motion.n_steps + 1, 0]
    along = np.einsum("kd,kd->k", kick, symmetry.direction(motion.position))
    return np.asarray(total + 0.5 * along)


def _forcing_along(motion: Motion, symmetry: Symmetry) -> Array:
    """Running integral of the forcing along a symmetry, shape ``(n + 1,)``."""
    places = _places(motion)
    if motion.known is not None:
        turned = places @ symmetry.generator.T
        return _forcing_with_known(motion, turned, _direction_of(motion.known, symmetry))
    paired = _paired(motion.forcing_moments, symmetry.direction(places), motion.n_steps)
    return _running(paired)


# Beside a known part S of the motion: u is what the steps gave, F[u] its damping force.


def _direction_of(known: KnownPart, symmetry: Symmetry) -> StepFunction:
    def direction(start: Array, step_size: float, offsets: Array) -> Array:
        return symmetry.direction(known.position(start, step_size, offsets))

    return direction


def _with_known(motion: Motion, of_unknown: Array, of_known: StepFunction) -> Array:
    """Running integral of the whole damping force times a field, shape ``(n + 1,)``.

    Parameters
    ----------
    motion
        With a known part S.
    of_unknown
        The part of the field that depends on u, at the control points, shape ``(n, s + 1, d)``.
    of_known
        The part that depends on S.
    """
    known = motion.known
    if known is None:
        raise ValueError("diagnostics: the motion has no known part")
    tables, n = motion.tables, motion.n_steps
    force = motion.stepped.end_force[:n]
    if motion.method.is_runge_kutta:
        values = legendre_stages(tables.sample_points).to_values
        force = np.einsum("im,kmd->kid", values, force)
    field = np.einsum("vm,kvd->kmd", tables.sample_basis, of_unknown)
    changes = np.einsum("m,kmd,kmd->k", motion.step_size * tables.sample_weights, force, field)
    at_control = np.einsum("iv,kid->kvd", _from_samples(tables), force)
    changes += _paired(_known_moments(motion, of_known), at_control, n)
    changes += _known_force_on(motion, known.damping_force, of_unknown, of_known)
    if motion.jump is not None:
        changes -= _known_force_on(motion, motion.jump, of_unknown, of_known)
    return _running(changes)


def _from_samples(tables: StepTables) -> Array:
    """The polynomials on the sampling points at the control points, shape ``(m, s + 1)``."""
    if tables.sample_points.size == 1:
        return np.ones((1, tables.control_points.size))
    return LagrangeBasis(control_points=tables.sample_points).values(tables.control_points)


def _forcing_with_known(motion: Motion, of_unknown: Array, of_known: StepFunction) -> Array:
    forcing = motion.scene.forcing
    if forcing is None:
        return np.zeros(motion.n_steps + 1)
    return _running(_known_force_on(motion, forcing.on_steps, of_unknown, of_known))


def _known_force_on(
    motion: Motion, force: StepFunction, of_unknown: Array, of_known: StepFunction
) -> Array:
    """Integral over every step of a known force times a field, shape ``(n,)``."""

    def product(start: Array, step_size: float, offsets: Array) -> Array:
        pair = force(start, step_size, offsets) * of_known(start, step_size, offsets)
        return np.asarray(pair.sum(axis=-1, keepdims=True))

    n = motion.n_steps
    both = exact_integrals(product, motion.step_size, n, _singular_steps(motion))[:, 0]
    return np.asarray(both + _paired(_known_moments(motion, force), of_unknown, n))


def _known_moments(motion: Motion, function: StepFunction) -> Array:
    """Moments to round-off, since what is known begins with fractional powers at every break."""
    return exact_moments(
        function, motion.method, motion.step_size, motion.n_steps, _singular_steps(motion)
    )


def _singular_steps(motion: Motion) -> tuple[int, ...]:
    breaks = steps_at_break_points(motion.scene, round(motion.scene.final_time / motion.step_size))
    return tuple(step for step in (0, *breaks) if step < motion.n_steps)
