"""Checks of requested outputs of a motion against the rest of an experiment."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from fvi_cli.config.keys.experiment import ExperimentKeys
from fvi_cli.config.keys.ladder import Ladder
from fvi_cli.config.keys.methods import ListedMethod
from fvi_cli.config.keys.observations import Output
from fvi_cli.config.keys.store import StoreKeys
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.observe.dampers import check_forces, damper_values
from fvi_cli.integrator.observe.request import (
    Event,
    Impact,
    Observations,
    check_observable,
    known_names,
    surface_objection,
)
from fvi_cli.integrator.observe.surface import Surface, start_objection
from fvi_cli.keys.complaints import listed as listed_words
from fvi_cli.keys.complaints import suggestion
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.keys.nodes import ListNode
from fvi_cli.keys.scalars import FormulaText
from fvi_cli.keys.settings import as_plain
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.studies.experiment import UNITS
from fvi_cli.studies.figure_settings import FigureSettings

FORCE: Final = "force"
KEYS: Final = ("output", "quantities", "events", "impacts")
_TAKEN: Final = ("t", "time", "energy", "member", "dof", "mesh")
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def _named(given: object) -> Mapping[str, Any]:
    """A mapping that was read; empty if it is no mapping."""
    return given if isinstance(given, Mapping) else {}


def read_units(
    settings: ExperimentKeys, problem: AnyProblem, observed: Observations, at: Cursor
) -> dict[str, str]:
    """Units of coordinates and quantities; complains of units for unknown names.

    The unit of ``drift`` also holds for ``drift_1``, and so for other quantities; built-in
    quantities have by default the unit of their quality, e.g. ``length`` for a drift.
    """
    coordinates = problem.coordinates if isinstance(problem, Problem) else ()
    given = {name: one for name, one in _named(settings.units).items() if isinstance(one, str)}
    requested = dict.fromkeys((*_named(settings.quantities), *(observed.quantities or {})))
    groups = {name: name.rpartition("_")[0] for name in requested if "_" in name}
    known = tuple(dict.fromkeys((*UNITS, *coordinates, *requested, *groups.values())))
    for name in given:
        if name not in known:
            at.under("units").refuse_key(
                name,
                f"has no unit of its own{suggestion(name, known)} "
                f"(known here: {listed_words(known[:12])})",
            )
    dampers = {} if problem.scene is None else damper_values(problem.scene)
    units = dict(given)
    for name, formula in (observed.quantities or {}).items():
        quality = ""
        if formula.text in dampers:
            quality = _QUALITIES[dampers[formula.text].kind]
        elif name in observed.ready:
            quality = _QUALITIES[name.partition("_")[0]]
        if unit := given.get(groups.get(name, "")) or given.get(quality):
            units.setdefault(name, unit)
    return units


_QUALITIES: Final = {
    "drift": "length",
    "acceleration": "acceleration",
    "base": "force",
    "force": "force",
    "deformation": "length",
    "work": "energy",
}
"""Key of ``units`` for built-in and damper quantities, by the first part of their names."""


def read_observations(
    settings: ExperimentKeys, problem: AnyProblem, methods: Sequence[ListedMethod], at: Cursor
) -> Observations:
    """The outputs that the keys of an experiment (at the cursor `at`) request."""
    given = [name for name in KEYS if at.has(name)]
    is_prescribed = isinstance(problem, Problem) and problem.scene.prescribed is not None
    drawn = _drawn(settings, problem)
    if not given and not is_prescribed and not drawn:
        return Observations()
    if not isinstance(problem, Problem):
        at.refuse_key(given[0], f"not for kind {problem.kind}, which has no motion")
        return Observations()
    key = (*given, *["figures"] * bool(drawn), "problem")[0]
    _check_neighbours(settings, methods, key, at)
    of_surfaces = known_names(problem.coordinates, (*problem.numbers, *problem.inputs))
    texts = {**_named(settings.quantities), **{name: name for name in drawn}}
    # a quantity of the user's own hides a built-in one
    ready = {k: one for k, one in problem.ready.items() if texts.get(k, k) == k}
    names = names_along(problem, ready)
    quantities: dict[str, Expression] = {}
    events: dict[str, Event] = {}
    impacts: dict[str, Impact] = {}
    has_impacts = at.has("impacts")
    for name in _named(settings.quantities):
        found = _expression(name, names, problem, at.under("quantities"), has_impacts=has_impacts)
        if found is not None:
            quantities[name] = found.expand(ready)
    for name in drawn:
        quantities[name] = Expression.parse(name, variables=names).expand(ready)
    for name, one in _named(settings.events).items():
        if not is_complete(one):
            continue
        found = _expression(
            name, names, problem, at.under("events"), "when", has_impacts=has_impacts
        )
        if found is not None and found.is_constant:
            at.under("events", name).refuse(
                f"{found.text} never changes its sign; for once every period T write "
                "{when: sin(2*pi*t/T), direction: rising}",
                "when",
            )
        elif found is not None:
            events[name] = Event(when=found.expand(ready), direction=one.direction, stop=one.stop)
    for name, one in _named(settings.impacts).items():
        under = at.under("impacts")
        if not is_complete(one):
            continue
        found = _expression(name, of_surfaces, problem, under, "when")
        if found is None:
            continue
        if name in events:
            under.refuse_key(name, "is the name of an event already; take another")
        elif reason := surface_objection(found, problem.coordinates):
            under.refuse(reason, name, "when")
        elif one.restitution > 1.0:
            under.refuse(f"{one.restitution:g} is above 1", name, "restitution")
        else:
            impacts[name] = Impact(when=found, restitution=one.restitution)
            surface = Surface(
                impact=impacts[name], coordinates=problem.coordinates, parameters=problem.numbers
            )
            if reason := start_objection(problem.scene, surface):
                under.refuse(reason, name, "when")
    if is_prescribed:
        # the force is the result of a damper on the bench
        quantities.setdefault(FORCE, Expression.parse(FORCE, variables=names))
    times = None
    if isinstance(settings.output, Output) and is_complete(settings.output):
        try:
            times = settings.output.instants(problem.final_time)
        except ArgumentError as error:
            at.under("output").report_argument(error)
    return Observations(
        coordinates=problem.coordinates,
        times=times,
        quantities=quantities,
        events=events,
        impacts=impacts,
        parameters=problem.numbers,
        ready=ready,
        inputs=problem.inputs,
        output=None if times is None else as_plain(settings.output),
    )


def _drawn(settings: ExperimentKeys, problem: AnyProblem) -> list[str]:
    """Built-in quantities that figures show and ``quantities`` does not request."""
    given = settings.figures if isinstance(settings.figures, tuple) else ()
    figures = [one for one in given if isinstance(one, FigureSettings)]
    shown = [one.extent[1] for one in figures]
    ready = problem.ready if isinstance(problem, Problem) else {}
    named = _named(settings.quantities)
    return [name for name in dict.fromkeys(shown) if name in ready and name not in named]


def names_along(problem: Problem, ready: Iterable[str] = ()) -> tuple[str, ...]:
    """Names that expressions along the motion of a problem may hold."""
    known = known_names(problem.coordinates, (*problem.numbers, *problem.inputs))
    names = tuple(dict.fromkeys((*known, *damper_values(problem.scene), *ready)))
    if problem.scene.prescribed is None:
        return names
    # accelerations come from an equation of motion, which a given motion does not have
    accelerations = {f"a{name}" for name in problem.coordinates}
    return tuple(name for name in names if name not in accelerations)


def check_member(observed: Observations, first: AnyProblem, own: AnyProblem, at: Cursor) -> None:
    """Complain of names in formulas that mean something else than in the first member."""
    if not (isinstance(first, Problem) and isinstance(own, Problem)) or observed.is_empty:
        return
    if own.coordinates != first.coordinates:
        at.refuse(
            f"has the coordinates {listed_words(own.coordinates)}, the first member "
            f"{listed_words(first.coordinates)}; write the same in all members",
            "problem",
        )
        return
    events = {name: one.when for name, one in (observed.events or {}).items()}
    expected, found = damper_values(first.scene), damper_values(own.scene)
    for key, formulas in (("quantities", observed.quantities or {}), ("events", events)):
        for name, formula in formulas.items():
            if reason := _spoilt(formula, own, has_impacts=bool(observed.impacts)):
                at.under(key).refuse_key(name, reason)
            known = {*known_names(first.coordinates, observed.parameters), *observed.inputs}
            for word in sorted(formula.names & expected.keys() - known):
                if found.get(word) == expected[word]:
                    continue
                what = "is that of another damper" if word in found else "does not exist"
                at.under(key).refuse_key(
                    name,
                    f"{word} {what} here; write the dampers of all members with the same names, in "
                    "the same order, and one that is absent with coefficients or moduli 0",
                )


def _check_neighbours(
    settings: ExperimentKeys, methods: Sequence[ListedMethod], name: str, at: Cursor
) -> None:
    """Complain of settings that exclude output, quantities, events or impacts."""
    for listed in methods:
        try:
            check_observable(listed.method)
        except ValueError as error:
            at.refuse_key(name, str(error))
            break
    if at.has("output") and isinstance(settings.store, StoreKeys) and settings.store.every != 1:
        message = "not together with output, which chooses the stored times; leave out one"
        at.refuse(message, "store", "every")
    if not at.has("impacts"):
        return
    if (at.has("sweep") or at.has("designs")) and not at.has("output"):
        at.refuse_key(
            "impacts",
            "in a sweep, and of designs, every member has a mesh of its own; give output too",
        )
    if at.has("accuracy"):
        at.refuse_key("impacts", "not together with accuracy; give a ladder")
    if isinstance(settings.ladder, Ladder) and settings.ladder.grading is not None:
        at.refuse("not together with impacts, which grade the mesh themselves", "ladder", "grading")


def _expression(
    name: str,
    names: tuple[str, ...],
    problem: Problem,
    under: Cursor,
    *inner: str,
    has_impacts: bool = False,
) -> Expression | None:
    """The expression under a name; None, with complaints, where something is wrong."""
    if not _NAME.fullmatch(name):
        under.refuse_key(name, "a name has letters, digits and _, and begins with a letter")
        return None
    if name in (*problem.coordinates, *_TAKEN):
        instead = "leave it out" if isinstance(under.node, ListNode) else "take another"
        under.refuse_key(name, f"is the name of something that is stored already; {instead}")
        return None
    # in a list of names a name is its own expression
    at = next((one for one in under.items() if one.scalar == name), under.under(name, *inner))
    text = FormulaText(variables=names).read(at)
    found = Expression.parse(text, variables=names) if isinstance(text, str) else None
    if found is not None and (reason := _spoilt(found, problem, has_impacts=has_impacts)):
        at.refuse(reason)
        return None
    return found


def _spoilt(formula: Expression, problem: Problem, *, has_impacts: bool) -> str:
    """Why a force or work in a formula has no value; empty: it has one."""
    scene, dampers = problem.scene, damper_values(problem.scene)
    forces = {p + name for p in "ad" for name in problem.coordinates} - set(problem.coordinates)
    try:
        for word in sorted(formula.names):
            kind = dampers[word].kind if word in dampers else "force" * (word in forces)
            if kind in ("force", "work"):
                check_forces(scene, word, is_work=kind == "work", has_impacts=has_impacts)
    except ValueError as error:
        return str(error)
    return ""
