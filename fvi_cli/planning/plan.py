"""The plan of a run: which effects a scene calls for, which machinery is taken, and what it costs.

It is made before the first step, by the functions that the engine itself asks, and without any
weights or steps.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.kinds import fewest
from fvi_cli.integrator.blocks.newton import BLOCKS_PER_GROUP, newton_block
from fvi_cli.integrator.blocks.stepped_history import STEPPED_GROUP
from fvi_cli.integrator.equal_steps.routes import choose_route, sums_directly
from fvi_cli.integrator.expansions.interpolation_limit import interpolation_remarks
from fvi_cli.integrator.members import goes_together
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.run.runge_kutta import plan_runge_kutta
from fvi_cli.planning.batches import (
    Machinery,
    linear_blocks,
    members_side_by_side,
    systems_of,
)
from fvi_cli.planning.history_work import (
    Shape,
    baseline_operations,
    direct_operations,
    memories_of,
    newton_operations,
    stepped_operations,
)
from fvi_cli.planning.plan_memory import peak_bytes
from fvi_cli.planning.plan_seconds import machine_speed, predicted_seconds
from fvi_cli.planning.plan_words import (
    effects_of_scene,
    forcing_in_words,
    history_in_words,
    start_in_words,
    systems_in_words,
)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a run simulates, how, and what that will take.

    Parameters
    ----------
    effects
        What is simulated, in words; what is absent costs nothing.
    steps
        How the steps are done, in words.
    history
        How the memory of the damping is summed up, in words.
    start
        What becomes of a singular start, in words.
    forcing
        How the forcing enters, in words.
    history_operations
        Multiply-adds that the memory will take if the run goes on to its end; None where nobody
        can tell (programs of others).
    memory_bytes
        Largest memory of the run, without the program itself, estimated.
    seconds
        Time on this machine, roughly.
    n_sequences
        Number of sequences of weights; terms of one direction share one.
    systems, coupled
        Number of systems that are stepped side by side, and of components of each.
    remarks
        What else the reader should know.
    """

    effects: tuple[str, ...]
    steps: str
    history: str
    start: str
    forcing: str
    history_operations: int | None
    memory_bytes: int
    seconds: float
    n_sequences: int
    systems: int
    coupled: int
    remarks: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """The plan in words, a line for each of its parts."""
        operations = (
            "not known" if self.history_operations is None else f"{self.history_operations:,}"
        )
        return [
            f"effects: {', '.join(self.effects)}",
            f"steps: {self.steps}",
            f"history: {self.history}",
            f"start: {self.start}",
            f"forcing: {self.forcing}",
            f"operations of the history: {operations}",
            f"memory: about {self.memory_bytes / 1e6:.3g} MB",
            f"time: about {self.seconds:.2g} s",
            *(f"remark: {remark}" for remark in self.remarks),
        ]


def plan_run(
    scene: Scene,
    method: AnyMethod,
    n_steps: int,
    *,
    every: int = 1,
    members: int = 1,
    diagnosed: bool = False,
    grading: float = 1.0,
) -> Plan:
    """Tell how `integrate` or `integrate_members` will do a run, without doing it.

    Parameters
    ----------
    scene, method, n_steps, every
        As for :func:`fvi_cli.integrator.integrate.integrate`.
    members
        How many scenes of this kind are integrated together, see
        :func:`fvi_cli.integrator.members.companions`.
    diagnosed
        Whether diagnostics are asked for.
    grading
        Of the mesh; 1: equal steps.

    Returns
    -------
    Plan
        Of one of the members, but `memory_bytes`, which all of them take together.
        `history_operations` are those that a complete run counts. For nonlinear scenes they do
        not depend on Newton's iteration: attempts that fail are work of the iteration.
    """
    if isinstance(method, Baseline):
        return _baseline_plan(scene, method, n_steps)
    machinery = _machinery(
        scene, method, n_steps, every, members, diagnosed=diagnosed, grading=grading
    )
    return Plan(
        effects=effects_of_scene(scene),
        steps=machinery.steps,
        history=machinery.history,
        start=start_in_words(scene, method, machinery.n_mesh_steps),
        forcing=forcing_in_words(scene, method),
        history_operations=machinery.operations,
        memory_bytes=peak_bytes(machinery),
        seconds=predicted_seconds(machinery),
        n_sequences=len(machinery.shape.memories),
        systems=machinery.shape.batch,
        coupled=machinery.shape.coupled,
        remarks=interpolation_remarks(scene, n_steps, grading=grading),
    )


def planned_bytes(
    scene: Scene,
    method: AnyMethod,
    n_steps: int,
    *,
    every: int = 1,
    members: int = 1,
    diagnosed: bool = False,
) -> int:
    """The plan's memory alone."""
    if isinstance(method, Baseline):
        return _baseline_bytes(scene, n_steps)
    return peak_bytes(_machinery(scene, method, n_steps, every, members, diagnosed=diagnosed))


