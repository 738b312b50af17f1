"""Second runs on the meshes of finished ones, for the values between their points."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.damping_along import damping_along
from fvi_cli.integrator.damping.directions import pattern_of
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.dampers import single_damper
from fvi_cli.integrator.observations.impacts.run import replayed
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.checkpoint import RunKeeper, keeper_of_run
from fvi_cli.mathematics.arrays import Array

MOST_STAGES = 12
"""Stages of the second run at most."""


def dense_motion(
    scenes: Sequence[Scene],
    method: Method,
    steps: Sequence[RunSteps],
    checkpoints: RunKeeper | None = None,
) -> DenseMotion:
    """The dense motions of finished runs, by second runs on their meshes."""
    methods, shapes, remarks = [method] * len(steps), list(steps), [""] * len(steps)
    runs, stages = list(steps), min(2 * method.degree, MOST_STAGES)
    if stages != method.degree:
        own = Method(
            cq="gauss", degree=stages, start="none", forcing_quadrature=method.forcing_quadrature
        )
        for index, (second, outcome) in enumerate(_second_runs(scenes, own, steps, checkpoints)):
            if second is not None:
                methods[index], shapes[index] = own, second
                if scenes[index].prescribed is not None:
                    # both have the same points, and a rate may jump at them
                    runs[index] = second
                continue
            remarks[index] = (
                "between the points of the mesh the motion is known to the order of a step only: "
                f"the run of {stages} stages {outcome}"
            )
    return DenseMotion(
        scenes=tuple(scenes),
        steps=tuple(runs),
        shapes=tuple(shapes),
        find_forces=partial(forces_along, scenes, methods, shapes),
        remarks=tuple(remarks),
        are_starts_given=True,
    )


def forces_along(
    scenes: Sequence[Scene],
    methods: Sequence[Method],
    shapes: Sequence[RunSteps],
    damper: int | None = None,
) -> list[Array | None]:
    """Damping forces at the stages of runs, those of one mesh and pattern of terms together.

    Each ``(k, n, r, d)`` by direction, or of the damper in a place ``(1, n, r, c)`` on its
    deformation; None without damping.
    """
    if damper is not None:
        single = [single_damper(s, damper, one) for s, one in zip(scenes, shapes, strict=True)]
        scenes, shapes = [one[0] for one in single], [one[1] for one in single]
    found: list[Array | None] = [None] * len(scenes)
    groups: dict[Hashable, list[int]] = {}
    for index, (scene, method, one) in enumerate(zip(scenes, methods, shapes, strict=True)):
        if scene.active_forces and one.n_steps:
            # laws shape the rates of all, and a sparse matrix stands by itself
            runs_individually = bool(scene.active_laws) or scene.is_sparse
            key = (method, one.time.tobytes(), pattern_of(scene), scene.final_time)
            groups.setdefault(index if runs_individually else key, []).append(index)
    for places in groups.values():
        first = places[0]
        along = damping_along(
            [scenes[index] for index in places],
            methods[first],
            shapes[first].mesh(scenes[first].break_points),
            [shapes[index] for index in places],
        )
        if along is None:  # pragma: no cover - there are forces
            continue
        with np.errstate(all="ignore"):
            for index, force in zip(places, along.forces().swapaxes(0, 1), strict=True):
                found[index] = force
    return found


def _second_runs(
    scenes: Sequence[Scene],
    method: Method,
    steps: Sequence[RunSteps],
    checkpoints: RunKeeper | None,
) -> list[tuple[RunSteps | None, str]]:
    """For every run that by another method on the same mesh, or why there is none."""
    shorter = [
        scene
        if scene.final_time == one.time[-1]
        else replace(scene, final_time=float(one.time[-1]))
        for scene, one in zip(scenes, steps, strict=True)
    ]
    found: dict[int, tuple[RunSteps | None, str]] = {}
    groups: dict[Hashable, list[int]] = {}
    for index, one in enumerate(steps):
        if one.jump is None:
            key = (one.time.tobytes(), shorter[index].break_points)
            groups.setdefault(key, []).append(index)
            continue
        found[index] = replayed(shorter[index], method, one, checkpoints), "failed"
    for places in groups.values():
        own = checkpoints if len(scenes) == 1 else keeper_of_run(checkpoints, f"{places[0]}")
        runs = integrate_members(
            [shorter[index] for index in places],
            method,
            steps[places[0]].mesh(shorter[places[0]].break_points),
            with_steps=True,
            checkpoints=own,
        )
        for index, run in zip(places, runs, strict=True):
            whole = run.steps if run.status == "ok" else None
            found[index] = whole, f"{run.status}: {run.message}"
    return [found[index] for index in range(len(steps))]
