"""How the engine will integrate a run, and its work and memory, before the first step."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines.results import baseline_operations
from fvi_cli.integrator.break_points import fits_break_points, interpolation_remarks
from fvi_cli.integrator.damping.directions import pattern_of
from fvi_cli.integrator.members import block_in_batch, fewest, goes_together
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh, uniform_mesh
from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.integrator.run.mesh_plan import MeshPlan, plan_on_mesh
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.planning.memory import peak_bytes

OPERATIONS_OF_A_CALL = 1000
"""A call of a small NumPy function counts as so many multiply-adds (guessed)."""
CALLS_OF_A_STEP, CALLS_OF_A_BLOCK = 60, 30
"""Calls for a step with an iteration, and for a block of linear steps (guessed)."""

FORCING_WORDS = {
    "galerkin": "at the points of the rule",
    "exact": "moments to round-off",
    "projected": "exact moments of the projection",
}


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The plan of a run: its scene and method, its mesh, and remarks."""

    scene: Scene
    method: AnyMethod
    n_steps: int
    every: int
    is_diagnosed: bool
    members: int  # number of scenes in its batch; 1: it is integrated individually
    mesh: MeshPlan  # how the engine will step
    remarks: tuple[str, ...] = ()  # further remarks for the reader

    @property
    def history_operations(self) -> int | None:
        """Multiply-adds of the memory sums if the run reaches its end; None: not known."""
        return self.mesh.operations

    @property
    def n_directions(self) -> int:
        """Number of matrices of the damping; terms with the same matrix share their sums."""
        return len(pattern_of(self.scene))

    @property
    def systems(self) -> int:
        """Number of systems that are stepped as one batch, over all members."""
        return self.members * self.mesh.systems

    @property
    def memory_bytes(self) -> int:
        """Peak memory of the run, or of its batch, without the program itself."""
        if isinstance(self.method, Baseline):
            # samples of each term and its weights beside the motion and its energies
            terms, d = len(self.scene.active_damping), self.scene.dimension
            return 8 * self.n_steps * (d * (7 + terms) + 4 + terms)
        return peak_bytes(
            self.scene,
            self.method,
            self.mesh,
            n_kept=self.n_steps // self.every + 3,
            members=self.members,
            is_diagnosed=self.is_diagnosed,
        )

    @property
    def work(self) -> float:
        """Approximate work in multiply-adds: a count, equal on every machine."""
        mesh = self.mesh
        blocks = (mesh.n_steps - mesh.single) / max(mesh.block, 1)
        steps = float(mesh.single)
        if not self.scene.is_linear:
            steps, blocks = 4.0 * mesh.single + mesh.n_steps - mesh.single, 0.0
        calls = CALLS_OF_A_STEP * steps + CALLS_OF_A_BLOCK * blocks
        return (self.history_operations or 0) + OPERATIONS_OF_A_CALL * calls

    @property
    def steps(self) -> str:
        """How the steps are computed, and for which systems."""
        mesh, is_linear = self.mesh, self.scene.is_linear
        if isinstance(self.method, Baseline):
            return f"{self.n_steps} single steps of {self.method.name}"
        if self.members > 1:
            together = f"{mesh.n_steps} steps of {self.members} members together"
            newton = ", Newton's iteration for all at once with a linear response of each"
            return f"{together}{'' if is_linear else newton}, {self._systems_in_words}"
        words = []
        if mesh.n_steps > mesh.single:
            words += [
                f"blocks of {mesh.block} steps as one matrix product"
                if is_linear
                else f"Newton's iteration on blocks of up to {mesh.block} steps with a frozen "
                "linear response, single steps with the exact Jacobian where that does not contract"
            ]
        if mesh.single:
            words += [
                f"{mesh.single} single steps with one factorisation for each size"
                if is_linear
                else f"Newton's iteration with the exact Jacobian, {mesh.single} single steps"
            ]
        # systems are not mentioned where every sum is written out
        is_written_out = is_linear and mesh.n_lags == mesh.single > 0
        return ", ".join(words if is_written_out else [*words, self._systems_in_words])

    @property
    def _systems_in_words(self) -> str:
        mesh = self.mesh
        if mesh.systems == 1:
            return "one system" if mesh.coupled == 1 else f"{mesh.coupled} coupled components"
        kind = "modes" if mesh.has_modes else "components"
        return f"{mesh.systems} uncoupled {kind} in one batch"

    @property
    def history(self) -> str:
        """How the memory sums are evaluated."""
        mesh = self.mesh
        if not self.n_directions:
            return "not needed: the scene has no damping"
        if isinstance(self.method, Baseline):
            return "dot products"
        if not mesh.n_states:
            return "not needed: derivatives of order 1 have no memory"
        if not mesh.n_lags:
            return f"{mesh.n_states} exponentials in place of the past"
        if mesh.n_lags == mesh.n_steps:
            return "every sum written out"
        near = f"the last {mesh.n_lags} steps summed directly"
        n_sums = mesh.n_states // step_tables(self.method).degree - mesh.n_lags
        return f"{near}, {n_sums} exponentials in place of the others" if n_sums else near

    @property
    def start(self) -> str:
        """How a singular start is treated."""
        start = "none" if isinstance(self.method, Baseline) else self.method.start
        if start == "graded":
            return (
                "steps behind singular points are halved again and again, "
                f"{self.mesh.n_steps} steps in all"
            )
        if start == "weights" and self.scene.active_damping:
            return "starting weights"
        return "no correction"

    @property
    def forcing(self) -> str:
        """How the forcing enters."""
        if self.scene.forcing is None:
            return "none"
        if isinstance(self.method, Baseline):
            return "at the grid points"
        return FORCING_WORDS[self.method.forcing_quadrature]

    def lines(self) -> list[str]:
        """The plan in words, a line for each of its parts."""
        counted = self.history_operations
        operations = "not known" if counted is None else f"{counted:,}"
        return [
            f"effects: {', '.join(effects_of_scene(self.scene))}",
            f"steps: {self.steps}",
            f"history: {self.history}",
            f"start: {self.start}",
            f"forcing: {self.forcing}",
            f"operations of the history: {operations}",
            f"memory: about {self.memory_bytes / 1e6:.3g} MB",
            *(f"remark: {remark}" for remark in self.remarks),
        ]


