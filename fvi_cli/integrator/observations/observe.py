"""Quantities and events along finished runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

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
) -> tuple[Trajectory, Trajectory]:
    """Integrate a scene and observe it, as :func:`observe` says.

    `every`, `diagnostics` and `checkpoints` as for
    :func:`fvi_cli.integrator.integrate.integrate`; a run with impacts has the last alone.

    Raises
    ------
    ValueError
        For methods whose steps are no polynomials, and impacts on a mesh of the caller's own.
    """
    check_observable(method)
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
        return observe(scene, method, run, request, checkpoints=checkpoints)
    if not isinstance(n_steps, int):
        raise ValueError("impacts: steps are cut where these are; give a number of steps")
    run, times = integrate_with_impacts(
        scene,
        method,
        n_steps,
        request.impacts,
        coordinates=request.coordinates,
        parameters=request.parameters,
        checkpoints=checkpoints,
    )
    return observe(scene, method, run, request, impacts=times, checkpoints=checkpoints)


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


def observe(
    scene: Scene,
    method: AnyMethod,
    trajectory: Trajectory,
    request: Observations,
    *,
    impacts: Mapping[str, Array] | None = None,
    checkpoints: RunKeeper | None = None,
) -> Pair:
    """Requested outputs of a finished run with its steps.

    The times of its impacts, by name, are reported like events. The second run, for the motion
    between its points, has a part of its checkpoint.

    The run on its mesh, up to where an event ended it; and at the times that are asked for, with
    what was observed.

    Raises
    ------
    ValueError
        For a run without steps, and times outside of it.
    """
    (found,) = observe_members(
        [scene], method, [trajectory], [request], impacts=impacts, checkpoints=checkpoints
    )
    return found


def observe_members(
    scenes: Sequence[Scene],
    method: AnyMethod,
    trajectories: Sequence[Trajectory],
    requests: Sequence[Observations],
    *,
    impacts: Mapping[str, Array] | None = None,
    checkpoints: RunKeeper | None = None,
) -> list[Pair]:
    """Requested outputs of finished runs by one method, all at once; see :func:`observe`.

    Each member has the bits that it has by itself. The formulas, and the directions of events, are
    those of the first member; values of the names in them are those of each.
    """
    check_observable(method)
    if not isinstance(method, Method) or any(one.steps is None for one in trajectories):
        raise ValueError("observe: the steps of the run were not kept")
    for scene, one in zip(scenes, requests, strict=True):
        if one.times is not None and one.times[-1] > scene.final_time * (1.0 + 1e-12):
            raise ValueError(
                f"output: {one.times[-1]:g} is not allowed; the run goes from 0 to "
                f"{scene.final_time:g}"
            )
    moving, found = [], dict[int, Pair]()
    for index, trajectory in enumerate(trajectories):
        if trajectory.steps is None or not trajectory.steps.n_steps:
            time = trajectory.time if trajectory.steps is None else trajectory.steps.time
            found[index] = trajectory, replace(trajectory, observed=Observed(mesh=time))
        else:
            moving.append(index)
    groups: dict[int, list[int]] = {}
    for index in moving:
        # the force of a given motion is that of all dampers, of which each may have others
        is_given = scenes[index].prescribed is not None
        groups.setdefault(len(dampers_of(scenes[index])) if is_given else 0, []).append(index)
    for count, members in groups.items():
        steps = [trajectories[k].steps for k in members]
        motion = dense_motion(
            [scenes[k] for k in members],
            method,
            [one for one in steps if one is not None],
            part_of(checkpoints, "between the points" + f" of {count} dampers" * bool(count)),
        )
        observer = Observer(motion, [requests[k] for k in members])
        runs = [trajectories[k] for k in members]
        found.update(zip(members, observer.observe(runs, impacts or {}), strict=True))
    return [found[index] for index in range(len(trajectories))]
