"""Members, numbers and keys as people read them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from fvi_cli.reports.table import Column, Value
from fvi_cli.studies.members import Member, swept_in_words, value_in_words


def number(value: float, form: str, missing: str = "-") -> str:
    """A number in a format; `missing` for nan."""
    return missing if math.isnan(value) else format(value, form)


def listing(numbers: Sequence[int]) -> str:
    """Numbers in a row; a long row by its ends."""
    if len(numbers) > 4:
        return f"{numbers[0]}, {numbers[1]}, ..., {numbers[-1]}"
    return ", ".join(map(str, numbers))


_KEYS: Mapping[str, str] = {
    "proportional.stiffness": "stiffness-proportional damping",
    "proportional.mass": "mass-proportional damping",
}


_SINGULAR = {"masses": "mass", "modulus": "modulus", "stiffnesses": "stiffness"}
_PARTS = {
    "relaxed": "relaxed modulus",
    "unrelaxed": "unrelaxed modulus",
    "moduli": "modulus",
    "times": "relaxation time",
    "time": "relaxation time",
}


def key_in_words(key: str) -> str:
    """``order of the damping`` for ``problem.damping.0.order``, as axes and legends say it."""
    key = key.removeprefix("problem.").removeprefix("parameters.")
    if key in _KEYS:
        return _KEYS[key]
    words = ""
    parts = key.replace("initial.", "initial ").split(".")
    for place, part in enumerate(parts, start=1):
        if part.isdigit():
            head, of, rest = words.partition(" of ")
            # the first of a list of mappings is mostly the only one
            is_first = part == "0" and place < len(parts)
            one = _SINGULAR.get(head) or head.removesuffix("s")
            words = one + ("" if is_first else f" {int(part) + 1}") + of + rest
            continue
        name = _PARTS.get(part, part.replace("_", " "))
        the = "" if words[-1:].isdigit() else "the "
        words = f"{name} of {the}{words}" if words else name
    return words


DESIGN = "design"
"""Column of the names."""


def member_columns(
    members: Iterable[Member | None], member_of: Callable[[Any], Member | None], title: str = ""
) -> tuple[Column, ...]:
    """``design`` where there are names, and a column for every swept key of some members.

    Numbers are numbers; lists and mappings are written as in YAML. `member_of` gives the member
    of what a row is about, and `title` is the heading of the names where people read.
    """
    found = [member for member in members if member is not None]
    keys = dict.fromkeys(key for member in found for key in member.values)

    def name(one: Any) -> str:
        member = member_of(one)
        return "" if member is None else member.name

    def value(one: Any, key: str) -> Value:
        member = member_of(one)
        return None if member is None else plain_value(member.values.get(key))

    names = [Column(DESIGN, "name of the design", title, get=name)]
    meaning = "swept value of the configuration"
    swept = (Column(key, meaning, get=partial(value, key=key)) for key in keys)
    return (*(names if any(member.name for member in found) else ()), *swept)


def members_in_words(members: Sequence[Member]) -> str:
    """``3 designs: bare, soft, stiff``, or the number of members and what is swept."""
    names = list(dict.fromkeys(member.name for member in members if member.name))
    keys = list(members[0].unnamed) if members else []
    swept = [swept_in_words(key, [one.values[key] for one in members]) for key in keys]
    if names:
        return "; ".join([f"{len(names)} designs: {', '.join(names)}", *swept])
    return f"{len(members)} members, {'; '.join(swept)}"


def plain_value(value: object) -> Value:
    """A swept value in a table: a number, or words."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    return None if value is None else value_in_words(value)