@functools.lru_cache(maxsize=256)
def plan_run(
    scene: Scene,
    method: AnyMethod,
    n_steps: int,
    *,
    every: int = 1,
    members: int = 1,
    is_diagnosed: bool = False,
    grading: float = 1.0,
) -> Plan:
    """Plan how `integrate` or `integrate_members` will compute a run, without computing it.

    `members` is the size of its batch, see :func:`fvi_cli.integrator.members.companions`.
    """
    mesh: int | Mesh = n_steps
    most, is_batch = None, False
    if isinstance(method, Baseline):
        plan = MeshPlan(
            n_steps=n_steps,
            single=n_steps,
            n_sizes=1,
            block=0,
            systems=1,
            coupled=scene.dimension,
            has_modes=False,
            n_states=0,
            operations=baseline_operations(method.name, scene, n_steps),
            n_lags=n_steps,
        )
    else:
        # the run itself, not its plan, refuses break points between grid points
        fits = method.is_runge_kutta or fits_break_points(scene, n_steps)
        if not fits:
            mesh = uniform_mesh(scene.final_time, n_steps)
        elif grading != 1.0:
            mesh = graded_mesh(scene.final_time, n_steps, grading, scene.break_points)
        elif members >= max(2, fewest(scene, n_steps)) and goes_together(scene, method, n_steps):
            most, is_batch = block_in_batch(scene, method), True
        plan = plan_on_mesh(scene, method, mesh, most=most)
    return Plan(
        scene=scene,
        method=method,
        n_steps=n_steps,
        every=every,
        is_diagnosed=is_diagnosed,
        members=members if is_batch else 1,
        mesh=plan,
        remarks=interpolation_remarks(scene, n_steps, grading=grading),
    )


def effects_of_scene(scene: Scene) -> tuple[str, ...]:
    """Names of the effects of a scene."""
    inertia = "inertia" if scene.lagrangian is None else "general Lagrangian"
    effects = [f"{inertia} ({scene.dimension} dof)"]
    if scene.potential is not None:
        effects.append("linear potential" if scene.is_linear else "nonlinear potential")
    effects += [f"damping of order {term.order:g}" for term in scene.active_damping]
    effects += [law.kernel.label for law in scene.active_laws]
    if scene.forcing is not None:
        effects.append("sampled forcing" if scene.forcing.samples else "forcing")
    return tuple(effects)
