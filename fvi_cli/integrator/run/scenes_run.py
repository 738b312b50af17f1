"""Scenes as far as their steps are done, and the trajectories that are reported of them."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.balance import diagnose_run
from fvi_cli.integrator.engine.blocks import block_for
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.engine.structures import StructureLaw
from fvi_cli.integrator.growth_bound import energy_remarks
from fvi_cli.integrator.loop.adaptive import MOST_SHORTEST, AdaptiveSource, step_controller
from fvi_cli.integrator.loop.checkpoint import Arrays, Keeper, RunKeeper
from fvi_cli.integrator.loop.loop import run
from fvi_cli.integrator.loop.points import Source
from fvi_cli.integrator.loop.recorder import Recorder
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.diagnostics import Diagnostics
from fvi_cli.integrator.results.momenta import smooth_momenta
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.regular import has_rough_momenta, regular_until, rough_remarks
from fvi_cli.integrator.run.soundness import Soundness
from fvi_cli.integrator.trajectory import Trajectory, status_of


@dataclass(eq=False)
class ScenesRun:
    """Scenes as far as their steps are done."""

    engine: Engine  # what solves the steps, where they come from, and what keeps them
    source: Source
    recorder: Recorder
    mesh: Mesh | None = None  # where they are; None: they are found on the way
    remarks: tuple[str, ...] = ()  # what is reported of every run

    def __post_init__(self) -> None:
        self.state = self.engine.start()

    def march(
        self,
        checkpoints: RunKeeper | None,
        run_key: tuple[str, int, float],
        determined_by: tuple[object, ...],
    ) -> float:
        """Do the steps; parameters as for :class:`~fvi_cli.integrator.loop.checkpoint.Keeper`.

        Arguments as for :class:`~fvi_cli.integrator.loop.checkpoint.Keeper`. The seconds, those
        before a checkpoint among them.
        """
        began = clock.perf_counter()
        keeper = Keeper(checkpoints, run_key, determined_by, self)
        run(
            self.engine,
            self.source,
            state=self.state,
            recorder=self.recorder,
            after=None if checkpoints is None else keeper.offer,
        )
        if not self.recorder.failures:
            keeper.offer(has_ended=True)
        return clock.perf_counter() - began + keeper.earlier_seconds

    def begin(self) -> None:
        """Record the start."""
        scenes = self.engine.scenes
        position = np.array([one.initial_position for one in scenes])
        momentum = np.array(
            [one.momentum(one.initial_position, one.initial_velocity, 0.0) for one in scenes]
        )
        self.recorder.begin(0.0, position, momentum)

    @property
    def progress(self) -> tuple[int, int]:
        """Finished steps and reported points."""
        return self.recorder.reached, self.recorder.reported

    def arrays(self) -> Arrays:
        """Everything that the steps to come depend on."""
        self.recorder.flush(self.state)
        source = {f"source {name}": one for name, one in self.source.arrays().items()}
        forces = np.array([one.largest_force for one in self.engine.loads_of])
        return {**self.state.arrays(), **source, "largest forces": forces}

    def kept(self) -> Arrays:
        """What was kept of the steps so far."""
        return self.recorder.arrays()

    def restore(self, arrays: Arrays, kept: Arrays) -> None:
        """Go on from there; all stays as it is where something is missing or does not fit."""
        begun = self.arrays()
        try:
            self.go_on(arrays)
            self.recorder.restore(kept)
        except (KeyError, TypeError, ValueError):
            self.go_on(begun)
            raise

    def go_on(self, arrays: Arrays) -> None:
        """Take the state of :meth:`arrays`, whatever was kept before."""
        state = State.from_arrays({n: one for n, one in arrays.items() if " " not in n})
        if any(getattr(state, n).shape != getattr(self.state, n).shape for n in "xpz"):
            raise ValueError("state: it has other shapes")
        self.source.restore({n.removeprefix("source "): one for n, one in arrays.items()})
        self.state = state
        for loads, force in zip(self.engine.loads_of, arrays["largest forces"], strict=True):
            loads.largest_force = float(force)


def trajectory_of(
    this: ScenesRun,
    index: int,
    every: int,
    diagnostics: DiagnosticsRequest,
    *,
    with_steps: bool,
    seconds: tuple[float, float],
) -> Trajectory:
    """What is reported of a scene whose steps are done.

    Seconds are those until the steps began, and for these.
    """
    scene, method, recorder = this.engine.scenes[index], this.engine.method, this.recorder
    n_steps = recorder.steps_done(index) if this.mesh is None else this.mesh.n_reported
    time, position, momentum = recorder.points(index)
    failure = recorder.failures.get(index)
    steps = recorder.steps(index) if recorder.with_steps else None
    remarks = this.remarks
    if has_rough_momenta(scene, method):
        if steps is not None:
            every_momentum = smooth_momenta(steps, scene.momentum, scene.break_points)
            momentum = every_momentum[np.searchsorted(steps.time, time)]
        remarks += rough_remarks(scene, diagnostics, are_stored_smooth=steps is not None)
    with np.errstate(all="ignore"):
        energy = scene.energy(position, momentum, time)
    if scene.lagrangian is not None:
        kept, irregular = regular_until(scene.lagrangian, position, momentum, energy, time)
        if irregular:
            if kept == 0:
                # no velocity was found from the momentum of the start, where it is given
                kept, start = 1, (scene.initial_position, scene.initial_velocity)
                energy[0] = scene.lagrangian.energy(*start, 0.0)
            time, position, momentum, energy = (
                one[:kept] for one in (time, position, momentum, energy)
            )
            failure = irregular
    finite = bool(np.isfinite(position).all() and np.isfinite(momentum).all())
    found = None
    if steps is not None and not diagnostics.is_empty and steps.n_steps:
        found = _diagnostics(this, index, steps, diagnostics).at(np.searchsorted(steps.time, time))
    if failure is None:
        force = this.engine.loads_of[index].largest_force
        remarks += energy_remarks(scene, position, energy, force)
    return Trajectory(
        time=time,
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=n_steps,
        step_size=scene.final_time / max(n_steps, 1),
        status=status_of(failure, finite=finite),
        message=str(failure or ""),
        failure=failure,
        history_operations=memory_operations(this.engine, recorder.steps_done(index)),
        newton=recorder.newton.of(index),
        setup_seconds=seconds[0],
        stepping_seconds=seconds[1],
        every=every,
        diagnostics=found,
        steps=steps if with_steps else None,
        remarks=remarks,
    )


def _diagnostics(
    this: ScenesRun, index: int, steps: RunSteps, request: DiagnosticsRequest
) -> Diagnostics:
    """The diagnostics on all points of the mesh."""
    engine = this.engine
    scene, loads = engine.scenes[index], engine.loads_of[index]
    mesh = this.mesh or steps.mesh(scene.break_points)
    with np.errstate(all="ignore"):
        return diagnose_run(scene, engine.method, mesh, steps, loads, request)


def adaptive_engine(scene: Scene, method: Method, steps: AdaptiveSteps) -> Engine:
    """The engine of a scene for steps that are found on the way, whatever their tolerance is.

    Raises
    ------
    ValueError
        If the method is no Gauss method of degree 2 or more.
    """
    return Engine(
        [scene],
        method,
        shortest_step=step_controller(scene, method, steps).shortest_step,
        steps=MOST_SHORTEST,
        most=1,
    )


def integrate_adaptively(
    scene: Scene,
    method: Method,
    steps: AdaptiveSteps,
    *,
    every: int = 1,
    diagnostics: DiagnosticsRequest = NO_DIAGNOSTICS,
    with_steps: bool = False,
    checkpoints: RunKeeper | None = None,
    engine: Engine | None = None,
) -> Trajectory:
    """Integrate a scene over [0, T] by steps that are found on the way.

    Parameters as for :func:`fvi_cli.integrator.integrate.integrate`; `engine` is what
    :func:`adaptive_engine` gave for the same scene, method and first step: runs share the tables of
    step sizes that they have in common.
    """
    began = clock.perf_counter()
    engine = engine or adaptive_engine(scene, method, steps)
    source = AdaptiveSource(scene, method, steps)
    keeps = with_steps or not diagnostics.is_empty or has_rough_momenta(scene, method)
    recorder = Recorder(
        engine, every=every, with_steps=keeps, check=Soundness([scene], engine.loads_of)
    )
    this = ScenesRun(engine, source, recorder)
    this.begin()
    ready = clock.perf_counter()
    run_key = (method.case, 0, steps.tolerance)
    seconds = this.march(checkpoints, run_key, (scene, method, steps))
    found = trajectory_of(
        this,
        0,
        every,
        diagnostics,
        with_steps=with_steps,
        seconds=(ready - began, seconds),
    )
    return replace(found, rejected=source.controller.rejected, doubts=source.doubts)


@dataclass(frozen=True, kw_only=True)
class MeshPlan:
    """How the steps of a mesh will be done, and what their memory takes."""

    n_steps: int  # steps of the mesh, and those of them that are done one by one
    single: int
    n_sizes: int  # number of step sizes
    block: int  # most steps of a block; 0: there are none
    systems: int  # independent systems of a scene, and components of each
    coupled: int
    has_modes: bool  # whether these are modes of the scene, no components of its coordinates
    n_states: int  # states that stand for the past
    operations: int | None  # multiply-adds of the memory for a scene; None: not known
    # steps of the past that are remembered one by one in states of their own; all others are
    # exponentials
    n_lags: int = 0


def memory_operations(engine: Engine, n_steps: int) -> int:
    """Multiply-adds of the memory of a scene in so many steps."""
    damping = engine.damping
    return 0 if damping is None else n_steps * engine.width * damping.operations_per_step


def plan_steps(engine: Engine, mesh: Mesh) -> MeshPlan:
    """How the loop will do the steps of a mesh for each scene of an engine."""
    single = largest = 0
    for one in mesh.stretches:
        block = block_for(engine, one.n_steps)
        if block == 1 or isinstance(engine.law, StructureLaw):
            single += one.n_steps
        else:
            largest = max(largest, block)
    return MeshPlan(
        n_steps=mesh.n_steps,
        single=single,
        n_sizes=len({one.step_size for one in mesh.stretches}),
        block=largest,
        systems=engine.width,
        coupled=engine.e,
        has_modes=engine.modes is not None and engine.modes[0].has_modes,
        n_states=engine.n_states,
        operations=memory_operations(engine, mesh.n_steps),
        n_lags=0 if engine.damping is None else engine.damping.memory.n_lags,
    )
