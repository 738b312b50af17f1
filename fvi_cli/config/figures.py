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
from fvi_cli.studies.figure_settings import FigureSettings
from fvi_cli.studies.members import Member

_EVENTS: Final = "; give events: {turn: {when: vx, direction: falling}}"
_QUANTITIES: Final = "; give quantities: {drift: x2 - x1}"
_NEEDS: Final = {
    "section": f"a section needs events{_EVENTS}",
    "quantities": f"there are no quantities{_QUANTITIES}",
    "hysteresis": "it needs the force of a damper; give quantities: {force: force_1}",
}
_SWEEP: Final = "; write sweep: {problem.stiffness: {from: 1, to: 2, number: 9}}"


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
            there = {"section": events, "quantities": quantities, "hysteresis": quantities}
            if not there.get(one, True):
                yield Wrong((index,), _NEEDS[one])
            continue
        if one.file_name in names:
            yield Wrong((index,), "is given twice")
        names.append(one.file_name)
        if one.section is not None:
            yield from _unknown(one.section, events, "an event", (index, "section"), _EVENTS)
        elif one.ensemble is not None:
            if len(members) < 2:
                yield Wrong((index, "ensemble"), "no members to take a mean of; give a sweep")
            known = [*problem.coordinates, *quantities]
            for number, name in enumerate(one.ensemble):
                place = (index, "ensemble", number)
                yield from _unknown(name, known, "a coordinate or quantity", place, _QUANTITIES)
        else:
            which, quantity = one.extent
            if one.plot not in events and not (which and quantity in quantities):
                known = [*(f"peak_{name}" for name in quantities), *events]
                what = "peak_<quantity> or an event"
                yield from _unknown(one.plot or "", known, what, (index, "plot"), _QUANTITIES)
            key, swept = one.against or "", _swept(members)
            yield from _unknown(key, swept, "a swept key", (index, "against"), _SWEEP)
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


def _swept(members: Sequence[Member]) -> list[str]:
    """The swept keys whose values are numbers."""
    values = members[0].values if members else {}
    numbers = [
        key
        for key in values
        if all(isinstance(member.values[key], int | float) for member in members)
    ]
    return [key for key in numbers if len({member.values[key] for member in members}) > 1]


def _unknown(
    word: str, known: Collection[str], what: str, place: KeyPath, empty: str = ""
) -> Iterator[Wrong]:
    """An unknown word; `empty` is the advice if no word is known."""
    if word not in known:
        near = suggestion(word, known)
        hint = f"{near} (here: {listed(list(known)[:12])})" if known else empty
        yield Wrong(place, f"{excerpt(word)!r} is not {what}{hint}")
