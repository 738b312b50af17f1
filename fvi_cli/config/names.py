"""The names of a motion: what formulas along it may hold, what they mean, and their units."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from fvi_cli.config.models import ExperimentKeys
from fvi_cli.errors import listed, suggestion
from fvi_cli.integrator.observe.dampers import damper_values, force_objection
from fvi_cli.integrator.observe.request import Observations, known_names
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.studies.experiment import UNITS

FORCE: Final = "force"
TAKEN: Final = ("t", "time", "energy", "member", "dof", "mesh")
"""Names of what is stored with every run."""
_QUALITIES: Final = {
    "drift": "length",
    "acceleration": "acceleration",
    "base": "force",
    "force": "force",
    "deformation": "length",
    "work": "energy",
}
"""Key of ``units`` for built-in and damper quantities, by the first part of their names."""


def names_along(problem: Problem, ready: Iterable[str] = ()) -> tuple[str, ...]:
    """Names that expressions along the motion of a problem may hold."""
    known = known_names(problem.coordinates, (*problem.numbers, *problem.inputs))
    names = tuple(dict.fromkeys((*known, *damper_values(problem.scene), *ready)))
    if problem.scene.prescribed is None:
        return names
    # accelerations come from an equation of motion, which a given motion does not have
    accelerations = {f"a{name}" for name in problem.coordinates}
    return tuple(name for name in names if name not in accelerations)


def spoilt_force(formula: Expression, problem: Problem, *, has_impacts: bool) -> str:
    """Why a force or work in a formula has no value; empty: it has one."""
    derived = problem.names.derived
    return force_objection(problem.scene, formula.names, derived, has_impacts=has_impacts)


def other_meanings(observed: Observations, first: AnyProblem, own: AnyProblem) -> Iterator[Wrong]:
    """Names in formulas that mean something else in a member than in the first one."""
    if not (isinstance(first, Problem) and isinstance(own, Problem)) or observed.is_empty:
        return
    if own.coordinates != first.coordinates:
        words = f"has the coordinates {listed(own.coordinates)}, the first member "
        yield Wrong(("problem",), f"{words}{listed(first.coordinates)}; write the same in all")
        return
    expected, found = damper_values(first.scene), damper_values(own.scene)
    numbers = {*known_names(first.coordinates, observed.parameters), *observed.inputs}
    events = {name: one.when for name, one in (observed.events or {}).items()}
    for name, formula in {**(observed.quantities or {}), **events}.items():
        place = "events" if name in events else "quantities", name
        if reason := spoilt_force(formula, own, has_impacts=bool(observed.impacts)):
            yield Wrong(place, reason, of_key=True)
        for word in sorted(formula.names & expected.keys() - numbers):
            if found.get(word) != expected[word]:
                words = f"{word} is another damper here, or none; write the dampers of all members "
                words += "with the same names and order, and one that is absent with coefficient 0"
                yield Wrong(place, words, of_key=True)


def wrong_units(
    keys: ExperimentKeys, problem: AnyProblem, observed: Observations
) -> Iterator[Wrong]:
    """Units of names that have none."""
    known = _with_units(problem, observed)
    for name in keys.units or {}:
        if name not in known:
            words = f"has no unit of its own{suggestion(name, known)}"
            yield Wrong(("units", name), f"{words} (known here: {listed(known[:12])})", of_key=True)


def _with_units(problem: AnyProblem, observed: Observations) -> list[str]:
    quantities = observed.quantities or {}
    groups = [name.rpartition("_")[0] for name in quantities if "_" in name]
    return list(dict.fromkeys((*UNITS, *problem.coordinates, *quantities, *groups)))


def units_of(
    given: Mapping[str, str], problem: AnyProblem, observed: Observations
) -> dict[str, str]:
    """Units of coordinates and quantities.

    The unit of ``drift`` also holds for ``drift_1``, and so for other quantities; built-in
    quantities have by default the unit of their quality, e.g. ``length`` for a drift.
    """
    dampers = {} if problem.scene is None else damper_values(problem.scene)
    units = dict(given)
    for name, formula in (observed.quantities or {}).items():
        quality = ""
        if formula.text in dampers:
            quality = _QUALITIES[dampers[formula.text].kind]
        elif name in observed.ready:
            quality = _QUALITIES[name.partition("_")[0]]
        if unit := given.get(name.rpartition("_")[0]) or given.get(quality):
            units.setdefault(name, unit)
    return units
