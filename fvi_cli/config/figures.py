"""Checks of figures against the rest of an experiment."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from fvi_cli.config.keys.experiment import FIGURES
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.nodes import node_of
from fvi_cli.keys.settings import RaisingComplaints
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.figure_settings import EXTENTS, FigureSettings
from fvi_cli.studies.members import Member


def check_figures(
    figures: Sequence[str | FigureSettings],
    problem: AnyProblem,
    observed: Observations,
    members: Sequence[Member],
    at: Cursor,
) -> None:
    """Complain of figures (at the cursor `at`) of quantities and events that do not exist."""
    names: list[str] = []
    events = [*(observed.events or {}), *(observed.impacts or {})]
    quantities = list(observed.quantities or {})
    coordinates = problem.coordinates if isinstance(problem, Problem) else ()
    for index, one in enumerate(figures):
        if isinstance(one, str):
            there = {"section": events, "quantities": quantities, "hysteresis": quantities}
            # other complaints come first: they may explain why the figure is not possible
            if not there.get(one, True) and not len(at.complaints):
                at.under(index).refuse(_NEEDS[one])
            continue
        is_complete = isinstance(one, FigureSettings) and (
            one.section or one.ensemble or (one.plot and one.against)
        )
        if not isinstance(one, FigureSettings) or not is_complete:
            continue
        here = at.under(index)
        if one.file_name in names:
            here.refuse("is given twice")
        names.append(one.file_name)
        if one.section is not None:
            _check_word(one.section, events, "an event", here.under("section"), _EVENTS)
        elif one.ensemble is not None:
            if len(members) < 2:
                here.refuse(f"there are no members to take a mean of; {_MEMBERS}", "ensemble")
            for number, name in enumerate(one.ensemble):
                under = here.under("ensemble", number)
                known = [*coordinates, *quantities]
                _check_word(name, known, "a coordinate or quantity", under, _QUANTITIES)
        else:
            _check_plot(one, quantities, events, here)
            keys = _swept(members)
            if not keys:
                key = one.against or ""
                is_key = key.startswith("problem.")
                here.refuse(_SWEEP.format(key=excerpt(key)) if is_key else _OVER_TIME, "against")
            else:
                _check_word(one.against, keys, "a swept key", here.under("against"))
        is_of_events = one.section is not None or one.plot in events
        if one.after and not is_of_events:
            here.refuse_key("after", "for events only: leave it out")
        elif one.after >= problem.final_time:
            here.refuse(f"not before final_time = {problem.final_time:g}", "after")


def one_figure(given: str | Mapping[str, Any], experiment: Experiment) -> str | FigureSettings:
    """The figure of an experiment that a word or a mapping names."""
    if isinstance(given, str) and given.partition("_")[0] in EXTENTS:
        key = next(iter(_swept(experiment.members)), "")
        advice = f'write {{"plot": "{given}", "against": "{key}"}}' if key else _NO_SWEEP
        raise ArgumentError("figure", f"{excerpt(given)!r} is a number of every run; {advice}")
    at = Cursor(node=node_of([given]), complaints=RaisingComplaints())
    try:
        figures: tuple[str | FigureSettings, ...] = FIGURES.build(FIGURES.read(at))
        check_figures(figures, experiment.problem, experiment.observations, experiment.members, at)
    except ArgumentError as error:
        # the argument is a single figure, so the path of the error must not name a list
        raise ArgumentError(".".join(("figure", *error.path[1:])), error.message) from None
    return figures[0]


_EVENTS = "; give events: {turn: {when: vx, direction: falling}}"
_QUANTITIES = "; give quantities: {drift: x2 - x1}"
_NEEDS = {
    "section": f"a section needs events{_EVENTS}",
    "quantities": f"there are no quantities{_QUANTITIES}",
    "hysteresis": "it needs the force of a damper; give quantities: {force: force_1}",
}
_MEMBERS = (
    "give sweep: [{problem.initial.position: 1.0}, {problem.initial.position: 1.01}, ...] or a "
    "range of a key"
)
_NO_SWEEP = "it is drawn against a swept key, and nothing is swept; it is in fvi.quantities(...)"
_OVER_TIME = "must be a swept key, such as problem.stiffness; write figures: [quantities] over time"
_SWEEP = "the experiment has no sweep; write sweep: {{{key}: {{from: ..., to: ..., number: ...}}}}"


def _swept(members: Sequence[Member]) -> list[str]:
    """The swept keys whose values are numbers."""
    values = members[0].values if members else {}
    numbers = [
        key
        for key in values
        if all(isinstance(member.values[key], int | float) for member in members)
    ]
    return [key for key in numbers if len({member.values[key] for member in members}) > 1]


def _check_plot(
    one: FigureSettings, quantities: Collection[str], events: Collection[str], at: Cursor
) -> None:
    which, quantity = one.extent
    plot, here = one.plot or "", at.under("plot")
    if plot in events:
        return
    if which and quantity in quantities:
        return
    if plot in quantities:
        here.refuse(f"write peak_{plot}; or {', '.join(f'{e}_{plot}' for e in EXTENTS[1:])}")
        return
    known = [*(f"peak_{name}" for name in quantities), *events]
    _check_word(plot, known, "peak_<quantity> or an event", here, _QUANTITIES)


def _check_word(
    word: str | None, known: Collection[str], what: str, at: Cursor, empty: str = ""
) -> None:
    """Refuse an unknown word; `empty` is the advice if no word is known."""
    if word in known:
        return
    near = suggestion(word or "", known)
    hint = f"{near} (here: {listed(list(known)[:12])})" if known else empty
    at.refuse(f"{excerpt(word or '')!r} is not {what}{hint}")
