"""Quantities and events along finished runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.observations.dampers import dampers_of, forces_along
from fvi_cli.integrator.observations.impacts.run import integrate_with_impacts
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.observer import Observer, Pair
from fvi_cli.integrator.observations.request import Observations, check_observable
from fvi_cli.integrator.results.observed import Observed
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread


@in_one_thread
def integrate_requested(
    scenes: Sequence[Scene],
    method: AnyMethod,
    steps: Sequence[AnySteps],
    requests: Sequence[Observations],
    *,
    every: int = 1,
    diagnostics: DiagnosticsRequest = NO_DIAGNOSTICS,
    with_steps: bool = False,
) -> list[Pair]:
    """Integrate scenes by one method, each in its steps, and compute the requested outputs.

    Numbers of steps are the same for all scenes, and so are the kinds of outputs; without outputs
    both of a pair are the run itself. Scenes with impacts, diagnostics or a mesh of their own are
    integrated individually; others in batches
    (:func:`fvi_cli.integrator.members.integrate_members`). `with_steps` keeps the steps of runs
    that are not observed; a run with impacts takes neither `every` nor `diagnostics`.

    Raises
    ------
    ValueError
        For observations by a method whose steps are no polynomials, and impacts on a mesh of the
        caller's own.
    """
    is_observed = any(not one.is_empty for one in requests)
    if is_observed:
        check_observable(method)
        with_steps = True
    is_individual = any(one.impacts for one in requests) or not diagnostics.is_empty
    if len(scenes) > 1 and isinstance(steps[0], int) and not is_individual:
        runs = integrate_members(scenes, method, steps[0], every=every, with_steps=with_steps)
        if not is_observed:
            return [(run, run) for run in runs]
        return observe_members(scenes, method, runs, requests)
    found: list[Pair] = []
    for scene, n_steps, request in zip(scenes, steps, requests, strict=True):
        impacts: Mapping[str, Array] = {}
        rests_on = ""
        if not request.impacts or not isinstance(method, Method):
            run = integrate(
                scene,
                method,
                n_steps,
                every=every,
                diagnostics=diagnostics,
                with_steps=with_steps,
            )
        elif isinstance(n_steps, int):
            run, impacts, rests_on = integrate_with_impacts(
                scene,
                method,
                n_steps,
                request.impacts,
                coordinates=request.coordinates,
                parameters=request.parameters,
            )
        else:
            raise ValueError("impacts: steps are cut where these are; give a number of steps")
        if is_observed:
            found += observe_members(
                [scene], method, [run], [request], impacts=impacts, rests_on=rests_on
            )
        else:
            found.append((run, run))
    return found


def observe_members(
    scenes: Sequence[Scene],
    method: AnyMethod,
    trajectories: Sequence[Trajectory],
    requests: Sequence[Observations],
    *,
    impacts: Mapping[str, Array] = MappingProxyType({}),
    rests_on: str = "",
) -> list[Pair]:
    """Requested outputs of finished runs by one method, all at once.

    Each run gives a pair: the run on its mesh, up to an event that ended it, and the run at the
    requested times with its outputs. Formulas and the directions of
    events are those of the first member; values of the names in them are each member's own.
    `impacts` are the times of impacts of the first member by name, and are reported like events;
    `rests_on` is the surface that ended its run.

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
        # with a given motion the force is that of all dampers, whose number may differ
        count = 0 if scene.prescribed is None else len(dampers_of(scene))
        groups.setdefault(count, []).append(index)
    for members in groups.values():
        own = [scenes[k] for k in members]
        runs_on = [steps[k] for k in members]
        motion = DenseMotion(
            scenes=tuple(own),
            steps=tuple(runs_on),
            find_forces=partial(forces_along, own, method, runs_on),
        )
        observer = Observer(motion, [requests[k] for k in members])
        runs = [trajectories[k] for k in members]
        found.update(zip(members, observer.observe(runs, impacts, rests_on), strict=True))
    return [found[index] for index in range(len(trajectories))]
