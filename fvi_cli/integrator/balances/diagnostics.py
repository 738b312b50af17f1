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

from fvi_cli.effects.diagnostics_request import NOTHING as NOTHING
from fvi_cli.effects.diagnostics_request import Asked as Asked
from fvi_cli.effects.dynamics import General, Separable
from fvi_cli.integrator.results.diagnostics import Diagnostics
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis


@dataclass(frozen=True, kw_only=True, eq=False)
class BalanceData:
    """What the steps of a run gave, as its balances need it.

    Parameters
    ----------
    steps
        The run.
    dynamics
        The conservative part of the scene.
    energy
        Mechanical energy at the points of the mesh, shape ``(n + 1,)``.
    damping, forcing
        Load vectors of the damping force, opposite in sign to its action, and of the forcing,
        shape ``(n, s + 1, d)``; None without.
    kicks
        Impulses of the damping force at the points, shape ``(n + 1, d)``, of methods that sample
        it there.
    stored
        Energy in the memory of the damping, shape ``(n + 1,)``.
    """

    steps: RunSteps
    dynamics: Separable | General
    energy: Array
    damping: Array | None
    forcing: Array | None
    kicks: Array | None = None
    stored: Array | None = None


def diagnose(motion: BalanceData, asked: Asked) -> Diagnostics:
    """The diagnostics that are asked for, on the points of the mesh."""
    result = _energy_balance(motion) if asked.energy_balance else Diagnostics()
    if not asked.symmetries:
        return result
    steps = motion.steps
    start = steps.position[:-1, None]
    places = start + steps.step_size[:, None, None] * steps.unknowns
    places = np.concatenate([start, places], axis=1)
    maps, defects = [], []
    for one in asked.symmetries:
        along = one.direction(places)
        pull = _summed(motion.damping, along) - _summed(motion.forcing, along)
        maps.append(one.momentum(steps.position, steps.momentum))
        defects.append(maps[-1] - maps[-1][0] + pull)
    return replace(
        result,
        momentum_map=np.stack(maps, axis=1),
        momentum_map_defect=np.stack(defects, axis=1),
        map_names=tuple(one.name for one in asked.symmetries),
    )


def _energy_balance(motion: BalanceData) -> Diagnostics:
    steps, dynamics = motion.steps, motion.dynamics
    basis = lobatto_basis(steps.tables.degree)
    slopes = basis.derivatives(basis.control_points)[1:]
    rates = np.einsum("vj,nvd->njd", slopes, steps.unknowns)
    dissipated = _summed(motion.damping, rates)
    if motion.kicks is not None:
        dissipated = _work_of_kicks(motion, motion.kicks)
    worked = _summed(motion.forcing, rates)
    if isinstance(dynamics, General) and dynamics.lagrangian.depends_on_time:
        rate = dynamics.lagrangian.time_derivative(
            steps.stage_position, steps.velocity, steps.stage_time
        )
        worked -= _running(steps.step_size * (rate @ steps.tables.weights))
    return Diagnostics(
        dissipated_work=dissipated,
        forcing_work=worked,
        energy_defect=motion.energy - motion.energy[0] + dissipated - worked,
        stored_energy=motion.stored,
    )


def _work_of_kicks(motion: BalanceData, kicks: Array) -> Array:
    """Work against kicks at the nodes, up to the middle of the kick at every grid point.

    The stored momentum is the one in the middle of a kick, so its velocity is the mean of those
    before and after it, and half a kick from there has its mean velocity a quarter of it earlier.
    """
    steps, velocity = motion.steps, motion.dynamics.velocity
    middle = velocity(steps.position, steps.momentum, steps.time)
    earlier = velocity(steps.position, steps.momentum + 0.25 * kicks, steps.time)
    whole, half = (np.einsum("kd,kd->k", kicks, one) for one in (middle, 0.5 * earlier))
    return np.asarray(_running(whole[:-1]) + half)


def _summed(loads: Array | None, values: Array) -> Array:
    """Running sum over the steps of load vectors times values at the control points."""
    if loads is None:
        return np.zeros(values.shape[0] + 1)
    return _running(np.einsum("nvd,nvd->n", loads, values))


def _running(changes: Array) -> Array:
    """Sum of the changes over the steps up to every point, shape ``(n,)`` to ``(n + 1,)``."""
    return np.concatenate([[0.0], np.cumsum(changes)])
