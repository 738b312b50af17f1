"""Second runs on the meshes of finished ones, for the values between their points."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.damping_along import damping_along
from fvi_cli.integrator.damping.directions import pattern_of
from fvi_cli.integrator.members import batch_kind, integrate_members
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.dampers import single_damper
from fvi_cli.integrator.observations.impacts.run import replayed
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.single_steps import can_be_single, solved_steps
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places

MOST_STAGES = 12
"""Most stages of the second run."""


def dense_motion(
    scenes: Sequence[Scene],
    method: Method,
    steps: Sequence[RunSteps],
    chosen: Sequence[Places] | None = None,
) -> DenseMotion:
    """The dense motions of finished runs, by second runs on their meshes.

    If only some steps of each are needed, `chosen`, only these are solved again.
    """
    methods, shapes, remarks = [method] * len(steps), list(steps), [""] * len(steps)
    runs, stages = list(steps), min(2 * method.degree, MOST_STAGES)
    if stages != method.degree:
        own = Method(
            cq="gauss", degree=stages, start="none", forcing_quadrature=method.forcing_quadrature
        )
        by_step = {} if chosen is None else _single_steps(scenes, own, steps, chosen)
        others = [index for index in range(len(steps)) if index not in by_step]
        again = _second_runs(
            [scenes[index] for index in others],
            own,
            [steps[index] for index in others],
        )
        every = {**by_step, **dict(zip(others, again, strict=True))}
        for index, (second, outcome) in every.items():
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
        chosen=None if chosen is None else _numbered(chosen, steps),
    )


def _numbered(chosen: Sequence[Places], steps: Sequence[RunSteps]) -> Places:
    """Chosen steps of every run in the numbering of all runs."""
    firsts = np.cumsum([0, *(one.n_steps for one in steps[:-1])])
    return np.concatenate([one + first for one, first in zip(chosen, firsts, strict=True)])


def _single_steps(
    scenes: Sequence[Scene], method: Method, steps: Sequence[RunSteps], chosen: Sequence[Places]
) -> dict[int, tuple[RunSteps | None, str]]:
    """Runs with their chosen steps solved by themselves, where that is possible and worth it."""
    groups: dict[Hashable, list[int]] = {}
    meshes: dict[Hashable, Mesh] = {}
    for index, (scene, one, own) in enumerate(zip(scenes, steps, chosen, strict=True)):
        if can_be_single(scene, one, own):
            key = one.time.tobytes(), scene.break_points
            if key not in meshes:
                meshes[key] = one.mesh(scene.break_points)
            kind = batch_kind(scene, method, meshes[key])
            if kind is not None:
                groups.setdefault((kind, key), []).append(index)
    found: dict[int, tuple[RunSteps | None, str]] = {}
    for places in groups.values():
        again = solved_steps(
            [scenes[index] for index in places],
            method,
            [steps[index] for index in places],
            [chosen[index] for index in places],
        )
        found |= {k: (one, "") for k, one in zip(places, again, strict=True) if one is not None}
    return found


def forces_along(
    scenes: Sequence[Scene],
    methods: Sequence[Method],
    shapes: Sequence[RunSteps],
    damper: int | None = None,
) -> list[Array | None]:
    """Damping forces at the stages of runs; runs of one mesh and pattern are computed together.

    Each is ``(k, n, r, d)`` by direction or, for one damper, ``(1, n, r, c)`` on its deformation;
    None without damping.
    """
    if damper is not None:
        single = [single_damper(s, damper, one) for s, one in zip(scenes, shapes, strict=True)]
        scenes, shapes = [one[0] for one in single], [one[1] for one in single]
    found: list[Array | None] = [None] * len(scenes)
    groups: dict[Hashable, list[int]] = {}
    for index, (scene, method, one) in enumerate(zip(scenes, methods, shapes, strict=True)):
        if scene.active_forces and one.n_steps:
            # laws change the rates of all, and sparse matrices are not batched
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
) -> list[tuple[RunSteps | None, str]]:
    """For every run a run by another method on the same mesh, or why there is none."""
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
        found[index] = replayed(shorter[index], method, one), "failed"
    for places in groups.values():
        runs = integrate_members(
            [shorter[index] for index in places],
            method,
            steps[places[0]].mesh(shorter[places[0]].break_points),
            with_steps=True,
        )
        for index, run in zip(places, runs, strict=True):
            whole = run.steps if run.status == "ok" else None
            found[index] = whole, f"{run.status}: {run.message}"
    return [found[index] for index in range(len(steps))]
