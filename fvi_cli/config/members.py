"""Members: the plain mapping of a problem with some key paths replaced, read like the file."""

from __future__ import annotations

import itertools
import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from pydantic import ValidationError

from fvi_cli.config.models import MemberKeys
from fvi_cli.config.text.mistakes import Report
from fvi_cli.errors import ArgumentError, excerpt
from fvi_cli.scenes.keys.mistakes import mistakes_of
from fvi_cli.scenes.keys.values import KeyPath, Range, Wrong, plain
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.scenes.registry import OnlyProblem
from fvi_cli.studies.members import (
    Member,
    leads_somewhere,
    value_at,
    values_in_words,
    with_values,
)

MOST_TOLD: Final = 10
"""Most members whose mistakes are told; other members are likely to have the same mistakes."""
MANY: Final = 5000
"""From so many members on the check takes long and is announced."""

_logger = logging.getLogger(__name__)
Check = Callable[[AnyProblem], Iterable[Wrong]]


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What one member changes."""

    name: str = ""  # of its design
    changes: Mapping[str, Any]  # key paths to values; None takes the key away
    places: Mapping[str, KeyPath]  # where each of them stands in the experiment

    @property
    def label(self) -> str:
        """The name, and the values in words."""
        return self.name or values_in_words(self.changes)

    @property
    def key_place(self) -> KeyPath:
        """Where the key of the last change stands."""
        place = list(self.places.values())[-1]
        return place if isinstance(place[-1], str) else place[:-1]


def choices(keys: MemberKeys) -> Iterator[Choice]:
    """All members: every design with every combination of swept values."""
    for name, changes in (keys.designs or {"": {}}).items():
        own = changes or {}
        places: dict[str, KeyPath] = {path: ("designs", name, path) for path in own}
        for swept, where in _swept(keys):
            yield Choice(name=name, changes={**own, **swept}, places={**places, **where})


def _swept(keys: MemberKeys) -> Iterator[tuple[Mapping[str, Any], Mapping[str, KeyPath]]]:
    """The values of every combination, with their places."""
    if isinstance(keys.sweep, list):
        for number, row in enumerate(keys.sweep):
            yield row, {path: ("sweep", number, path) for path in row}
        return
    entries: list[list[tuple[Any, KeyPath]]] = []
    for path, given in keys.swept.items():
        if isinstance(given, Range):
            entries.append([(value, ("sweep", path)) for value in given.values()])
        else:
            entries.append([(value, ("sweep", path, n)) for n, value in enumerate(given)])
    for combination in itertools.product(*entries):
        chosen = dict(zip(keys.swept, combination, strict=True))
        yield {p: one[0] for p, one in chosen.items()}, {p: one[1] for p, one in chosen.items()}


def with_first(values: dict[str, Any], keys: MemberKeys, report: Report) -> dict[str, Any]:
    """The experiment with the values of its first member, as far as they fit."""
    first = next(choices(keys))
    try:
        problem = with_values(values.get("problem") or {}, first.changes)
    except LookupError as error:
        report.add(str(error), *first.key_place, of_key=True)
        return values
    place_changes(first, report)
    return {**values, "problem": problem}


def place_changes(choice: Choice, report: Report) -> None:
    """Give the values that a member changes the places at which they are written."""
    for path, where in choice.places.items():
        parts = tuple(int(part) if part.isdecimal() else part for part in path.split("."))
        report.document.move((*report.prefix, *parts), (*report.prefix, *where))


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How members are read and checked."""

    keys: MemberKeys
    values: Mapping[str, Any]  # the plain mapping of the problem
    template: Mapping[str, Any]  # the resolved mapping of the first member
    first: AnyProblem
    context: Mapping[str, Any]  # of validations
    check: Check  # what is wrong with the problem of a member
    remark: Callable[[Kind, Choice], None]  # what is remarked on
    is_built: bool = True  # False: they were built and checked before


