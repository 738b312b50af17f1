"""How curves of members and designs are distinguished: by names, or by the colours of numbers."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.panels import Curve
from fvi_cli.plotting.style import COLOURS, Look
from fvi_cli.reports.naming import key_label
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.members import Member, value_in_words

_MOST_NAMED = 6  # up to so many curves have names in the legend
_MOST_PANELS = 4
_MEAN = Look(colour=COLOURS[0], width=1.6)
_MEMBER = Look(colour="#8fb8d4", width=0.4)


@dataclass(frozen=True, kw_only=True)
class Distinction:
    """Names or numbers of members, and the keys in which they differ, with units."""

    keys: str
    names: Mapping[int, str]  # by number of the member; empty where colours distinguish
    numbers: Mapping[int, float]  # swept numbers; without a single one the numbers of the members
    is_swept: bool

    def of(self, member: Member | None) -> dict[str, Any]:
        """The label of a curve, or its number."""
        if member is None:
            return {}
        if self.names:
            return {"label": self.names[member.number]}
        return {"by": self.numbers[member.number]}

    @property
    def titles(self) -> dict[str, Any]:
        """The heading of a legend, or the name of a colour bar."""
        if self.names:
            return {"heading": self.keys}
        return {"bar": self.keys if self.is_swept else "member"}


def distinguish(
    members: Sequence[Member], units: Mapping[str, str], *, without: Collection[str] = ()
) -> Distinction:
    """How to distinguish members, apart from the values of some keys.

    Up to six have names; more have colours by their swept number or, where there is no single one,
    by the number of the member.
    """
    first = members[0]
    keys = [key for key in first.unnamed if key not in without]
    values = {one.number: [one.values[key] for key in keys] for one in members}
    names = {
        one.number: ", ".join(filter(None, [one.name, *map(value_in_words, values[one.number])]))
        for one in members
    }
    words = [key_label(key, units, first.specification, tuple(first.values)) for key in keys]
    words = ["design"] * bool(first.name) + words
    numbers = {k: float(own[0]) for k, own in values.items() if own and _is_number(own[0])}
    is_swept = len(words) == 1 and len(numbers) == len(members)
    if not is_swept:
        numbers = {one.number: one.number + 1.0 for one in members}
    few = len(set(names.values())) <= _MOST_NAMED
    return Distinction(
        keys=", ".join(words), names=names if few else {}, numbers=numbers, is_swept=is_swept
    )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def member_curves(
    found: Distinction, lines: Sequence[tuple[FinishedRun, Array, Array]]
) -> list[Curve]:
    """A curve for every member; where neither names nor colours tell them apart, their mean too."""
    if found.names or found.is_swept:
        return [Curve(x=x, y=y, **found.of(one.run.member)) for one, x, y in lines]
    curves = [Curve(x=x, y=y, label="members", look=_MEMBER) for _, x, y in lines]
    x = lines[0][1]
    if all(np.array_equal(own, x) for _, own, _ in lines):
        mean = np.mean([y for *_, y in lines], axis=0)
        curves.append(Curve(x=x, y=mean, label="mean", look=_MEAN))
    return curves


def titles_of(found: Distinction, count: int, members: Sequence[Member]) -> dict[str, Any]:
    """Titles of a figure of :func:`member_curves` with so many curves."""
    if found.names or found.is_swept:
        return found.titles
    shown = f"{count} of {len(members)}" if count < len(members) else str(count)
    return {"heading": f"{shown} members: {found.keys}"}


def split_members(
    finished: Sequence[FinishedRun], units: Mapping[str, str]
) -> tuple[str, dict[str, list[FinishedRun]]]:
    """The key with the fewest values of several swept ones, and the runs for each of these."""
    members = [one.run.member for one in finished if one.run.member is not None]
    keys = {
        key: dict.fromkeys(value_in_words(one.values[key]) for one in members)
        for key in members[0].unnamed
    }
    few = [key for key, values in keys.items() if 1 < len(values) <= _MOST_PANELS]
    if len(keys) < 2 or len(members) <= _MOST_NAMED or not few:
        return "", {"": list(finished)}
    key = min(few, key=lambda one: len(keys[one]))
    words = key_label(key, units, members[0].specification, tuple(keys))
    groups: dict[str, list[FinishedRun]] = {f"{words} = {value}": [] for value in keys[key]}
    for one in finished:
        if one.run.member is not None:
            value = value_in_words(one.run.member.values[key])
            groups[f"{words} = {value}"].append(one)
    return key, groups
