"""Evaluates formulas, events and extents along the motions of many members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fvi_cli.integrator.observations.dampers import (
    DampersAlong,
    DamperValue,
    check_forces,
    damper_values,
)
from fvi_cli.integrator.observations.formulas import FormulaAlong
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.pieces import by_owner
from fvi_cli.integrator.observations.request import Event, Observations
from fvi_cli.integrator.observations.search import event_places, extents_of
from fvi_cli.integrator.results.observed import Extent, Observed, Occurrences
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression

Pair = tuple[Trajectory, Trajectory]


class Observer:
    """Evaluates requested outputs of the motions of q members; formulas are those of the first."""

    def __init__(self, motion: DenseMotion, requests: Sequence[Observations]) -> None:
        self.motion, self.requests, self._first = motion, requests, requests[0]
        self._of_damper = DampersAlong(motion)
        self._derived = self._first.derived

    def along(self, expression: Expression) -> FormulaAlong:
        """The value of an expression at places; only names that occur in it are evaluated."""
        known = [(one, one.parameters.keys() & expression.names) for one in self.requests]
        constants = [{name: one.parameters[name] for name in used} for one, used in known]
        if all(one == constants[0] for one in constants):
            constants = constants[:1]
        variables = partial(self.variables, expression)
        starts = partial(self.variables, expression, is_start=True)
        return FormulaAlong(expression, variables, constants, self.motion.owner, starts)

    def variables(
        self, expression: Expression, steps: Places, tau: Array, *, is_start: bool = False
    ) -> dict[str, Array | float]:
        """The variables of an expression at places, except the parameters.

        Steps and places are ``(n,)`` both, or ``(n, 1)`` and ``(n, k)``. At the start of runs
        velocities may be those that are given.
        """
        motion, names, values = self.motion, expression.names, dict[str, Array | float]()
        flat = np.broadcast_to(steps, tau.shape).ravel(), tau.ravel()
        sources = {"d": motion.damping, "a": motion.acceleration}
        wanted: dict[str, dict[str, int]] = {}
        for name, (prefix, index) in self._derived.items():
            if name in names:
                wanted.setdefault(prefix, {})[name] = index
        for prefix, own in wanted.items():
            columns = tuple(sorted(own.values()))
            if prefix in sources:
                for scene in motion.scenes:
                    check_forces(scene, next(iter(own)))
                found = sources[prefix](*flat, columns).reshape(*tau.shape, -1)
            elif is_start and prefix:
                owners = motion.owner[steps].tolist()
                given = [motion.scenes[k].initial_velocity for k in owners]
                found = np.array(given)[..., list(columns)]
            else:
                find = motion.velocity if prefix else motion.position
                found = find(steps, tau, columns)
            for name, index in own.items():
                values[name] = found[..., columns.index(index)]
        inputs = names.intersection(self._first.inputs)
        if inputs or "t" in names:
            values.setdefault("t", motion.time(steps, tau))
        dampers = names.intersection(self._dampers) - set(values) - set(self._first.parameters)
        for name in sorted(dampers):
            values[name] = self._of_damper(self._dampers[name], *flat).reshape(tau.shape)
        for name in inputs:
            values[name] = self._input(name, *flat).reshape(tau.shape)
        return values

    @cached_property
    def _dampers(self) -> Mapping[str, DamperValue]:
        return damper_values(self.motion.scenes[0])

    def _input(self, name: str, steps: Places, tau: Array) -> Array:
        found, time = np.zeros(steps.size), self.motion.time(steps, tau)
        for member, own in by_owner(self.motion.owner, steps, len(self.requests)):
            given = self.requests[member].inputs[name]
            if given is not None:
                found[own] = given(time[own])[:, 0]
        return found

    def observe(
        self, trajectories: Sequence[Trajectory], impacts: Mapping[str, Array], rests_on: str
    ) -> list[Pair]:
        """Requested outputs of each run, as :func:`observe_members`."""
        motion = self.motion
        members = [
            _Member(run, float(steps.time[-1]), [])
            for run, steps in zip(trajectories, motion.steps, strict=True)
        ]
        for name, event in (self._first.events or {}).items():
            self._find(name, event, members)
        members[0].stopped_by = rests_on
        for name, time in impacts.items():
            found = self._occurrences(*motion.located(0, time))
            members[0].events[name] = replace(found, time=time)
        at = []
        for index, one in enumerate(members):
            self._stop(index, one)
            wanted = self.requests[index].times
            times = one.run.time if wanted is None else wanted
            at.append(motion.located(index, times[times <= one.end * (1.0 + 1e-12)]))
        steps, tau = (np.concatenate(one) for one in zip(*at, strict=True))
        edges = np.cumsum([one[0].size for one in at])[:-1]
        for name, expression in (self._first.quantities or {}).items():
            along = self.along(expression)
            row = along(steps, tau)
            is_start = (tau == 0.0) & np.isin(steps, motion.firsts[:-1])
            if is_start.any():
                row[is_start] = along.at_starts(steps[is_start])
            values = np.split(row, edges)
            extents = extents_of(motion, along, [one.end for one in members])
            for one, own, extent in zip(members, values, extents, strict=True):
                one.quantities[name], one.extents[name] = own, extent
        meshes = [one.time for one in motion.steps]
        if self._first.times is None:
            return [one.pair(mesh) for one, mesh in zip(members, meshes, strict=True)]
        position, time = motion.position(steps, tau), motion.time(steps, tau)
        every = time, position, *motion.momentum_and_energy(position, steps, tau)
        columns = zip(*(np.split(one, edges) for one in every), strict=True)
        return [
            one.pair(mesh, time=t, position=x, momentum=p, energy=e, diagnostics=None)
            for one, mesh, (t, x, p, e) in zip(members, meshes, columns, strict=True)
        ]

    def _find(self, name: str, event: Event, members: Sequence[_Member]) -> None:
        """Add the occurrences of an event to every member."""
        motion = self.motion
        counts = [one.n_steps for one in motion.steps]
        step, place = event_places(self.along(event.when), counts, event.direction)
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
        for name, event in (self.requests[index].events or {}).items():
            times = member.events[name].time
            if event.stop and times.size and times[0] < member.end:
                member.end, member.stopped_by = float(times[0]), name
        if member.end == self.motion.steps[index].time[-1]:
            return
        run, end = member.run, member.end
        member.remarks.append(f"stopped by the event {member.stopped_by} at t = {end:.10g}")
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

        member.run = replace(
            run,
            time=np.append(run.time[kept], end),
            position=np.concatenate([run.position[kept], position]),
            momentum=join(run.momentum, momentum),
            energy=join(run.energy, energy),
            status="ok",
            message="",
            diagnostics=None,
        )


@dataclass(eq=False)
class _Member:
    """Outputs of a run, up to its end."""

    run: Trajectory
    end: float
    remarks: list[str]
    stopped_by: str = ""
    events: dict[str, Occurrences] = field(default_factory=dict)
    quantities: dict[str, Array] = field(default_factory=dict)
    extents: dict[str, Extent] = field(default_factory=dict)

    def pair(self, mesh: Array, **reported: Any) -> Pair:
        """The run on its mesh, and with what was observed and is reported in place of it."""
        on_mesh = self.run
        if self.remarks:
            on_mesh = replace(on_mesh, remarks=(*on_mesh.remarks, *self.remarks))
        observed = Observed(
            mesh=mesh[mesh <= self.end],
            quantities=self.quantities,
            extents=self.extents,
            events=self.events,
            stopped_by=self.stopped_by,
        )
        return on_mesh, replace(on_mesh, observed=observed, **reported)
