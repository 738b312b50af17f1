r"""Works, energy balance and momentum maps along a discrete motion.

The balances are formed with the scheme's own quadrature. With the increments of step k in the
polynomial :math:`x_d`, the forces enter the equations of motion by their moments
:math:`g_{k\nu} = h \sum_i b_i l_\nu(c_i) f_{k,i}` against the basis, and their work and their pull
along :math:`\xi` are

.. math:: W_k = \sum_\nu g_{k\nu} \cdot x_d'(d_\nu h; k), \qquad
          \Lambda_k = \sum_\nu g_{k\nu} \cdot \xi(x_k^\nu).

What holds exactly, whatever the step size:

- the balance of every momentum map, for every variational method (`nodes`, `points`,
  Runge-Kutta): the discrete equations tested with :math:`\xi(x_k^\nu)` (Marsden, West, *Discrete
  mechanics and variational integrators*, Acta Numerica 2001, section 3.2);
- the balance of the energy, for a constant mass matrix, a quadratic potential, as many Gauss
  points as the degree and ``forcing_quadrature: galerkin``: the action's step is then a Gauss
  method, which keeps quadratic invariants, and a kick at a node does its work at the mean of the
  velocities before and after it.

Otherwise the defects fall with the order of the method; but with :math:`h^{2 - 2 \gamma}` at the
points of a method where a Riemann-Liouville derivative of order
:math:`\gamma < 1` makes the force :math:`t^{-\gamma}` of an initial position: the velocity that
meets it is known to :math:`t^{1 - \gamma}` only (measured).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.diagnostics_request import NOTHING as NOTHING
from fvi_cli.effects.diagnostics_request import Asked as Asked
from fvi_cli.effects.symmetry import Symmetry
from fvi_cli.integrator.equal_steps.balance_data import (
    Motion,
    control_places,
    control_rates,
    grid_velocity,
    paired,
    running_sum,
)

Array = NDArray[np.float64]


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
    stored_energy
        Energy in the memory of the damping, shape ``(n,)``; methods with a sum of exponentials.
    map_names
        Names of the symmetries.
    """

    dissipated_work: Array | None = None
    forcing_work: Array | None = None
    energy_defect: Array | None = None
    momentum_map: Array | None = None
    momentum_map_defect: Array | None = None
    stored_energy: Array | None = None
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
            stored_energy=picked(self.stored_energy),
            momentum_map=picked(self.momentum_map),
            momentum_map_defect=picked(self.momentum_map_defect),
        )


def diagnose(motion: Motion, asked: Asked) -> Diagnostics:
    """The diagnostics that are asked for, on the whole grid of the motion."""
    result = Diagnostics()
    if asked.energy_balance:
        result = _energy_balance(motion)
    if not asked.symmetries:
        return result
    maps = [one.momentum(motion.position, motion.momentum) for one in asked.symmetries]
    defects = [
        values - values[0] + _damping_less_forcing_along(motion, one)
        for one, values in zip(asked.symmetries, maps, strict=True)
    ]
    return replace(
        result,
        momentum_map=np.stack(maps, axis=1),
        momentum_map_defect=np.stack(defects, axis=1),
        map_names=tuple(one.name for one in asked.symmetries),
    )


def _energy_balance(motion: Motion) -> Diagnostics:
    rates = control_rates(motion)
    worked = running_sum(paired(motion.forcing_moments, rates, motion.n_steps))
    if motion.method.sampling == "nodes":
        dissipated = _work_of_kicks(motion)
    else:
        dissipated = running_sum(paired(motion.damping_moments(), rates, motion.n_steps))
    worked = worked - running_sum(_rate_of_lagrangian(motion, rates))
    return Diagnostics(
        dissipated_work=dissipated,
        forcing_work=worked,
        energy_defect=motion.energy - motion.energy[0] + dissipated - worked,
    )


def _work_of_kicks(motion: Motion) -> Array:
    """Work against kicks at the nodes, up to the middle of the kick at every grid point.

    The stored momentum is the one in the middle of a kick, so its velocity is the mean of those
    before and after it, and half a kick from there has its mean velocity a quarter of it earlier.
    """
    h, n = motion.step_size, motion.n_steps
    kick = h * motion.stepped.end_force[: n + 1, 0]
    middle = grid_velocity(motion, motion.momentum)
    whole = np.einsum("kd,kd->k", kick, middle)
    half = 0.5 * np.einsum("kd,kd->k", kick, grid_velocity(motion, motion.momentum + 0.25 * kick))
    return np.asarray(running_sum(whole[:-1]) + half)


def _rate_of_lagrangian(motion: Motion, rates: Array) -> Array:
    """Integral of the partial derivative of L by time over every step, shape ``(n,)``."""
    lagrangian, tables = motion.scene.lagrangian, motion.tables
    if lagrangian is None or not lagrangian.depends_on_time:
        return np.zeros(motion.n_steps)
    position = np.einsum("vm,kvd->kmd", tables.basis, control_places(motion))
    velocity = np.einsum("vm,kvd->kmd", tables.basis, rates)
    left = motion.step_size * np.arange(motion.n_steps, dtype=float)
    time = left[:, None] + motion.step_size * tables.points
    rate = lagrangian.time_derivative(position, velocity, time)
    return np.asarray(motion.step_size * rate @ tables.weights)


def _damping_less_forcing_along(motion: Motion, symmetry: Symmetry) -> Array:
    """Running integral of both forces along a symmetry, shape ``(n + 1,)``."""
    places = control_places(motion)
    changes = paired(motion.forcing_moments, symmetry.direction(places), motion.n_steps)
    return _damping_along(motion, symmetry, places) - running_sum(changes)


def _damping_along(motion: Motion, symmetry: Symmetry, places: Array) -> Array:
    """Running integral of the damping force along a symmetry, shape ``(n + 1,)``."""
    total = running_sum(
        paired(motion.damping_moments(), symmetry.direction(places), motion.n_steps)
    )
    if motion.method.sampling != "nodes":
        return total
    kick = motion.step_size * motion.stepped.end_force[: motion.n_steps + 1, 0]
    along = np.einsum("kd,kd->k", kick, symmetry.direction(motion.position))
    return np.asarray(total + 0.5 * along)
