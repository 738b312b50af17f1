"""Evaluates formulas, events and extents along the motions of many members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observations.dampers import (
    DampersAlong,
    DamperValue,
    damper_values,
    is_separable,
    loses_by_dampers,
    rough_dampers,
)
from fvi_cli.integrator.observations.formulas import FormulaAlong
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.pieces import by_owner
from fvi_cli.integrator.observations.request import Event, Observations
from fvi_cli.integrator.observations.search import event_places, extents_of
from fvi_cli.integrator.results.observed import Extent, Observed, Occurrences
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.regular import rough_remark
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression

Pair = tuple[Trajectory, Trajectory]


class Observer:
    """Evaluates requested outputs of the motions of q members; formulas are those of the first."""

    def __init__(self, motion: DenseMotion, requests: Sequence[Observations]) -> None:
        self.motion, self.requests, self._first = motion, requests, requests[0]
        self._of_damper = DampersAlong(motion)

    def along(self, expression: Expression) -> FormulaAlong:
        """The value of an expression at places; only what occurs in it is evaluated."""
        constants: Sequence[Mapping[str, float]] = [one.parameters for one in self.requests]
        if all(one == constants[0] for one in constants):
            constants = constants[:1]
        variables = partial(self.variables, expression)
        return FormulaAlong(expression, variables, constants, self.motion.owner)

    def variables(
        self, expression: Expression, steps: Places, tau: Array
    ) -> dict[str, Array | float]:
        """The variables of an expression at places, but for the parameters.

        They are in ``(n,)`` steps at ``(n,)``, or in ``(n, 1)`` at ``(n, k)``.
        """
        motion, names, values = self.motion, expression.names, dict[str, Array | float]()
        flat = np.broadcast_to(steps, tau.shape).ravel(), tau.ravel()
        sources = {"d": motion.damping, "a": motion.acceleration}
        columns: dict[str, Array] = {}
        for name, (prefix, index) in self._first.derived.items():
            if name not in names:
                continue
            if prefix not in columns:
                if prefix in sources:
                    columns[prefix] = sources[prefix](*flat).reshape(*tau.shape, -1)
                else:
                    find = motion.velocity if prefix else motion.position
                    columns[prefix] = find(steps, tau)
            values[name] = columns[prefix][..., index]
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
        self, trajectories: Sequence[Trajectory], impacts: Mapping[str, Array]
    ) -> list[Pair]:
        """Requested outputs of each run, as :func:`observe_members`."""
        motion, q = self.motion, len(trajectories)
        events: list[dict[str, Occurrences]] = [{} for _ in range(q)]
        remarks = [[one] if one else [] for one in motion.remarks]
        for name, event in (self._first.events or {}).items():
            self._find(name, event, events, remarks)
        for name, time in impacts.items():
            events[0][name] = self._occurrences(*motion.located(0, time))
            events[0][name] = replace(events[0][name], time=time)
        given = zip(motion.scenes, self.requests, motion.steps, strict=True)
        for member, (scene, one, steps_of) in enumerate(given):
            remarks[member] += _rough_dampers(scene, one, steps_of)
        runs, ends, stopped = list(trajectories), [float(one.time[-1]) for one in motion.steps], []
        for member, one in enumerate(self.requests):
            stopped.append("")
            for name, event in (one.events or {}).items():
                times = events[member][name].time
                if event.stop and times.size and times[0] < ends[member]:
                    ends[member], stopped[member] = float(times[0]), name
            if stopped[member]:
                end = ends[member]
                events[member] = {name: _until(own, end) for name, own in events[member].items()}
                runs[member] = self._cut(member, runs[member], end)
                remarks[member].append(f"stopped by the event {stopped[member]} at t = {end:.10g}")
        at = [self._reported(*one) for one in zip(range(q), runs, ends, strict=True)]
        steps, tau = (np.concatenate(one) for one in zip(*at, strict=True))
        edges = np.cumsum([one[0].size for one in at])[:-1]
        quantities: list[dict[str, Array]] = [{} for _ in range(q)]
        extents: list[dict[str, Extent]] = [{} for _ in range(q)]
        for name, expression in (self._first.quantities or {}).items():
            along = self.along(expression)
            for member, own in enumerate(np.split(along(steps, tau), edges)):
                quantities[member][name] = own
            for member, extent in enumerate(extents_of(motion, along, ends)):
                extents[member][name] = extent
        columns: list[list[Array]] = []
        if self._first.times is not None:
            position, time = motion.position(steps, tau), motion.time(steps, tau)
            every = time, position, *motion.momentum_and_energy(position, steps, tau)
            columns = [np.split(one, edges) for one in every]
        found = []
        for k, run in enumerate(runs):
            on_mesh = run
            if remarks[k]:
                on_mesh = replace(run, remarks=(*run.remarks, *remarks[k]))
            mesh = motion.steps[k].time
            observed = Observed(
                mesh=mesh[mesh <= ends[k]],
                quantities=quantities[k],
                extents=extents[k],
                events=events[k],
                stopped_by=stopped[k],
            )
            if not columns:
                found.append((on_mesh, replace(on_mesh, observed=observed)))
                continue
            t, x, p, e = (one[k] for one in columns)
            at_times = replace(
                on_mesh,
                observed=observed,
                time=t,
                position=x,
                momentum=p,
                energy=e,
                diagnostics=None,
            )
            found.append((on_mesh, at_times))
        return found

    def _find(
        self,
        name: str,
        event: Event,
        events: Sequence[dict[str, Occurrences]],
        remarks: Sequence[list[str]],
    ) -> None:
        """Put the occurrences of an event to those of every member, with what may be missing."""
        motion = self.motion
        counts = [one.n_steps for one in motion.steps]
        step, place, lost = event_places(self.along(event.when), counts, event.direction)
        found = self._occurrences(step, place)
        edges = np.searchsorted(step, motion.firsts[1:-1])
        parts = (np.split(one, edges) for one in (found.time, found.position, found.velocity))
        for own, time, position, velocity in zip(events, *parts, strict=True):
            own[name] = Occurrences(time=time, position=position, velocity=velocity)
        for member, since in lost.items():
            first = int(motion.firsts[member])
            at = motion.time(np.array([first + int(since)]), np.array([since % 1.0]))
            remarks[member].append(
                f"events.{name}: {event.when.text} changes too fast to find every change of its "
                f"sign from t = {at[0]:.6g} on; some of these times may be missing"
            )

    def _occurrences(self, steps: Places, tau: Array) -> Occurrences:
        motion = self.motion
        return Occurrences(
            time=motion.time(steps, tau),
            position=motion.position(steps, tau),
            velocity=motion.velocity(steps, tau),
        )

    def _reported(self, member: int, run: Trajectory, end: float) -> tuple[Places, Array]:
        """Places of the times that are reported of a member."""
        wanted = self.requests[member].times
        times = run.time if wanted is None else wanted
        return self.motion.located(member, times[times <= end * (1.0 + 1e-12)])

    def _cut(self, member: int, trajectory: Trajectory, end: float) -> Trajectory:
        """The run up to a time, its last point; the truncated run counts as complete."""
        kept = trajectory.time < end
        at = self.motion.located(member, np.array([end]))
        position = self.motion.position(*at)
        momentum, energy = self.motion.momentum_and_energy(position, *at)

        def join(values: Array | None, last: Array) -> Array | None:
            return None if values is None else np.concatenate([values[kept], last])

        return replace(
            trajectory,
            time=np.append(trajectory.time[kept], end),
            position=np.concatenate([trajectory.position[kept], position]),
            momentum=join(trajectory.momentum, momentum),
            energy=join(trajectory.energy, energy),
            status="ok",
            message="",
            diagnostics=None,
        )


def _rough_dampers(scene: Scene, request: Observations, steps: RunSteps) -> tuple[str, ...]:
    """Remark on single dampers that keep the error of the first step, or begin infinite."""
    rough = rough_dampers(scene)
    if not rough:
        return ()
    formulas = [*(request.quantities or {}).values()]
    formulas += [one.when for one in (request.events or {}).values()]
    used = frozenset[str]().union(*(one.names for one in formulas))
    found = []
    for name, one in damper_values(scene).items():
        if name not in used or one.place not in rough or one.kind == "deformation":
            continue
        is_force = one.kind == "force"
        if is_force:
            found.append(
                f"{name} is infinite at t = 0; least, greatest, peak and rms leave that out"
            )
        is_known = is_separable(scene) if is_force else len(rough) == 1
        if not (is_known and (is_force or loses_by_dampers(scene, steps))):
            found.append(rough_remark(scene, f"{name} keeps"))
    return tuple(found)


def _until(one: Occurrences, end: float) -> Occurrences:
    kept = one.time <= end
    return Occurrences(
        time=one.time[kept], position=one.position[kept], velocity=one.velocity[kept]
    )
