"""The plan of a run: which effects a scene calls for, which machinery is taken, and what it costs.

It is made before the first step, by the functions that the engine itself asks, and without any
weights or steps.
"""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines.results import baseline_operations
from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.integrator.starts.interpolation_limit import interpolation_remarks
from fvi_cli.planning.machinery import machinery_of
from fvi_cli.planning.plan_memory import peak_bytes
from fvi_cli.planning.plan_seconds import machine_speed, predicted_seconds
from fvi_cli.planning.plan_words import (
    effects_of_scene,
    forcing_in_words,
    history_in_words,
    start_in_words,
    steps_in_words,
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
    n_directions
        Matrices along which the damping acts; terms of one share their sums.
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
    n_directions: int
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
    machinery = machinery_of(
        scene, method, n_steps, every, members, diagnosed=diagnosed, grading=grading
    )
    return Plan(
        effects=effects_of_scene(scene),
        steps=steps_in_words(machinery),
        history=history_in_words(machinery),
        start=start_in_words(scene, method, machinery.plan.n_steps),
        forcing=forcing_in_words(scene, method),
        history_operations=machinery.plan.operations,
        memory_bytes=peak_bytes(machinery),
        seconds=predicted_seconds(machinery),
        n_directions=machinery.n_directions,
        systems=machinery.systems,
        coupled=machinery.coupled,
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
    return peak_bytes(machinery_of(scene, method, n_steps, every, members, diagnosed=diagnosed))


def planned_seconds(scene: Scene, method: AnyMethod, n_steps: int) -> float:
    """The plan's time alone."""
    if isinstance(method, Baseline):
        return _baseline_plan(scene, method, n_steps).seconds
    return predicted_seconds(machinery_of(scene, method, n_steps))


def _baseline_plan(scene: Scene, method: Baseline, n_steps: int) -> Plan:
    operations = baseline_operations(method.name, scene, n_steps)
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
        n_directions=len(scene.active_damping),
        systems=1,
        coupled=scene.dimension,
        remarks=interpolation_remarks(scene, n_steps),
    )


def _baseline_bytes(scene: Scene, n_steps: int) -> int:
    return 8 * (4 + 2 * len(scene.active_damping)) * scene.dimension * n_steps
