"""Requested outputs of a motion, held against the rest of an experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from fvi_cli.config.models import ExperimentKeys
from fvi_cli.config.names import FORCE, TAKEN, names_along, spoilt_force
from fvi_cli.config.text.mistakes import Report
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.observe.request import (
    Event,
    Impact,
    Observations,
    check_observable,
)
from fvi_cli.integrator.observe.surface import Surface, start_objection
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import plain, wrong_formula
from fvi_cli.scenes.problem import AnyProblem, Problem

KEYS: Final = ("output", "quantities", "events", "impacts")


def read_observations(
    keys: ExperimentKeys, problem: AnyProblem, methods: Sequence[AnyMethod], report: Report
) -> Observations:
    """The outputs that the keys of an experiment request."""
    given = [name for name in KEYS if getattr(keys, name) is not None]
    if not isinstance(problem, Problem):
        return Observations()
    is_prescribed = problem.scene.prescribed is not None
    if not given and not is_prescribed:
        return Observations()
    for method in methods:
        try:
            check_observable(method)
        except ValueError as error:
            report.add(str(error), (*given, "problem")[0], of_key=True)
            break
    requested: Mapping[str, str] = keys.quantities or {}  # type: ignore[assignment]
    if isinstance(keys.quantities, list):
        requested = {name: name for name in keys.quantities}
    # a quantity of the user's own hides a built-in one
    ready = {k: one for k, one in problem.ready.items() if requested.get(k, k) == k}
    names = names_along(problem, ready)
    of_surfaces = tuple(dict.fromkeys(("t", *problem.coordinates, *problem.numbers)))
    quantities: dict[str, Expression] = {}
    events: dict[str, Event] = {}
    impacts: dict[str, Impact] = {}
    for name, text in requested.items():
        place = ("quantities", name)
        if isinstance(keys.quantities, list):
            place = ("quantities", keys.quantities.index(name))  # type: ignore[assignment]
        if (found := _formula(name, text, names, problem, report, *place)) is not None:
            quantities[name] = found.expand(ready)
    for name, event in (keys.events or {}).items():
        found = _formula(name, event.when, names, problem, report, "events", name, "when")
        if found is not None:
            when = found.expand(ready)
            events[name] = Event(when=when, direction=event.direction, stop=event.stop)
    for name, impact in (keys.impacts or {}).items():
        place = ("impacts", name, "when")  # type: ignore[assignment]
        found = _formula(name, impact.when, of_surfaces, problem, report, *place)
        if name in events:
            report.add(
                "is the name of an event already; take another", "impacts", name, of_key=True
            )
        if found is None:
            continue
        impacts[name] = Impact(when=found, restitution=impact.restitution)
        surface = Surface(
            impact=impacts[name], coordinates=problem.coordinates, parameters=problem.numbers
        )
        if reason := start_objection(problem.scene, surface):
            report.add(reason, *place)
    if is_prescribed:
        # the force is the result of a damper on the bench
        quantities.setdefault(FORCE, Expression.parse(FORCE, variables=names))
    times = None if keys.output is None else keys.output.instants(problem.final_time)
    if isinstance(times, Wrong):
        report.under("output").extend([times])
    return Observations(
        coordinates=problem.coordinates,
        times=times if isinstance(times, np.ndarray) else None,
        quantities=quantities,
        events=events,
        impacts=impacts,
        parameters=problem.numbers,
        ready=ready,
        inputs=problem.inputs,
        output=None if keys.output is None else plain(keys.output),
    )


def _formula(
    name: str,
    text: str,
    names: tuple[str, ...],
    problem: Problem,
    report: Report,
    *place: str | int,
) -> Expression | None:
    """The expression under a name; None, with mistakes, where something is wrong."""
    if name in (*problem.coordinates, *TAKEN):
        is_listed = isinstance(place[-1], int)
        words = "is the name of something that is stored already; "
        words += "leave it out" if is_listed else "take another"
        report.add(words, *place[:2], of_key=True)
        return None
    if wrong := list(wrong_formula(place, text, names)):
        report.extend(wrong)
        return None
    found = Expression.parse(text, variables=names)
    # surfaces hold no forces
    has_impacts = report.value("impacts") is not None
    if reason := spoilt_force(found, problem, has_impacts=has_impacts):
        report.add(reason, *place)
        return None
    return found
