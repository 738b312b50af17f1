r"""Damping forces, stored energy, works and energy balance along finished runs.

One replay of the memory from its inputs in each step (velocities at the stages of Runge-Kutta
methods, the unknowns U for backward differences) gives the forces of the scheme, and its states
:math:`s_j`. With weights :math:`e_j` of the kernel

.. math:: E^\text{stored} = \tfrac12 \sum_j e_j\, s_j \cdot D s_j,

and :math:`H + E^\text{stored}` of a scene with quadratic potential, without forcing, with positive
damping falls in every single step of every mesh: the work against the damping is the increase of
the stored energy plus a sum of squares. (Caputo derivatives of order above 1 take the start
velocity from the velocity; then this holds where it is zero.)

With the increments of step k in the polynomial :math:`x_d`, the forces enter the equations of
motion by their moments :math:`g_{k\nu} = h \sum_i b_i l_\nu(c_i) f_{k,i}` against the basis, and
their work is

.. math:: W_k = \sum_\nu g_{k\nu} \cdot x_d'(d_\nu h; k) .

The balance of the energy is exact, whatever the step size, for a constant mass matrix, a quadratic
potential, as many Gauss points as the degree, ``forcing_quadrature: galerkin`` and no loads of
initial data: the action's step is then a Gauss method, which keeps quadratic invariants, and a kick
at a node does its work at the mean of the velocities before and after it. Otherwise the defects
fall with the order of the method. If a Riemann-Liouville derivative of order :math:`\gamma < 1`
turns an initial position into the force :math:`t^{-\gamma}`, they fall with
:math:`h^{2 - 2 \gamma}` at the points of a method: the velocity there is known to
:math:`t^{1 - \gamma}` only (measured).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.memory.damping import Damping, damping_of
from fvi_cli.integrator.memory.interface import Kernels
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.tables import step_tables
from fvi_cli.integrator.trajectory import Diagnostics
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis

PIECE = 16  # most equal steps that are computed together


@dataclass(frozen=True, kw_only=True, eq=False)
class DampingAlong:
    """The damping of q scenes of one kind along their runs of n steps."""

    damping: Damping
    mesh: Mesh
    inputs: Array  # of the components that the memory stores, (q, n, i, e)

    def forces(self) -> Array:
        r"""Forces :math:`\sum \mu D^\gamma q` at the samples, ``(q, n, m, d)``."""
        damping, q, found = self.damping, len(self.inputs), []
        for tables, driven, states, column in self._replay(PIECE):
            if tables is not None:
                count = driven.shape[1] // self.inputs.shape[2]
                force = damping.past(tables, states, column, count)
                force = force + damping.present(tables, driven, count)
                found.append(force.reshape(q, count, -1, force.shape[-1]))
        return np.concatenate(found, axis=1)

    def stored(self) -> Array | None:
        """Energy in the memory at the points, ``(q, n + 1)``.

        None for backward differences, whose weights are no positive sum of squares.
        """
        found = []
        for _, _, states, column in self._replay(1):
            energy = self.damping.energy(states[None], column[None])
            if energy is None:
                return None
            found.append(energy.sum(axis=(0, 1)))
        return np.stack(found, axis=1)

    def _replay(self, longest: int) -> Iterator[tuple[Kernels | None, Array, Array, Array]]:
        """Blocks of steps: tables, their inputs, and the states at their beginning.

        States are ``(q, J, e)``, those of a start velocity of -1 ``(1, J, 1)``. The last is the end
        of the run, without tables.
        """
        damping, (q, _, i, e) = self.damping, self.inputs.shape
        states, column = damping.start()
        known: dict[float, Kernels] = {}
        done = 0
        for one in self.mesh.stretches:
            for first in range(0, one.n_steps, longest):
                count = min(longest, one.n_steps - first)
                tables = known.get(one.step_size)
                if tables is None or tables.count < count:
                    tables = known[one.step_size] = damping.tables(one.step_size, count)
                driven = self.inputs[:, done : done + count].reshape(q, count * i, e)
                yield tables, driven, states, column
                states = tables.push(states, driven, count)
                column, done = damping.push_column(tables, column, count), done + count
        yield None, self.inputs[:, :0], states, column


def damping_along(
    scenes: Sequence[Scene], method: Method, steps: Sequence[RunSteps]
) -> DampingAlong | None:
    """The damping along runs on one mesh of scenes whose terms have the same pattern.

    None without damping.
    """
    mesh = steps[0].mesh(())
    damping = damping_of(
        scenes,
        method,
        shortest_step=mesh.shortest_step,
        steps=mesh.equivalent_steps,
        n_steps=None if method.is_runge_kutta else mesh.n_steps,
        in_reach=scenes[0].is_sparse,
    )
    if damping is None:
        return None
    inputs = np.stack([one.velocity for one in steps])
    if not method.is_runge_kutta:
        inputs = np.stack([step_tables(method).to_inputs @ one.unknowns for one in steps])
    return DampingAlong(
        damping=damping,
        mesh=mesh,
        inputs=damping.within(inputs),
    )


def diagnose(scene: Scene, method: Method, steps: RunSteps, loads: StepLoads) -> Diagnostics:
    """Works and energies at the points of a run under given forces, the loads."""
    along, damping, stored = damping_along([scene], method, [steps]), None, None
    if along is not None:
        damping = step_tables(method).to_loads @ along.forces()[0]
        damping = damping * steps.step_size[:, None, None]
        every = along.stored()
        stored = None if every is None else every[0]
    known = loads_along(loads, steps, scene.break_points)
    if damping is not None:
        damping = damping - known.get("weights", 0.0)
    basis = lobatto_basis(steps.tables.degree)
    slopes = basis.derivatives(basis.control_points)[1:]
    rates = np.einsum("vj,nvd->njd", slopes, steps.unknowns)
    dissipated, worked = _summed(damping, rates), _summed(known.get("forcing"), rates)
    linear = scene.linear_potential
    if linear is not None and scene.forcing is not None:
        # the work of the constant force is in the energy
        worked = worked - (steps.position - steps.position[0]) @ linear.force
    if method.sampling == "nodes" and damping is not None:
        # half of each kick is in the step before its point, half in the step after it
        kicks = 2.0 * np.concatenate([damping[:, 0], damping[-1:, -1]])
        dissipated = _work_of_kicks(scene, steps, kicks)
    dissipated = dissipated - _summed(known.get("initial"), rates)
    if scene.lagrangian is not None and scene.lagrangian.depends_on_time:
        at_stages = steps.stage_position, steps.velocity, steps.stage_time
        rate = scene.lagrangian.time_derivative(*at_stages)
        worked = worked - _running(steps.step_size * (rate @ steps.tables.weights))
    energy = scene.energy(steps.position, steps.momentum, steps.time)
    if steps.jump is not None:
        before = scene.energy(steps.position, steps.momentum - steps.jump, steps.time)
        dissipated = dissipated + np.cumsum(before - energy)
    return Diagnostics(
        time=steps.time,
        dissipated_work=dissipated,
        forcing_work=worked,
        energy_defect=energy - energy[0] + dissipated - worked,
        stored_energy=stored,
    )


def _work_of_kicks(scene: Scene, steps: RunSteps, kicks: Array) -> Array:
    """Work against kicks at the nodes, up to the middle of the kick at every grid point.

    The stored momentum is that in the middle of a kick, so its velocity is the mean of the
    velocities before and after the kick. The first half of a kick has its mean velocity a quarter
    of the kick before the middle.
    """
    velocity = scene.velocity
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
    """Sum of the changes over the steps up to every point, ``(n,)`` to ``(n + 1,)``."""
    return np.concatenate([[0.0], np.cumsum(changes)])


def loads_along(loads: StepLoads, steps: RunSteps, breaks: Sequence[float]) -> dict[str, Array]:
    """Load vectors of all steps of a run, ``(n, s + 1, d)``, by :meth:`.StepLoads.parts`.

    Forces may be singular at the start and at the breaks.
    """
    found = [
        loads.parts(one.begin, one.step_size, one.n_steps, is_fresh=one.is_fresh)
        for one in steps.mesh(breaks).stretches
    ]
    return {name: np.concatenate([one[name] for one in found]) for name in found[0]}
