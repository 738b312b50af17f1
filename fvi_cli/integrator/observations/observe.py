"""Quantities and events along finished runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.observations.dampers import dampers_of
from fvi_cli.integrator.observations.impacts.run import integrate_with_impacts
from fvi_cli.integrator.observations.observer import Observer, Pair
from fvi_cli.integrator.observations.request import Observations, check_observable
from fvi_cli.integrator.observations.second_runs import dense_motion
from fvi_cli.integrator.results.observed import Observed
from fvi_cli.integrator.run.checkpoint import RunKeeper, part_of
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array


def integrate_observed(
    scene: Scene,
    method: AnyMethod,
    n_steps: AnySteps,
    request: Observations,
    *,
    every: int = 1,
    diagnostics: DiagnosticsRequest = NO_DIAGNOSTICS,
    checkpoints: RunKeeper | None = None,
) -> Pair:
    """Integrate a scene and observe it, as :func:`observe_members` says.

    `every`, `diagnostics` and `checkpoints` as for
    :func:`fvi_cli.integrator.integrate.integrate`; a run with impacts has the last alone.

    Raises
    ------
    ValueError
        For methods whose steps are no polynomials, and impacts on a mesh of the caller's own.
    """
    check_observable(method)
    impacts: Mapping[str, Array] = {}
    if not request.impacts or not isinstance(method, Method):
        run = integrate(
            scene,
            method,
            n_steps,
            every=every,
            diagnostics=diagnostics,
            with_steps=True,
            checkpoints=checkpoints,
        )
    elif isinstance(n_steps, int):
        run, impacts = integrate_with_impacts(
            scene,
            method,
            n_steps,
            request.impacts,
            coordinates=request.coordinates,
            parameters=request.parameters,
            checkpoints=checkpoints,
        )
    else:
        raise ValueError("impacts: steps are cut where these are; give a number of steps")
    (found,) = observe_members(
        [scene], method, [run], [request], impacts=impacts, checkpoints=checkpoints
    )
    return found


def integrate_observed_members(
    scenes: Sequence[Scene],
    method: AnyMethod,
    n_steps: int,
    requests: Sequence[Observations],
    *,
    every: int = 1,
    checkpoints: RunKeeper | None = None,
) -> list[Pair]:
    """Integrate many scenes and observe them, without impacts, those of one kind as one batch.

    As :func:`fvi_cli.integrator.members.integrate_members` and :func:`observe_members`.
    """
    check_observable(method)
    runs = integrate_members(
        scenes, method, n_steps, every=every, with_steps=True, checkpoints=checkpoints
    )
    return observe_members(scenes, method, runs, requests, checkpoints=checkpoints)


def observe_members(
    scenes: Sequence[Scene],
    method: AnyMethod,
    trajectories: Sequence[Trajectory],
    requests: Sequence[Observations],
    *,
    impacts: Mapping[str, Array] = MappingProxyType({}),
    checkpoints: RunKeeper | None = None,
) -> list[Pair]:
    """Requested outputs of finished runs, with their steps, by one method, all at once.

    For each the run on its mesh, up to where an event ended it; and at the times that are asked
    for, with what was observed. It has the bits that it has by itself. The formulas, and the
    directions of events, are those of the first member; values of the names in them are those of
    each. The times of impacts of the first, by name, are reported like events. The second run, for
    the motion between its points, has a part of the checkpoint.

    Raises
    ------
    ValueError
        For a run without steps, and times outside of it.
    """
    check_observable(method)
    steps = [one.steps for one in trajectories if one.steps is not None]
    if not isinstance(method, Method) or len(steps) < len(trajectories):
        raise ValueError("observe: the steps of the run were not kept")
    for scene, one in zip(scenes, requests, strict=True):
        if one.times is not None and one.times[-1] > scene.final_time * (1.0 + 1e-12):
            raise ValueError(
                f"output: {one.times[-1]:g} is not allowed; the run goes from 0 to "
                f"{scene.final_time:g}"
            )
    found = dict[int, Pair]()
    groups: dict[int, list[int]] = {}
    for index, (scene, run) in enumerate(zip(scenes, trajectories, strict=True)):
        if not steps[index].n_steps:
            found[index] = run, replace(run, observed=Observed(mesh=steps[index].time))
            continue
        # the force of a given motion is that of all dampers, of which each may have others
        count = 0 if scene.prescribed is None else len(dampers_of(scene))
        groups.setdefault(count, []).append(index)
    for count, members in groups.items():
        motion = dense_motion(
            [scenes[k] for k in members],
            method,
            [steps[k] for k in members],
            part_of(checkpoints, "between the points" + f" of {count} dampers" * bool(count)),
        )
        observer = Observer(motion, [requests[k] for k in members])
        runs = [trajectories[k] for k in members]
        found.update(zip(members, observer.observe(runs, impacts), strict=True))
    return [found[index] for index in range(len(trajectories))]
