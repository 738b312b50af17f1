"""Columns that several tables have: to which experiment, member and run a row belongs."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

from fvi_cli.reports.table import Column, Value, Within
from fvi_cli.studies.members import Member, label_of, value_in_words

GOOD = ("ok", "floor")
"""Statuses of runs whose numbers are valid."""
CLOSE = Within(relative=1e-3, absolute=1e-12)
"""Tolerance for numbers that depend on the rounding of the machine, as for errors."""


class Item(SimpleNamespace):
    """The item of a row: attributes for the getters of its columns."""


def status_in_words(status: str) -> str:
    """The status of a run whose numbers are not valid; of another one nothing."""
    return "" if status in GOOD else status


def member_columns(members: Iterable[Member | None], path: str) -> tuple[Column, ...]:
    """A column ``design`` if members have names, and a column for every swept key.

    Lists and mappings are written as in YAML; `path` leads from the item of a row to its member.
    """
    found = [member for member in members if member is not None]
    keys = dict.fromkeys(key for member in found for key in member.values)
    member_of = attrgetter(path)

    def name(item: Any) -> str:
        return getattr(member_of(item), "name", "")

    def value(item: Any, key: str) -> Value:
        member = member_of(item)
        known = None if member is None else member.values.get(key)
        is_number = isinstance(known, int | float) and not isinstance(known, bool)
        return known if is_number or known is None else value_in_words(known)

    names = (Column("design", get=name),) if any(member.name for member in found) else ()
    return (*names, *(Column(key, get=partial(value, key=key)) for key in keys))


def member_title(path: str) -> Column:
    """The column for people with the name and the swept values of a member."""
    member_of = attrgetter(path)
    return Column("", "member", get=lambda item: label_of(member_of(item)))
