"""Quantities, their extents, and events along finished runs of members."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.observe.along import FormulaAlong, find_events, find_extents
from fvi_cli.integrator.observe.dampers import (
    damper_along,
    damper_values,
    force_objection,
    forces_along,
)
from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.integrator.trajectory import Extent, Observed, Occurrences, Trajectory
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression


def observe_runs(
    scenes: Sequence[Scene],
    method: AnyMethod,
    runs: Sequence[Trajectory],
    requests: Sequence[Observations],
) -> list[Trajectory]:
    """The requested outputs of finished runs with their steps, of scenes of one kind on one mesh.

    Every run ends at the first event that stops it, and is reported at the requested times.
    Formulas and the directions of events are those of the first member; values of the names in
    them are each member's own. Impacts that a run has are reported like events.

    Raises
    ------
    ValueError
        For a run without steps, and times outside of it.
    """
    assert isinstance(method, Method)
    steps = []
    for scene, run, request in zip(scenes, runs, requests, strict=True):
        times = request.times
        if times is not None and times[-1] > scene.final_time * (1.0 + 1e-12):
            raise ValueError(
                f"output: {times[-1]:g} is not allowed; the run goes from 0 to {scene.final_time:g}"
            )
        if run.steps is None:
            raise ValueError("observe: the steps of the run were not kept")
        steps.append(run.steps)
    found = [replace(run, observed=Observed(mesh=run.time[:1])) for run in runs]
    moved = [k for k, one in enumerate(steps) if one.n_steps]
    if moved:
        own, done = [scenes[k] for k in moved], [steps[k] for k in moved]
        observer = Observer(
            Motion(own, done, partial(forces_along, own, method, done)),
            [requests[k] for k in moved],
        )
        for k, one in zip(moved, observer.observe([runs[k] for k in moved]), strict=True):
            found[k] = one
    return found


class Observer:
    """Evaluates requested outputs of the motions of q members; formulas are those of the first."""

    def __init__(self, motion: Motion, requests: Sequence[Observations]) -> None:
        self.motion, self.requests = motion, requests
        self._dampers = damper_values(motion.scenes[0])

    def along(self, expression: Expression) -> FormulaAlong:
        """The value of an expression at places; only names that occur in it are evaluated."""
        request = self.requests[0]
        for scene in self.motion.scenes:
            if reason := force_objection(
                scene, expression.names, request.derived, has_impacts=bool(request.impacts)
            ):
                raise ValueError(reason)
        return FormulaAlong(expression, partial(self.variables, expression))

    def variables(
        self, expression: Expression, steps: Places, tau: Array
    ) -> dict[str, Array | float]:
        """The variables of an expression at places.

        Steps and places are ``(n,)`` both, or ``(n, 1)`` and ``(n, k)``.
        """
        motion, request, names = self.motion, self.requests[0], expression.names
        flat = np.broadcast_to(steps, tau.shape).ravel(), tau.ravel()
        values: dict[str, Array | float] = {}
        for name in names & request.parameters.keys():
            every = np.array([one.parameters[name] for one in self.requests])
            values[name] = every[motion.owner[steps]] if np.ptp(every) else float(every[0])
        wanted: dict[str, dict[str, int]] = {}
        for name, (prefix, index) in request.derived.items():
            if name in names:
                wanted.setdefault(prefix, {})[name] = index
        for prefix, own in wanted.items():
            columns = tuple(sorted(own.values()))
            if prefix in ("a", "d"):
                compute = motion.acceleration if prefix == "a" else motion.damping
                found = compute(*flat, columns).reshape(*tau.shape, len(columns))
            else:
                found = (motion.velocity if prefix else motion.position)(steps, tau, columns)
            values |= {name: found[..., columns.index(index)] for name, index in own.items()}
        inputs = names.intersection(request.inputs)
        if inputs or "t" in names:
            values.setdefault("t", motion.time(steps, tau))
        for name in names.intersection(self._dampers) - values.keys():
            values[name] = damper_along(motion, self._dampers[name], *flat).reshape(tau.shape)
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
        events: list[dict[str, Occurrences]] = [
            dict(run.observed.events) if run.observed else {} for run in runs
        ]
        for name, event in first.events.items():
            step, place = find_events(self.along(event.when), motion.owner, event.direction)
            every = motion.time(step, place), motion.position(step, place)
            parts = self._split(step, *every, motion.velocity(step, place))
            for known, (time, position, velocity) in zip(events, parts, strict=True):
                known[name] = Occurrences(time=time, position=position, velocity=velocity)
        ended, ends, at = list[Trajectory](), list[float](), list[tuple[Places, Array]]()
        for k, run in enumerate(runs):
            mesh, asked = motion.steps[k].time, self.requests[k].times
            stopped, end = run.observed.stopped_by if run.observed else "", float(mesh[-1])
            for name, event in first.events.items():
                times = events[k][name].time
                if event.stop and times.size and times[0] < end:
                    end, stopped = float(times[0]), name
            known = {name: one.until(end) for name, one in events[k].items()}
            observed = Observed(mesh=mesh[mesh <= end], events=known, stopped_by=stopped)
            one = replace(run, observed=observed)
            if end < mesh[-1]:
                one = _stopped(one, end)
            if asked is None:
                asked = one.time if end == mesh[-1] else np.append(one.time, end)
            ended.append(one)
            ends.append(end)
            at.append(motion.located(k, asked[asked <= end * (1.0 + 1e-12)]))
        steps, tau = (np.concatenate(one) for one in zip(*at, strict=True))
        rows, extents = dict[str, list[Array]](), dict[str, list[Extent]]()
        for name, expression in first.quantities.items():
            along = self.along(expression)
            rows[name] = [own for (own,) in self._split(steps, along(steps, tau))]
            extents[name] = find_extents(motion, along, ends)
        points: list[list[Array]] = [[]] * len(runs)
        is_cut = [end < run.time[-1] for end, run in zip(ends, motion.steps, strict=True)]
        if first.times is not None or any(is_cut):
            position = motion.position(steps, tau)
            more = motion.momentum_and_energy(position, steps, tau)
            points = self._split(steps, motion.time(steps, tau), position, *more)
        found = []
        for k, one in enumerate(ended):
            reported = one
            if first.times is not None or is_cut[k]:
                time, position, momentum, energy = points[k]
                whole = None if first.times is None else replace(one, observed=None, steps=None)
                reported = replace(
                    one,
                    time=time,
                    position=position,
                    momentum=momentum,
                    energy=energy,
                    on_mesh=whole,
                )
            assert one.observed is not None
            observed = replace(
                one.observed,
                quantities={name: row[k] for name, row in rows.items()},
                extents={name: own[k] for name, own in extents.items()},
            )
            found.append(replace(reported, observed=observed))
        return found

    def _split(self, steps: Places, *every: Array) -> list[list[Array]]:
        """Values at places of ascending steps, for every member."""
        edges = np.searchsorted(steps, self.motion.firsts[1:-1])
        columns = [np.split(one, edges) for one in every]
        return [list(own) for own in zip(*columns, strict=True)]


def _stopped(run: Trajectory, end: float) -> Trajectory:
    """The points of a run before an event that ends it; it counts as complete."""
    event = run.observed and run.observed.stopped_by
    return replace(
        run.at(run.time < end),
        status="ok",
        message="",
        remarks=(*run.remarks, f"stopped by the event {event} at t = {end:.10g}"),
    )
