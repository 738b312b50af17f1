"""What is ready before the first step of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.convolution.damping import Damping
from fvi_cli.integrator.convolution.reach import Reach, find_reach
from fvi_cli.integrator.convolution.stages import StageOperator
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.growth_bound import NO_BOUND, GrowthBound
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.loop import Marker, Stepper
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.integrator.steps.linear_blocks import LARGEST_DENSE, LEAST_BLOCK
from fvi_cli.integrator.steps.step import StepSolver
from fvi_cli.mathematics.runge_kutta import tableau


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
    """

    scene: Scene
    method: Method
    stepper: Stepper
    damping: Damping | None
    decoupling: Decoupling | None
    bound: GrowthBound

    @property
    def n_states(self) -> int:
        """Number of exponentials that stand for the past."""
        kernel = None if self.damping is None else self.damping.kernel
        return 0 if kernel is None else kernel.n_states


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
    solver = StepSolver(dynamics_of(scene), damping, tables)
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
    """The same for the steps of a mesh."""
    return prepare_run(
        scene,
        method,
        shortest_step=mesh.shortest_step,
        n_steps=mesh.equivalent_steps,
        bound=bound,
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
