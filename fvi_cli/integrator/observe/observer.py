"""Quantities, their extents, and events along finished runs of members."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.observe.along import FormulaAlong, Values
from fvi_cli.integrator.observe.dampers import (
    DampersAlong,
    check_forces,
    damper_values,
    dampers_of,
    forces_along,
)
from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.observe.request import Event, Observations, check_observable
from fvi_cli.integrator.observe.search import find_events, find_extents
from fvi_cli.integrator.trajectory import Extent, Observed, Occurrences, Trajectory
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression


def observe_runs(
    scenes: Sequence[Scene],
    method: AnyMethod,
    runs: Sequence[Trajectory],
    requests: Sequence[Observations],
) -> list[Trajectory]:
    """The requested outputs of finished runs by one method with their steps.

    Every run ends at the first event that stops it, and is reported at the requested times.
    Formulas and the directions of events are those of the first member; values of the names in
    them are each member's own. Impacts that a run has are reported like events.

    Raises
    ------
    ValueError
        For a run without steps, and times outside of it.
    """
    check_observable(method)
    assert isinstance(method, Method)
    found: dict[int, Trajectory] = {}
    groups: dict[Hashable, list[int]] = {}
    for index, (scene, run, request) in enumerate(zip(scenes, runs, requests, strict=True)):
        times = request.times
        if times is not None and times[-1] > scene.final_time * (1.0 + 1e-12):
            raise ValueError(
                f"output: {times[-1]:g} is not allowed; the run goes from 0 to {scene.final_time:g}"
            )
        if run.steps is None:
            raise ValueError("observe: the steps of the run were not kept")
        if not run.steps.n_steps:
            found[index] = replace(run, observed=Observed(mesh=run.steps.time))
            continue
        # with a given motion the force is that of all dampers, whose number may differ
        count = 0 if scene.prescribed is None else len(dampers_of(scene))
        groups.setdefault((scene.lagrangian is None, count), []).append(index)
    for members in groups.values():
        own = [scenes[k] for k in members]
        steps = [one.steps for k in members if (one := runs[k]).steps is not None]
        motion = Motion(own, steps, partial(forces_along, own, method, steps))
        observer = Observer(motion, [requests[k] for k in members])
        found.update(zip(members, observer.observe([runs[k] for k in members]), strict=True))
    return [found[index] for index in range(len(runs))]


class Observer:
    """Evaluates requested outputs of the motions of q members; formulas are those of the first."""

    def __init__(self, motion: Motion, requests: Sequence[Observations]) -> None:
        self.motion, self.requests = motion, requests
        self._dampers, self._has_impacts = (
            damper_values(motion.scenes[0]),
            bool(requests[0].impacts),
        )
        self._of_damper = DampersAlong(motion, has_impacts=self._has_impacts)

    def along(self, expression: Expression) -> FormulaAlong:
        """The value of an expression at places; only names that occur in it are evaluated."""
        used = [name for name in self.requests[0].parameters if name in expression.names]
        every = {name: np.array([one.parameters[name] for one in self.requests]) for name in used}
        fixed = {name: float(one[0]) for name, one in every.items() if (one == one[0]).all()}
        owner = self.motion.owner

        def parameters(steps: Places) -> Values:
            varied = every.keys() - fixed.keys()
            return {**fixed, **{name: every[name][owner[steps]] for name in varied}}

        return FormulaAlong(expression, partial(self.variables, expression), parameters)

    def variables(
        self, expression: Expression, steps: Places, tau: Array, is_start: bool = False
    ) -> dict[str, Array | float]:
        """The variables of an expression at places, except the parameters.

        Steps and places are ``(n,)`` both, or ``(n, 1)`` and ``(n, k)``. At the start of runs
        velocities are those that are given.
        """
        motion, request, names = self.motion, self.requests[0], expression.names
        flat = np.broadcast_to(steps, tau.shape).ravel(), tau.ravel()
        values: dict[str, Array | float] = {}
        wanted: dict[str, dict[str, int]] = {}
        for name, (prefix, index) in request.derived.items():
            if name in names:
                wanted.setdefault(prefix, {})[name] = index
        for prefix, own in wanted.items():
            columns = tuple(sorted(own.values()))
            if prefix in ("a", "d"):
                for scene in motion.scenes:
                    check_forces(scene, next(iter(own)), has_impacts=self._has_impacts)
                compute = motion.acceleration if prefix == "a" else motion.damping
                found = compute(*flat, columns).reshape(*tau.shape, len(columns))
            elif is_start and prefix:
                given = np.array([one.initial_velocity for one in motion.scenes])
                found = given[motion.owner[steps]][..., list(columns)]
            else:
                found = (motion.velocity if prefix else motion.position)(steps, tau, columns)
            values |= {name: found[..., columns.index(index)] for name, index in own.items()}
        inputs = names.intersection(request.inputs)
        if inputs or "t" in names:
            values.setdefault("t", motion.time(steps, tau))
        for name in names.intersection(self._dampers) - values.keys() - request.parameters.keys():
            values[name] = self._of_damper(self._dampers[name], *flat).reshape(tau.shape)
        for name in inputs:
            row, time = np.zeros(tau.size), motion.time(*flat)
            for member, places in motion.by_member(flat[0]):
                force = self.requests[member].inputs[name]
                if force is not None:
                    row[places] = force(time[places])[:, 0]
            values[name] = row.reshape(tau.shape)
        return values

    def observe(self, runs: Sequence[Trajectory]) -> list[Trajectory]:
        """Requested outputs of each run, as :func:`observe_runs`."""
        motion, first = self.motion, self.requests[0]
        members = [
            _Member(run, float(steps.time[-1]))
            for run, steps in zip(runs, motion.steps, strict=True)
        ]
        for name, event in first.events.items():
            self._find(name, event, members)
        for one in members:
            if one.run.observed is not None:
                one.events |= one.run.observed.events
                one.stopped_by = one.run.observed.stopped_by
        at = []
        for index, one in enumerate(members):
            self._stop(index, one)
            wanted = self.requests[index].times
            times = one.run.time if wanted is None else wanted
            at.append(motion.located(index, times[times <= one.end * (1.0 + 1e-12)]))
        steps, tau = (np.concatenate(one) for one in zip(*at, strict=True))
        edges = np.cumsum([one[0].size for one in at])[:-1]
        starts = (tau == 0.0) & np.isin(steps, motion.firsts[:-1])
        for name, expression in first.quantities.items():
            along = self.along(expression)
            row = along(steps, tau)
            row[starts] = along.at_starts(steps[starts])[0]
            extents = find_extents(motion, along, [one.end for one in members])
            for one, own, extent in zip(members, np.split(row, edges), extents, strict=True):
                one.quantities[name], one.extents[name] = own, extent
        if first.times is None:
            return [one.result(run.time) for one, run in zip(members, motion.steps, strict=True)]
        position = motion.position(steps, tau)
        every = motion.time(steps, tau), position, *motion.momentum_and_energy(position, steps, tau)
        columns = zip(*(np.split(one, edges) for one in every), strict=True)
        return [
            replace(
                one.result(run.time),
                time=t,
                position=x,
                momentum=p,
                energy=e,
                on_mesh=replace(one.run, steps=None),
            )
            for one, run, (t, x, p, e) in zip(members, motion.steps, columns, strict=True)
        ]

    def _find(self, name: str, event: Event, members: Sequence[_Member]) -> None:
        """Add the occurrences of an event to every member."""
        motion = self.motion
        step, place = find_events(self.along(event.when), motion.owner, event.direction)
        found = self._occurrences(step, place)
        edges = np.searchsorted(step, motion.firsts[1:-1])
        parts = (np.split(one, edges) for one in (found.time, found.position, found.velocity))
        for one, time, position, velocity in zip(members, *parts, strict=True):
            one.events[name] = Occurrences(time=time, position=position, velocity=velocity)

    def _occurrences(self, steps: Places, tau: Array) -> Occurrences:
        motion = self.motion
        return Occurrences(
            time=motion.time(steps, tau),
            position=motion.position(steps, tau),
            velocity=motion.velocity(steps, tau),
        )

    def _stop(self, index: int, member: _Member) -> None:
        """End the run of a member at the first event that does so; it counts as complete."""
        for name, event in self.requests[index].events.items():
            times = member.events[name].time
            if event.stop and times.size and times[0] < member.end:
                member.end, member.stopped_by = float(times[0]), name
        run, end = member.run, member.end
        if end == self.motion.steps[index].time[-1]:
            return
        for name, one in member.events.items():
            kept = one.time <= end
            member.events[name] = Occurrences(
                time=one.time[kept], position=one.position[kept], velocity=one.velocity[kept]
            )
        kept = run.time < end
        at = self.motion.located(index, np.array([end]))
        position = self.motion.position(*at)
        momentum, energy = self.motion.momentum_and_energy(position, *at)

        def join(values: Array | None, last: Array) -> Array | None:
            return None if values is None else np.concatenate([values[kept], last])

        known = run.diagnostics
        member.run = replace(
            run,
            time=np.append(run.time[kept], end),
            position=np.concatenate([run.position[kept], position]),
            momentum=join(run.momentum, momentum),
            energy=join(run.energy, energy),
            status="ok",
            message="",
            remarks=(
                *run.remarks,
                f"stopped by the event {member.stopped_by} at t = {end:.10g}",
            ),
            # works are known at the points of the mesh
            diagnostics=None if known is None else known.until(end),
        )


@dataclass(eq=False)
class _Member:
    """Outputs of a run, up to its end."""

    run: Trajectory
    end: float
    stopped_by: str = ""
    events: dict[str, Occurrences] = field(default_factory=dict)
    quantities: dict[str, Array] = field(default_factory=dict)
    extents: dict[str, Extent] = field(default_factory=dict)

    def result(self, mesh: Array) -> Trajectory:
        """The run on its mesh, with what was observed."""
        observed = Observed(
            mesh=mesh[mesh <= self.end],
            quantities=self.quantities,
            extents=self.extents,
            events=self.events,
            stopped_by=self.stopped_by,
        )
        return replace(self.run, observed=observed)
