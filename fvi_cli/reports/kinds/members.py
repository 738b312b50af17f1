"""What tells members apart in tables: names of designs, and the values of swept keys."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from fvi_cli.reports.table import Column, Value
from fvi_cli.studies.members import Member, swept_in_words, value_in_words

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
    names = [Column(DESIGN, "name of the design", title, get=lambda one: _name(member_of(one)))]
    columns = names if any(member.name for member in found) else []
    return (*columns, *(_swept_column(key, member_of) for key in keys))


def _name(member: Member | None) -> str:
    return "" if member is None else member.name


def _swept_column(key: str, member_of: Callable[[Any], Member | None]) -> Column:
    def value(one: Any) -> Value:
        member = member_of(one)
        return None if member is None else plain_value(member.values.get(key))

    return Column(key, "swept value of the configuration", get=value)


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
