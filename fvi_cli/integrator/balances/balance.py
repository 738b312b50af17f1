r"""Works and energy balance along a run, with the scheme's own quadrature.

With the increments of step k in the polynomial :math:`x_d`, the forces enter the equations of
motion by their moments :math:`g_{k\nu} = h \sum_i b_i l_\nu(c_i) f_{k,i}` against the basis, and
their work is

.. math:: W_k = \sum_\nu g_{k\nu} \cdot x_d'(d_\nu h; k) .

The balance of the energy is exact, whatever the step size, for a constant mass matrix, a quadratic
potential, as many Gauss points as the degree, ``forcing_quadrature: galerkin`` and no loads of
initial data: the action's step is then a Gauss method, which keeps quadratic invariants, and a kick
at a node does its work at the mean of the velocities before and after it.

Otherwise the defects fall with the order of the method. If a Riemann-Liouville derivative of order
:math:`\gamma < 1` turns an initial position into the force :math:`t^{-\gamma}`, they fall with
:math:`h^{2 - 2 \gamma}` at the points of a method: the velocity there is known to
:math:`t^{1 - \gamma}` only (measured).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.diagnostics_request import DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.damping_along import damping_along, pieces_of_equal_steps
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.diagnostics import Diagnostics
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis


def diagnose_run(
    scene: Scene,
    method: Method,
    mesh: Mesh,
    steps: RunSteps,
    loads: StepLoads,
    request: DiagnosticsRequest,
) -> Diagnostics:
    """The requested diagnostics at the points of a run.

    `mesh` is that of the whole run, also if the run ended early; `loads` are the given forces.
    """
    along, damping, stored = damping_along([scene], method, mesh, [steps]), None, None
    if along is not None:
        damping = step_tables(method).to_loads @ along.forces().sum(axis=0)[0]
        damping = damping * steps.step_size[:, None, None]
        every = along.stored() if request.energy_balance else None
        stored = None if every is None else every[:, 0].sum(axis=0)
    fresh = np.isin(steps.time[:-1], [one.begin for one in mesh.stretches if one.is_fresh])
    added = loads_along(loads.of_weights, steps, fresh)
    if added is not None:
        damping = -added if damping is None else damping - added
    initial = loads_along(loads.of_initial_data, steps, fresh)
    forcing = loads_along(loads.of_forcing, steps, fresh)
    dissipated = worked = defect = None
    if request.energy_balance:
        basis = lobatto_basis(steps.tables.degree)
        slopes = basis.derivatives(basis.control_points)[1:]
        rates = np.einsum("vj,nvd->njd", slopes, steps.unknowns)
        dissipated, worked = _summed(damping, rates), _summed(forcing, rates)
        linear = scene.linear_potential
        if linear is not None and scene.forcing is not None:
            # the work of the constant force is in the energy; round-off would look like a forcing
            own = (steps.position - steps.position[0]) @ linear.force
            worked = 0.0 * own if scene.forcing.is_constant(linear.force) else worked - own
        if method.sampling == "nodes" and damping is not None:
            # half of each kick is in the step before its point, half in the step after it
            kicks = 2.0 * np.concatenate([damping[:, 0], damping[-1:, -1]])
            dissipated = _work_of_kicks(scene, steps, kicks)
        dissipated = dissipated - _summed(initial, rates)
        if scene.lagrangian is not None and scene.lagrangian.depends_on_time:
            at_stages = steps.stage_position, steps.velocity, steps.stage_time
            rate = scene.lagrangian.time_derivative(*at_stages)
            worked = worked - _running(steps.step_size * (rate @ steps.tables.weights))
        energy = scene.energy(steps.position, steps.momentum, steps.time)
        defect = energy - energy[0] + dissipated - worked
    return Diagnostics(
        dissipated_work=dissipated,
        forcing_work=worked,
        energy_defect=defect,
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


def loads_along(
    of_steps: Callable[..., Array | None], steps: RunSteps, fresh: NDArray[np.bool_]
) -> Array | None:
    """Load vectors of all steps of a run, ``(n, s + 1, d)``; None without forces.

    `of_steps` is as :meth:`fvi_cli.integrator.loads.StepLoads.of_steps`; `fresh` steps
    begin where a force may be singular, ``(n,)``.
    """
    total: Array | None = None
    for first, last in pieces_of_equal_steps(steps.step_size):
        # a piece may hold several singular points: each begins a part of its own
        inside = (first + 1 + np.flatnonzero(fresh[first + 1 : last])).tolist()
        for begin, end in zip([first, *inside], [*inside, last], strict=True):
            own = of_steps(
                float(steps.time[begin]),
                float(steps.step_size[begin]),
                end - begin,
                is_fresh=bool(fresh[begin]),
            )
            if own is not None:
                # a force that is zero has no load vectors
                total = np.zeros((steps.n_steps, *own.shape[1:])) if total is None else total
                total[begin:end] = own
    return total
