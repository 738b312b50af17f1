r"""Balances of a run on any mesh, with the scheme's own quadrature.

The force of the damping at the stages is found anew from the velocities there, with the energy
that it stores. With the states :math:`s_j` of the damping and weights :math:`e_j` of the kernel

.. math:: E^\text{stored} = \tfrac12 \sum_j e_j\, s_j \cdot D s_j,

and :math:`H + E^\text{stored}` of a scene with quadratic potential, without forcing, with positive
damping falls in every single step of every mesh: the work against the damping is the increase of
what is stored and a sum of squares. (Caputo derivatives of order above 1 take the start velocity
from the velocity; then this holds where it is zero.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.dynamics import dynamics_of
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.diagnostics import Asked, BalanceData, diagnose
from fvi_cli.integrator.damping.damper_forces import (
    forces_of_dampers,
    pieces_of_equal_steps,
    stored_energy,
)
from fvi_cli.integrator.damping.damping import Damping, damping_of
from fvi_cli.integrator.engine.frame import sampling_of
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.memory.reach import Reach, find_reach
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.diagnostics import Diagnostics
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class DampingAlong:
    """The damping of q scenes of one kind along their runs.

    Parameters
    ----------
    damping
        That of all scenes.
    reach
        What it reaches of a large structure; None: all components.
    step_sizes, inputs
        Lengths of the steps, ``(n,)``, and what drives the memory in each, ``(q, n, i, e)``.
    """

    damping: Damping
    reach: Reach | None
    step_sizes: Array
    inputs: Array

    def forces(self) -> Array:
        r"""Forces :math:`\mu D^\gamma q` by direction at the samples, ``(k, q, n, m, d)``."""
        found = forces_of_dampers(self.damping, self.step_sizes, self.inputs)
        return found if self.reach is None else self.reach.spread(found)

    def stored(self) -> Array | None:
        """Energy in the memory at the points, ``(q, n + 1)``; None for backward differences."""
        found = stored_energy(self.damping, self.step_sizes, self.inputs)
        return None if found is None else np.asarray(found.sum(axis=0))


def damping_along(
    scenes: Sequence[Scene],
    method: Method,
    mesh: Mesh,
    steps: Sequence[RunSteps],
    *,
    is_separate: bool = False,
) -> DampingAlong | None:
    """The damping along runs on one mesh of scenes whose terms have the same pattern.

    Parameters
    ----------
    scenes, method
        What moved, and how.
    mesh
        Of the whole runs, which may have ended before.
    steps
        As many of every run.
    is_separate
        Whether every damping term and law has a direction of its own.

    Returns
    -------
    DampingAlong or None
        None: nothing damps.
    """
    reach = find_reach(scenes[0].active_forces) if scenes[0].is_sparse else None
    damping = damping_of(
        scenes,
        method,
        shortest_step=mesh.shortest_step,
        steps=mesh.equivalent_steps,
        n_steps=None if method.is_runge_kutta else mesh.n_steps,
        reach=reach,
        is_separate=is_separate,
    )
    if damping is None:
        return None
    inputs = np.stack([one.velocity for one in steps])
    if not method.is_runge_kutta:
        inputs = np.stack([sampling_of(method).to_inputs @ one.unknowns for one in steps])
    return DampingAlong(
        damping=damping,
        reach=reach,
        step_sizes=steps[0].step_size,
        inputs=inputs if reach is None else reach.along(inputs),
    )


def diagnose_run(
    scene: Scene,
    method: Method,
    mesh: Mesh,
    steps: RunSteps,
    loads: StepLoads,
    asked: Asked,
) -> Diagnostics:
    """The diagnostics that are asked for, on the points of the mesh.

    Parameters
    ----------
    scene, method
        What moved, and how.
    mesh
        Of the whole run, which may have ended before.
    steps, loads
        The run, and the known forces.
    asked
        What is wanted.
    """
    dynamics, forces, stored = dynamics_of(scene), None, None
    along = damping_along([scene], method, mesh, [steps])
    if along is not None:
        forces = sampling_of(method).to_loads @ along.forces().sum(axis=0)[0]
        forces = forces * steps.step_size[:, None, None]
        every = along.stored()
        stored = None if every is None else every[0]
    fresh = np.isin(steps.time[:-1], [one.begin for one in mesh.stretches if one.is_fresh])
    added = loads_along(loads.of_damping, steps, fresh)
    if added is not None:
        forces = -added if forces is None else forces - added
    kicks = None
    if method.sampling == "nodes" and forces is not None:
        # half of each kick is in the steps beside its point
        kicks = 2.0 * np.concatenate([forces[:, 0], forces[-1:, -1]])
    return diagnose(
        BalanceData(
            steps=steps,
            dynamics=dynamics,
            energy=dynamics.energy(steps.position, steps.momentum, steps.time),
            damping=forces,
            forcing=loads_along(loads.of_forcing, steps, fresh),
            stored=stored,
            kicks=kicks,
        ),
        asked,
    )


def loads_along(
    of_steps: Callable[..., Array | None], steps: RunSteps, fresh: NDArray[np.bool_]
) -> Array | None:
    """Load vectors of all steps of a run, shape ``(n, s + 1, d)``; None without forces.

    Parameters
    ----------
    of_steps
        As :meth:`fvi_cli.integrator.loads.step_loads.StepLoads.of_steps`.
    steps
        The run.
    fresh
        Steps that begin where a force may be singular, shape ``(n,)``.
    """
    total: Array | None = None
    for first, last in pieces_of_equal_steps(steps.step_size):
        begin = first
        # a piece may hold several singular points: each begins a part of its own
        for end in [*(first + 1 + np.flatnonzero(fresh[first + 1 : last])).tolist(), last]:
            own = of_steps(
                float(steps.time[begin]),
                float(steps.step_size[begin]),
                end - begin,
                is_fresh=bool(fresh[begin]),
            )
            if own is not None:
                # where a force is zero there are none
                total = np.zeros((steps.n_steps, *own.shape[1:])) if total is None else total
                total[begin:end] = own
            begin = end
    return total