def planned_seconds(scene: Scene, method: AnyMethod, n_steps: int) -> float:
    """The plan's time alone."""
    if isinstance(method, Baseline):
        return _baseline_plan(scene, method, n_steps).seconds
    return predicted_seconds(_machinery(scene, method, n_steps))


@functools.lru_cache(maxsize=256)
def _machinery(
    scene: Scene,
    method: Method,
    n_steps: int,
    every: int = 1,
    members: int = 1,
    *,
    diagnosed: bool = False,
    grading: float = 1.0,
) -> Machinery:
    samples = 1 if method.sampling == "nodes" else method.stages
    memories = memories_of(method, n_steps + 1, scene.active_damping)
    shape = Shape(memories=memories, samples=samples, coupled=scene.dimension)
    run = Machinery(
        scene=scene,
        method=method,
        n_steps=n_steps,
        every=every,
        diagnosed=diagnosed,
        shape=shape,
    )
    ends = int(method.sampling == "nodes" and bool(memories))
    together = members > 1 and goes_together(scene, method, n_steps)
    if method.is_runge_kutta:
        if together and members >= fewest(scene, n_steps) and grading == 1.0:
            return members_side_by_side(run, members)
        steps: int | Mesh = n_steps
        if grading != 1.0:
            steps = graded_mesh(scene.final_time, n_steps, grading, scene.break_points)
        return _any_mesh(run, steps)
    decoupling = None
    if not sums_directly(method.history, n_steps):
        decoupling = systems_of(scene)
    damped = bool(memories)
    route = choose_route(scene, method.history, n_steps, shape.samples, decoupling, damped=damped)
    whole = f"Newton's iteration with the exact Jacobian, {n_steps} single steps"
    single = f"{n_steps} single steps with one factorisation" if scene.is_linear else whole
    if route == "linear blocks" and decoupling is not None:
        return linear_blocks(run, decoupling, ends, members if together else 1)
    if route == "newton blocks":
        largest = newton_block(scene, shape.samples, n_steps) or 1
        group = largest * BLOCKS_PER_GROUP
        return replace(
            run,
            route=route,
            steps=f"Newton's iteration on blocks of up to {largest} steps with a frozen linear "
            "response, single steps with the exact Jacobian where that does not contract",
            history=history_in_words(shape, group),
            operations=newton_operations(shape, largest, n_steps, ends),
        )
    if route == "stepped":
        return replace(
            run,
            route=route,
            steps=single,
            history=history_in_words(shape, STEPPED_GROUP),
            operations=stepped_operations(shape, n_steps),
        )
    direct = "every sum written out" if shape.memory > 1 else history_in_words(shape, 1)
    return replace(
        run,
        route=route,
        steps=single,
        history=direct,
        operations=direct_operations(shape, n_steps),
    )


def _any_mesh(run: Machinery, mesh: int | Mesh) -> Machinery:
    """Steps of a Runge-Kutta method on its own mesh, as the run itself plans them."""
    scene = run.scene
    plan = plan_runge_kutta(scene, run.method, mesh)
    shape = replace(run.shape, coupled=plan.coupled, batch=plan.systems)
    blocks = plan.n_steps - plan.single
    if scene.is_linear:
        steps = f"blocks of {plan.block} steps as one matrix product"
        single = f"{plan.single} single steps with one factorisation for each size"
    else:
        steps = (
            f"Newton's iteration on blocks of up to {plan.block} steps with a frozen linear "
            "response, single steps with the exact Jacobian where that does not contract"
        )
        single = f"Newton's iteration with the exact Jacobian, {plan.single} single steps"
    words = [steps] if blocks else []
    words += [single] if plan.single else []
    history = history_in_words(shape, 1)
    if plan.n_states:
        history = f"{plan.n_states} exponentials in place of the past"
    return replace(
        run,
        route="any mesh",
        shape=shape,
        steps=", ".join([*words, systems_in_words(shape, has_modes=plan.has_modes)]),
        history=history,
        operations=plan.operations,
        n_states=plan.n_states,
        n_mesh_steps=plan.n_steps,
        block=plan.block,
    )


def _baseline_plan(scene: Scene, method: Baseline, n_steps: int) -> Plan:
    operations = baseline_operations(method, scene.active_damping, scene.dimension, n_steps)
    per_operation, per_call = machine_speed()
    return Plan(
        effects=effects_of_scene(scene),
        steps=f"{n_steps} single steps of {method.name}",
        history="dot products" if scene.active_damping else "none: nothing is damped",
        start="nothing is done about the start",
        forcing="none" if scene.forcing is None else "at the grid points",
        history_operations=operations,
        memory_bytes=_baseline_bytes(scene, n_steps),
        seconds=per_operation * (operations or 0) + 60 * per_call * n_steps,
        n_sequences=len(scene.active_damping),
        systems=1,
        coupled=scene.dimension,
        remarks=interpolation_remarks(scene, n_steps),
    )


def _baseline_bytes(scene: Scene, n_steps: int) -> int:
    return 8 * (4 + 2 * len(scene.active_damping)) * scene.dimension * n_steps
