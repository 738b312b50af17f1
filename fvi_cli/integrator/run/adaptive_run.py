"""A run whose steps are found on the way, from scene and tolerance to the trajectory."""

from __future__ import annotations

import time as clock
from dataclasses import replace

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.loop.adaptive import MOST_SHORTEST, AdaptiveSource, step_controller
from fvi_cli.integrator.loop.checkpoint import RunKeeper
from fvi_cli.integrator.loop.recorder import Recorder
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.regular import has_rough_momenta
from fvi_cli.integrator.run.scenes_run import ScenesRun, trajectory_of
from fvi_cli.integrator.run.soundness import Soundness
from fvi_cli.integrator.trajectory import Trajectory


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
