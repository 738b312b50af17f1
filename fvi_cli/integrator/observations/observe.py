"""Quantities and events along a finished run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.diagnostics import NOTHING, Asked
from fvi_cli.integrator.engine.checkpoint import RunKeeper, part_of
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.singular_start import rate_jumps
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.observations.asked import Event, Observations, check_observable
from fvi_cli.integrator.observations.damper_work import work_names
from fvi_cli.integrator.observations.dense_motion import DenseMotion, dense_motion
from fvi_cli.integrator.observations.impacts import integrate_with_impacts
from fvi_cli.integrator.observations.isolation import FormulaAlong, event_places
from fvi_cli.integrator.observations.pieces import (
    Along,
    may_exceed,
    pieces_of,
    square_of,
    stations,
)
from fvi_cli.integrator.results.observed import Extent, Observed, Occurrences
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.run.regular import rough_remark
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression


def integrate_observed(
    scene: Scene,
    method: AnyMethod,
    n_steps: AnySteps,
    asked: Observations,
    *,
    every: int = 1,
    diagnostics: Asked = NOTHING,
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
    if not asked.impacts or not isinstance(method, Method):
        run = integrate(
            scene,
            method,
            n_steps,
            every=every,
            diagnostics=diagnostics,
            with_steps=True,
            checkpoints=checkpoints,
        )
        return observe(scene, method, run, asked, checkpoints=checkpoints)
    if not isinstance(n_steps, int):
        raise ValueError("impacts: steps are cut where these are; give a number of steps")
    run, times = integrate_with_impacts(
        scene,
        method,
        n_steps,
        asked.impacts,
        coordinates=asked.coordinates,
        parameters=asked.parameters,
        checkpoints=checkpoints,
    )
    return observe(scene, method, run, asked, impacts=times, checkpoints=checkpoints)


def observe(
    scene: Scene,
    method: AnyMethod,
    trajectory: Trajectory,
    asked: Observations,
    *,
    impacts: Mapping[str, Array] | None = None,
    checkpoints: RunKeeper | None = None,
) -> tuple[Trajectory, Trajectory]:
    """What is asked of a finished run.

    Parameters
    ----------
    scene, method
        What moved, and by which method.
    trajectory
        The run with its steps.
    asked
        What is wanted.
    impacts
        Times of the impacts of the run, which are told like events.
    checkpoints
        That of the run; the one that tells what lies between its points has a part of it.

    Returns
    -------
    tuple of Trajectory
        The run on its mesh, up to where an event ended it; and at the times that are asked for,
        with what was observed.

    Raises
    ------
    ValueError
        For a run without steps, and times outside of it.
    """
    check_observable(method)
    steps = trajectory.steps
    if steps is None or not isinstance(method, Method):
        raise ValueError("observe: the steps of the run were not kept")
    if asked.times is not None and asked.times[-1] > scene.final_time * (1.0 + 1e-12):
        raise ValueError(
            f"output: {asked.times[-1]:g} is not allowed; the run goes from 0 to "
            f"{scene.final_time:g}"
        )
    if not steps.n_steps:
        return trajectory, replace(trajectory, observed=Observed(mesh=steps.time))
    motion = dense_motion(scene, method, steps, part_of(checkpoints, "between the points"))
    events, missing = {}, []
    for name, one in (asked.events or {}).items():
        events[name], since = _occurrences(motion, asked, one)
        if since is not None:
            missing.append(
                f"events.{name}: {one.when.text} changes too fast to find every change of its sign "
                f"from t = {since:.6g} on; some of these times may be missing"
            )
    for name, found in (impacts or {}).items():
        at = motion.located(found)
        events[name] = Occurrences(
            time=found, position=motion.position(*at), velocity=motion.velocity(*at)
        )
    end, stopped_by = motion.end, ""
    for name, one in (asked.events or {}).items():
        first = float(events[name].time[0]) if events[name].time.size else math.inf
        if one.stop and first < end:
            end, stopped_by = first, name
    if stopped_by:
        events = {name: _until(one, end) for name, one in events.items()}
        trajectory = _cut(motion, trajectory, end)
    times = trajectory.time if asked.times is None else asked.times
    at = motion.located(times[times <= end * (1.0 + 1e-12)])
    quantities, extents = {}, {}
    for name, expression in (asked.quantities or {}).items():
        along = along_motion(motion, asked, expression)
        quantities[name] = along(*at)
        extents[name] = extent_of(motion, along, end)
    remarks = (*((motion.remark,) if motion.remark else ()), *missing)
    remarks += _rough_works(scene, asked)
    if stopped_by:
        remarks = (*remarks, f"stopped by the event {stopped_by} at t = {end:.10g}")
    on_mesh = replace(trajectory, remarks=(*trajectory.remarks, *remarks))
    observed = Observed(
        mesh=steps.time[steps.time <= end],
        quantities=quantities,
        extents=extents,
        events=events,
        stopped_by=stopped_by,
    )
    if asked.times is None:
        return on_mesh, replace(on_mesh, observed=observed)
    position = motion.position(*at)
    momentum, energy = _momentum_and_energy(motion, position, *at)
    reported = replace(
        on_mesh,
        time=motion.time(*at),
        position=position,
        momentum=momentum,
        energy=energy,
        diagnostics=None,
        observed=observed,
    )
    return on_mesh, reported


def _rough_works(scene: Scene, asked: Observations) -> tuple[str, ...]:
    """What is said of works on single dampers that keep the error of the first step."""
    if not rate_jumps(scene):
        return ()
    formulas = [*(asked.quantities or {}).values()]
    formulas += [one.when for one in (asked.events or {}).values()]
    used = frozenset[str]().union(*(one.names for one in formulas))
    pairs = zip(work_names(scene), scene.damping, strict=False)
    found = [name for name, term in pairs if term.order > 1 and name in used]
    return tuple(rough_remark(scene, f"{name} keeps") for name in found)


def along_motion(motion: DenseMotion, asked: Observations, expression: Expression) -> FormulaAlong:
    """The value of an expression at places of a motion; only what occurs in it is worked out."""
    return FormulaAlong(expression, partial(variables_at, motion, asked, expression))


def variables_at(
    motion: DenseMotion, asked: Observations, expression: Expression, steps: Places, tau: Array
) -> dict[str, Array | float]:
    """The variables of an expression at places of a motion, numbers or of shape ``(n,)``."""
    names, time = expression.names, motion.time(steps, tau)
    values: dict[str, Array | float] = {"t": time, **asked.parameters}
    sources = {
        "d": motion.damping,
        "a": motion.acceleration,
        "v": motion.velocity,
        "": motion.position,
    }
    columns: dict[str, Array] = {}
    for name, (prefix, index) in asked.derived.items():
        if name in names:
            if prefix not in columns:
                columns[prefix] = sources[prefix](steps, tau)
            values[name] = columns[prefix][:, index]
    for name in names.intersection(work_names(motion.scene)) - set(values):
        values[name] = motion.work(name, steps, tau)
    for name, given in asked.inputs.items():
        if name in names:
            values[name] = 0.0 if given is None else given(time)[:, 0]
    return values


def extent_of(motion: DenseMotion, along: Along, end: float) -> Extent:
    """How large a function along a motion becomes up to the time `end`."""
    least, greatest, square, length = math.inf, -math.inf, 0.0, 0.0
    at = {"least": 0.0, "greatest": 0.0}
    size = motion.steps.step_size

    count = _steps_until(motion, end)
    last_place = 1.0
    if count and motion.steps.time[count] > end:
        last_place = float((end - motion.steps.time[count - 1]) / size[count - 1])
    for found in pieces_of(along, count, last_place):
        square += float((size[found.step] * square_of(found)).sum())
        length += float((size[found.step] * (found.end - found.begin)).sum())
        seen = found.values[np.isfinite(found.values)]
        low = min(least, float(seen.min(initial=math.inf)))
        high = max(greatest, float(seen.max(initial=-math.inf)))
        step, place = stations(found, may_exceed(found, low, high))
        values = along(step, place)
        finite = np.isfinite(values)
        if not finite.any():
            continue
        step, place, values = step[finite], place[finite], values[finite]
        lowest, highest = int(values.argmin()), int(values.argmax())
        time = motion.time(step, place)
        if values[lowest] < least:
            least, at["least"] = float(values[lowest]), float(time[lowest])
        if values[highest] > greatest:
            greatest, at["greatest"] = float(values[highest]), float(time[highest])
    if not math.isfinite(least):
        return Extent(
            peak=math.nan, peak_time=math.nan, least=math.nan, greatest=math.nan, rms=math.nan
        )
    is_low = -least > greatest
    return Extent(
        peak=-least if is_low else greatest,
        peak_time=at["least"] if is_low else at["greatest"],
        least=least,
        greatest=greatest,
        rms=math.sqrt(max(square, 0.0) / length) if length else abs(greatest),
    )


def _steps_until(motion: DenseMotion, end: float) -> int:
    """Number of the steps that begin before a time."""
    return int(np.searchsorted(motion.steps.time[:-1], end, side="left"))


def _occurrences(
    motion: DenseMotion, asked: Observations, event: Event
) -> tuple[Occurrences, float | None]:
    """The times of an event, and the one from which on some may be missing."""
    along = along_motion(motion, asked, event.when)
    step, place, lost = event_places(along, motion.steps.n_steps, event.direction)
    found = Occurrences(
        time=motion.time(step, place),
        position=motion.position(step, place),
        velocity=motion.velocity(step, place),
    )
    if not math.isfinite(lost):
        return found, None
    at = motion.time(np.array([int(lost)]), np.array([lost % 1.0]))
    return found, float(at[0])


def _until(one: Occurrences, end: float) -> Occurrences:
    kept = one.time <= end
    return Occurrences(
        time=one.time[kept], position=one.position[kept], velocity=one.velocity[kept]
    )


def _momentum_and_energy(
    motion: DenseMotion, position: Array, steps: Places, tau: Array
) -> tuple[Array, Array]:
    dynamics, time = dynamics_of(motion.scene), motion.time(steps, tau)
    with np.errstate(all="ignore"):
        momentum = dynamics.momentum(position, motion.velocity(steps, tau), time)
        return momentum, dynamics.energy(position, momentum, time)


def _cut(motion: DenseMotion, trajectory: Trajectory, end: float) -> Trajectory:
    """The run up to a time, its last point; whatever came after, it is a whole one."""
    kept = trajectory.time < end
    at = motion.located(np.array([end]))
    position = motion.position(*at)
    momentum, energy = _momentum_and_energy(motion, position, *at)

    def joined(values: Array | None, last: Array) -> Array | None:
        return None if values is None else np.concatenate([values[kept], last])

    return replace(
        trajectory,
        time=np.append(trajectory.time[kept], end),
        position=np.concatenate([trajectory.position[kept], position]),
        momentum=joined(trajectory.momentum, momentum),
        energy=joined(trajectory.energy, energy),
        status="ok",
        message="",
        diagnostics=None,
    )
