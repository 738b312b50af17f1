"""Figures, held against the rest of an experiment."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Annotated, Any, Final

from pydantic import TypeAdapter, ValidationError

from fvi_cli.errors import ArgumentError, excerpt, listed, suggestion
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.scenes.keys.mistakes import KeyPath, Wrong, first_mistake
from fvi_cli.scenes.keys.values import BY_FORM
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.studies.experiment import Experiment, FigureKind
from fvi_cli.studies.members import Member
from fvi_cli.studies.settings import FigureSettings

_NEEDS: Final = {
    "section": "events: {turn: {when: vx, direction: falling}}",
    "quantities": "quantities: {drift: x2 - x1}",
    "hysteresis": "the force of a damper, quantities: {force: force_1}",
}


def wrong_figures(
    figures: Sequence[str | FigureSettings],
    problem: AnyProblem,
    observed: Observations,
    members: Sequence[Member],
) -> Iterator[Wrong]:
    """Figures of quantities and events that do not exist."""
    names: list[str] = []
    events = [*(observed.events or {}), *(observed.impacts or {})]
    quantities = list(observed.quantities or {})
    for index, one in enumerate(figures):
        if isinstance(one, str):
            if one in _NEEDS and not (events if one == "section" else quantities):
                yield Wrong((index,), f"it needs {_NEEDS[one]}")
            continue
        if one.file_name in names:
            yield Wrong((index,), "is given twice")
        names.append(one.file_name)
        if one.section is not None:
            yield from _unknown(one.section, events, "an event", (index, "section"))
        elif one.ensemble is not None:
            if len(members) < 2:
                yield Wrong((index, "ensemble"), "no members to take a mean of; give a sweep")
            known = [*problem.coordinates, *quantities]
            for number, name in enumerate(one.ensemble):
                place = (index, "ensemble", number)
                yield from _unknown(name, known, "a coordinate or quantity", place)
        else:
            which, quantity = one.extent
            if one.plot not in events and not (which and quantity in quantities):
                known = [*(f"peak_{name}" for name in quantities), *events]
                what = "peak_<quantity> or an event"
                yield from _unknown(one.plot or "", known, what, (index, "plot"))
            yield from _unknown(
                one.against or "", list(_swept(members)), "a swept key", (index, "against")
            )
        if one.after and one.section is None and one.plot not in events:
            yield Wrong((index, "after"), "for events only: leave it out", of_key=True)
        elif one.after >= problem.final_time:
            words = f"not before final_time = {problem.final_time:g}"
            yield Wrong((index, "after"), words)


def one_figure(given: str | Mapping[str, Any], experiment: Experiment) -> str | FigureSettings:
    """The figure of an experiment that a word or a mapping names.

    Raises
    ------
    ArgumentError
        At ``figure``.
    """
    model: Any = Annotated[FigureKind | FigureSettings, BY_FORM]
    value = given if isinstance(given, str) else dict(given)
    try:
        figure: str | FigureSettings = TypeAdapter(model).validate_python(value)
    except ValidationError as error:
        raise first_mistake(error).below("figure") from None
    wrong = wrong_figures([figure], experiment.problem, experiment.observations, experiment.members)
    for one in wrong:
        raise ArgumentError(".".join(("figure", *map(str, one.path[1:]))), one.message)
    return figure


def _swept(members: Sequence[Member]) -> Iterator[str]:
    """The swept keys whose values are numbers."""
    for key in members[0].values if members else ():
        values = [member.values[key] for member in members]
        if all(isinstance(one, int | float) for one in values) and len({*values}) > 1:
            yield key


def _unknown(word: str, known: Collection[str], what: str, place: KeyPath) -> Iterator[Wrong]:
    """An unknown word."""
    if word not in known:
        there = f"here: {listed(list(known)[:12])}" if known else "there is none here"
        yield Wrong(place, f"{excerpt(word)!r} is not {what}{suggestion(word, known)} ({there})")
