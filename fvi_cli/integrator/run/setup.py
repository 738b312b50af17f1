"""What is ready before the first step of a run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.convolution.damping import Damping
from fvi_cli.integrator.convolution.lags import LagDamping
from fvi_cli.integrator.convolution.reach import Reach, find_reach
from fvi_cli.integrator.convolution.stages import StageOperator
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.engine.structures import LARGEST_DENSE, LEAST_BLOCK
from fvi_cli.integrator.growth_bound import NO_BOUND, GrowthBound
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.loop import Marker, Stepper
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.integrator.steps.step import StepSolver, sampling_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.runge_kutta import tableau

LEAST_BLOCK_STEPS = 16
"""On fewer equal steps every sum over the past is written out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSetup:
    """Everything that is ready before the first step.

    Parameters
    ----------
    scene, method
        What is integrated, and how.
    stepper
        Single steps.
    damping
        Fractional damping and relaxation laws; None: there are none.
    decoupling
        Coordinates in which a linear scene falls apart; None for others and for sparse ones.
    bound
        Beyond which no sound run goes.
    in_blocks
        Whether steps may be done in blocks, with what is alike in all of them.
    remarks
        What is to be told of the run.
    """

    scene: Scene
    method: Method
    stepper: Stepper
    damping: Damping | None
    decoupling: Decoupling | None
    bound: GrowthBound
    in_blocks: bool = True
    remarks: tuple[str, ...] = ()

    @property
    def n_states(self) -> int:
        """Number of states that stand for the past."""
        return 0 if self.damping is None else self.damping.n_states


def prepare_run(
    scene: Scene, method: Method, *, shortest_step: float, n_steps: float | None, bound: GrowthBound
) -> RunSetup:
    """Tables and solvers for steps from `shortest_step` on.

    Raises
    ------
    ValueError
        If the method is no Runge-Kutta one.
    """
    if not method.is_runge_kutta:
        raise ValueError(f"mesh: {method.cq} takes equal steps only; use rk: gauss")
    tables = step_tables(method)
    damping = None
    decoupling = linear_decoupling(scene)
    if scene.active_forces:
        operator = StageOperator(tableau=tableau(method.cq, method.stages))
        damping = Damping(
            scene,
            operator,
            shortest_step=shortest_step,
            n_steps=n_steps,
            reach=_reach(scene, method.stages, decoupling),
        )
    solver = StepSolver(dynamics_of(scene), damping, tables, sampling_of(method, tables))
    return RunSetup(
        scene=scene,
        method=method,
        stepper=Stepper(solver, StepLoads(scene, method, tables)),
        damping=damping,
        decoupling=decoupling,
        bound=bound,
    )


def prepare_on_mesh(
    scene: Scene, method: Method, mesh: Mesh, bound: GrowthBound = NO_BOUND
) -> RunSetup:
    """The same for the steps of a mesh; equal ones by backward differences."""
    if not method.is_runge_kutta:
        return prepare_equal_steps(scene, method, mesh.n_steps, bound)
    return prepare_run(
        scene,
        method,
        shortest_step=mesh.shortest_step,
        n_steps=mesh.equivalent_steps,
        bound=bound,
    )


def writes_out(method: Method, n_steps: int) -> bool:
    """Whether every sum of the memory of backward differences is written out."""
    if method.history == "auto":
        return n_steps < LEAST_BLOCK_STEPS
    return method.history == "direct"


def prepare_equal_steps(
    scene: Scene, method: Method, n_steps: int, bound: GrowthBound = NO_BOUND
) -> RunSetup:
    """What is ready before N equal steps by backward differences."""
    tables = step_tables(method)
    direct = writes_out(method, n_steps)
    decoupling = None if direct else linear_decoupling(scene)
    loads = StepLoads(scene, method, tables)
    damping = None
    if scene.active_damping:
        reach = None if direct else _reach(scene, tables.degree, decoupling)
        damping = LagDamping(scene, method, tables, n_steps, writes_out=direct, reach=reach)
        left_out = damping.force_of_jump()[:n_steps]
        if left_out.any():
            h = scene.final_time / n_steps
            loads.add(h * np.einsum("vm,kmd->kvd", tables.sample_test_weights, left_out))
    solver = StepSolver(dynamics_of(scene), damping, tables, sampling_of(method, tables))
    return RunSetup(
        scene=scene,
        method=method,
        stepper=Stepper(solver, loads),
        damping=damping,
        decoupling=decoupling,
        bound=bound,
        in_blocks=not direct,
    )


def _reach(scene: Scene, stages: int, decoupling: Decoupling | None) -> Reach | None:
    """Where scenes are too large for blocks, what any damping acts on."""
    if not scene.is_linear or (decoupling is not None and decoupling.batch > 1):
        return None
    if scene.dimension * stages * LEAST_BLOCK <= LARGEST_DENSE and decoupling is not None:
        return None
    return find_reach(scene.active_forces)


def first_marker(setup: RunSetup) -> Marker:
    """The start of a run."""
    scene, dynamics = setup.scene, setup.stepper.solver.dynamics
    momentum = dynamics.momentum(scene.initial_position, scene.initial_velocity, 0.0)
    states = np.zeros((0, scene.dimension))
    if setup.damping is not None:
        states = setup.damping.initial_states()
    return Marker(
        time=0.0,
        position=CompensatedSum(scene.initial_position),
        momentum=CompensatedSum(momentum),
        states=states,
    )


def ready_on_mesh(scene: Scene, method: Method, mesh: Mesh, bound: GrowthBound) -> RunSetup:
    """Everything that is ready before the steps of a mesh, corrections of the start among it.

    Raises
    ------
    ValueError
        For starting weights with a general Lagrangian.
    """
    setup = prepare_on_mesh(scene, method, mesh, bound)
    if method.start == "weights" and scene.active_damping:
        return _with_starting_weights(setup, mesh)
    return setup


def _with_starting_weights(setup: RunSetup, mesh: Mesh) -> RunSetup:
    """The same with the force of the starting weights among the known ones."""
    from fvi_cli.integrator.starts.starting_weights import corrected_start

    scene, method, tables = setup.scene, setup.method, setup.stepper.solver.tables
    if scene.lagrangian is not None:
        raise ValueError("start: weights are not made for a general Lagrangian; use none")
    h, stepper = scene.final_time / mesh.n_steps, setup.stepper

    def first_samples(loads: Array, n_steps: int) -> Array:
        marker = first_marker(setup)
        found = np.empty((n_steps, tables.sample_points.size, scene.dimension))
        for index in range(n_steps):
            known = stepper.loads.of_steps(index * h, h, 1, is_fresh=index in fresh)
            own = loads[index] if known is None else known[0] + loads[index]
            result = stepper.solve(marker, h, own)
            away = marker.position.value - scene.initial_position
            found[index] = away + h * (tables.sample_basis[1:].T @ result.unknowns)
            stepper.accept(marker, result, h, (index + 1) * h)
        return found

    fresh = {0, *steps_at_break_points(scene, mesh.n_steps)}
    loads, remarks = corrected_start(scene, method, tables, mesh.n_steps, first_samples)
    if loads is not None:
        stepper.loads.add(loads)
    return replace(setup, remarks=remarks)