def make_members(reading: Reading, report: Report) -> tuple[Member, ...]:
    """The members of an experiment, with the mistakes of those that are wrong."""
    keys, template = reading.keys, dict(reading.template)
    text, members, told = json.dumps(template), [], 0
    paths = [*keys.changed, *(keys.sweep[0] if isinstance(keys.sweep, list) else keys.swept)]
    if keys.number >= MANY and reading.is_built:
        _logger.info("checking %d members of a sweep", keys.number)
    for number, choice in enumerate(choices(keys)):
        found = _read(choice, reading)
        wrong = found
        if isinstance(found, Kind):
            resolved = plain(found)
            values = {
                path: value_at(resolved, path) if leads_somewhere(resolved, path) else None
                for path in paths
            }
            wrong = list(_built(found, reading)) if reading.is_built else []
            wrong = wrong or list(_others_changed(values, resolved, choice, reading))
            reading.remark(found, choice)
            members.append(
                Member(
                    number=number,
                    values=values,
                    template=text,
                    dimension=reading.first.dimension,
                    name=choice.name,
                    named=keys.changed,
                )
            )
        if isinstance(wrong, list) and wrong:
            place_changes(choice, report)
            report.extend(wrong, f" (member {number}: {excerpt(choice.label, 200)})")
            told += 1
        if told == MOST_TOLD:
            words = f"only the first {MOST_TOLD} are told; fix these and run again"
            report.add(words, "sweep" if keys.sweep is not None else "designs")
            break
    report.extend(_repeated(members))
    return tuple(members)


def _others_changed(
    values: Mapping[str, Any], resolved: Mapping[str, Any], choice: Choice, reading: Reading
) -> Iterator[Wrong]:
    """Values of a member that do not tell it from the first one."""
    place: KeyPath = ("designs", choice.name) if choice.name else ("sweep",)
    try:
        if with_values(reading.template, values) != resolved:
            words = "changes entries next to it too; write what holds them as a whole"
            yield Wrong(place, f"{', '.join(values)} {words}")
    except LookupError as error:
        words = "write all entries in every design"
        yield Wrong(place, f"{', '.join(values)}: {error}; {words}", of_key=True)


def _read(choice: Choice, reading: Reading) -> Kind | list[Wrong]:
    """The keys of a member's problem, or what is wrong with them."""
    values: dict[str, Any] = {}
    try:
        values = {"problem": with_values(reading.values, choice.changes)}
        return OnlyProblem.model_validate(values, context=reading.context).problem
    except LookupError as error:
        return [Wrong(choice.key_place, str(error), of_key=True)]
    except ValidationError as error:
        return list(mistakes_of(error, values, OnlyProblem))


def _built(kind: Kind, reading: Reading) -> Iterator[Wrong]:
    """What is wrong with the problem of a member."""
    try:
        problem = kind.build_problem()
    except ArgumentError as error:
        inner = (int(part) if part.isdecimal() else part for part in error.path)
        yield Wrong(("problem", *inner), error.message, of_key=error.at_key)
    except ValueError as error:
        yield Wrong(("problem",), str(error))
    else:
        if problem.dimension != reading.first.dimension:
            words = f"has {problem.dimension} degrees of freedom, the first member "
            words += f"{reading.first.dimension}; members must have the same number"
            yield Wrong(("problem",), words)
        else:
            yield from reading.check(problem)


def _repeated(members: Iterable[Member]) -> Iterator[Wrong]:
    """Designs that are the same as another one."""
    known: dict[str, str] = {}
    for one in members:
        if one.name and known.setdefault(json.dumps(one.values), one.name) != one.name:
            other = known[json.dumps(one.values)]
            words = f"is the same as the design {excerpt(other)!r}"
            yield Wrong(("designs", one.name), words, of_key=True)


def resolved_members(keys: MemberKeys, members: tuple[Member, ...]) -> dict[str, Any]:
    """The mappings under ``designs`` and ``sweep`` with the values as they were read."""
    found: dict[str, Any] = {}
    if keys.designs is not None:
        found["designs"] = {
            one.name: {path: one.values[path] for path in keys.changed} for one in members
        }
    if isinstance(keys.sweep, list):
        found["sweep"] = [one.unnamed for one in members[: len(keys.sweep)]]
    elif keys.sweep is not None:
        after = len(members) // len(keys.designs or (0,))
        found["sweep"] = {}
        for path, given in keys.sweep.items():
            count = given.number if isinstance(given, Range) else len(given)
            after //= count
            found["sweep"][path] = [members[n * after].values[path] for n in range(count)]
    return found
