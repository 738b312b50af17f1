"""Members: the plain mapping of a problem with some key paths replaced, read like the file."""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from fvi_cli.config.models import MemberKeys
from fvi_cli.config.text.mistakes import Report
from fvi_cli.effects.matrices import is_semidefinite
from fvi_cli.errors import excerpt
from fvi_cli.scenes.keys.mistakes import KeyPath, Wrong, mistakes_of
from fvi_cli.scenes.keys.values import Range, plain
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.records.matrices import MatrixFile
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
MOST_READ: Final = 1000
"""Of more members that differ in numbers alone so many at equal distances are read and built."""
FORCE_LISTS: Final = ("damping", "dampers", "joints", "internal_damping", "law")
"""Keys of damping forces."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What one member changes."""

    name: str = ""  # of its design
    # key paths to values, of which None takes the key away, and where these stand in the experiment
    changes: Mapping[str, Any] = field(default_factory=dict)
    places: Mapping[str, KeyPath] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The name, and the values in words."""
        return self.name or values_in_words(self.changes)

    def placed(self, wrong: Wrong) -> Wrong:
        """A mistake in a value that the member changes, at the place where that is written."""
        for path, where in self.places.items():
            parts = _parts(path)
            if wrong.path[: len(parts)] == parts:
                is_key = wrong.of_key and wrong.path == parts
                begin = where[:-1] if is_key and isinstance(where[-1], int) else where
                return wrong._replace(path=(*begin, *wrong.path[len(parts) :]))
        return wrong

    def lost(self, error: LookupError) -> Wrong:
        """A change that leads nowhere."""
        return self.placed(Wrong(_parts(list(self.places)[-1]), str(error), of_key=True))


def _parts(path: str) -> KeyPath:
    return tuple(int(part) if part.isdecimal() else part for part in path.split("."))


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


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How members are read and checked."""

    keys: MemberKeys
    values: Mapping[str, Any]  # the plain mapping of the problem
    template: Mapping[str, Any]  # the resolved mapping of the first member
    dimension: int
    context: Mapping[str, Any]  # of validations
    check: Callable[[Kind], Iterator[Wrong]]  # what is wrong with the problem of a member


def make_members(reading: Reading, report: Report, *, is_remarked: bool) -> tuple[Member, ...]:
    """The members of an experiment, with the mistakes of those that are wrong."""
    keys, text = reading.keys, json.dumps(dict(reading.template))
    members, told, chosen = list[Member](), 0, _chosen(reading)
    for number, choice in enumerate(choices(keys)):
        values: Mapping[str, Any] = choice.changes
        if number in chosen:
            values, kind, wrong = _read(choice, reading)
            if kind is not None and not is_remarked:
                is_remarked = remark_on_factors(kind, choice, report)
            if wrong:
                words = f" (member {number}: {excerpt(choice.label, 200)})"
                report.extend(map(choice.placed, wrong), words)
                told += 1
            if told == MOST_TOLD:
                words = f"only the first {MOST_TOLD} are told; fix these and run again"
                report.add(words, "sweep" if keys.sweep is not None else "designs")
                break
        members.append(
            Member(
                number=number,
                values=values,
                template=text,
                dimension=reading.dimension,
                name=choice.name,
                named=keys.changed,
            )
        )
    return tuple(members)


def _chosen(reading: Reading) -> Container[int]:
    """The numbers of the members that are read: all, or some with the extremes of every key."""
    count, rows = reading.keys.number, list(choices(reading.keys))
    paths = rows[0].changes
    is_alike = not reading.keys.designs and all(
        type(one) is float for row in rows for one in row.changes.values()
    )
    leaves = [value_at(reading.template, path) for path in paths] if is_alike else []
    if count <= MOST_READ or not is_alike or not all(type(one) is float for one in leaves):
        return range(count)
    chosen = {round(one) for one in np.linspace(0, count - 1, MOST_READ).tolist()}
    for path in paths:
        values = [row.changes[path] for row in rows]
        chosen |= {values.index(min(values)), values.index(max(values))}
    return chosen


def _read(choice: Choice, reading: Reading) -> tuple[Mapping[str, Any], Kind | None, list[Wrong]]:
    """The resolved values of a member, its keys, and what is wrong with it."""
    values: dict[str, Any] = {}
    try:
        values = {"problem": with_values(reading.values, choice.changes)}
        kind = OnlyProblem.model_validate(values, context=reading.context).problem
    except LookupError as error:
        return {}, None, [choice.lost(error)]
    except ValidationError as error:
        return {}, None, list(mistakes_of(error))
    resolved, keys = plain(kind), reading.keys
    found = {
        path: value_at(resolved, path) if leads_somewhere(resolved, path) else None
        for path in (
            *keys.changed,
            *(keys.sweep[0] if isinstance(keys.sweep, list) else keys.swept),
        )
    }
    wrong = list(reading.check(kind))
    is_described = False
    with contextlib.suppress(LookupError):
        is_described = with_values(reading.template, found) == resolved
    if not wrong and not is_described:
        place: KeyPath = ("designs", choice.name) if choice.name else ("sweep",)
        words = "change entries next to them too; write what holds them as a whole in all members"
        wrong = [Wrong(place, f"{', '.join(found)}: they {words}")]
    return found, kind, wrong


def remark_on_factors(kind: Kind, choice: Choice, report: Report) -> bool:
    """Remark on negative damping factors, since a sign is easily wrong; whether there are any."""
    found = [choice.placed(one) for one in _negative_factors(kind)]
    for one in found:
        words = f"{one.message}: such damping drives the motion, which grows"
        _logger.warning("%s", report.placed(one._replace(message=words)))
    return bool(found)


def _negative_factors(kind: Kind) -> Iterator[Wrong]:
    """Damping factors that feed energy into some direction."""
    for name in FORCE_LISTS:
        given = vars(kind).get(name, [])
        for index, term in enumerate(given if isinstance(given, list) else [given]):
            inner = (name, index) if isinstance(given, list) else (name,)
            place: KeyPath = ("problem", *inner)
            for key in ("coefficient", "matrix"):
                factor = vars(term).get(key)
                if isinstance(factor, float):
                    if factor < 0:
                        yield Wrong((*place, key), f"{factor:g} is negative")
                elif factor is not None:
                    form = factor.value if isinstance(factor, MatrixFile) else np.array(factor)
                    if not is_semidefinite(form):
                        yield Wrong((*place, key), "the matrix has a negative eigenvalue")


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
