"""Members of a sweep: one problem each, distinguished by the values of a few keys."""

from __future__ import annotations

import functools
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from fvi_cli.errors import RequestError
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.scenes.registry import build_problem

MOST_TOGETHER = ((16, 1024), (128, 32), (math.inf, 4))
"""Pairs (most degrees of freedom, most members that are computed together); twice as many problems,
with their square matrices, are kept in memory."""

BATCH_BYTES = 2**29
"""Memory that members which are computed together may take."""

DOUBLES_PER_STEP = 60
"""Numbers in memory per degree of freedom and step, by the method that needs most."""

MOST_VALUES = 6
"""Up to so many values of a swept key are listed one by one."""


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class Member:
    """One choice of values for the keys that an experiment sweeps over."""

    number: int  # place in the sweep, from 0
    values: Mapping[str, Any]
    """JSON values of this member by key path, such as ``problem.damping.0.order``."""
    template: str
    """The resolved ``problem`` mapping of any member, as JSON text: the source of all values that
    are not swept."""
    dimension: int = 1  # number of degrees of freedom, the same for all members
    name: str = ""
    """Name of a design; in labels it stands for the values of the keys `named`. It changes no
    number."""
    named: tuple[str, ...] = ()

    @property
    def specification(self) -> dict[str, Any]:
        """The resolved ``problem`` mapping of this member."""
        return with_values(json.loads(self.template), self.values)

    @property
    def problem(self) -> AnyProblem:
        """Scene and exact solution; built when they are needed."""
        return _BUILT[_most_together(self.dimension)](self)

    @property
    def label(self) -> str:
        """The name, and in words the values for which it does not stand; for messages."""
        return ", ".join(filter(None, (self.name, values_in_words(self.unnamed))))

    @property
    def unnamed(self) -> dict[str, Any]:
        """The values for which no name stands."""
        return {key: value for key, value in self.values.items() if key not in self.named}


def label_of(member: Member | None) -> str:
    """The name and the values of a member, empty where there is none."""
    return "" if member is None else member.label


@dataclass(frozen=True, kw_only=True, eq=False)
class OfMember:
    """A result on the scene of an experiment, or of one member."""

    name: str = ""
    """Name of the experiment."""
    of_member: Member | None = None
    """The member of a sweep, or design, to which the result belongs."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Labels of units for figures."""

    @property
    def member(self) -> str:
        """Swept values in words; empty without a sweep."""
        return label_of(self.of_member)


def _most_together(dimension: int) -> int:
    return next(count for size, count in MOST_TOGETHER if dimension <= size)


def _build(member: Member) -> AnyProblem:
    try:
        return build_problem(member.specification)
    except ValueError as error:
        # of many members only some are read beforehand
        raise RequestError(f"member {member.number} ({member.label}): {error}") from None


_BUILT: Mapping[int, Callable[[Member], AnyProblem]] = {
    count: functools.lru_cache(maxsize=2 * count)(_build) for _, count in MOST_TOGETHER
}


def members_at_a_time(n_steps: int, dimension: int) -> int:
    """How many members with `dimension` degrees of freedom are computed together."""
    each = 8 * DOUBLES_PER_STEP * n_steps * dimension
    return max(1, min(_most_together(dimension), BATCH_BYTES // each))


def values_in_words(values: Mapping[str, Any]) -> str:
    """``stiffness = 2, damping.0.order = 0.5``: all keys lie under ``problem``."""
    return ", ".join(
        f"{key.removeprefix('problem.')} = {value_in_words(value)}" for key, value in values.items()
    )


def value_in_words(value: object) -> str:
    """A swept value as text; lists and mappings as in YAML."""
    if isinstance(value, Mapping):
        inner = (f"{key}: {value_in_words(one)}" for key, one in value.items() if key != "digest")
        return "{" + ", ".join(inner) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(value_in_words, value)) + "]"
    if value is None or isinstance(value, bool):
        return {None: "-", True: "true", False: "false"}[value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def with_values(template: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A ``problem`` mapping with other values at some key paths that begin with ``problem.``.

    Lists are entered by their indices; a key with the value None is left out, and `template` stays
    as it is.

    Raises
    ------
    LookupError
        If a path leads into a plain value or behind the end of a list.
    """
    changed: Any = template
    for path, value in values.items():
        changed = replaced(changed, tuple(path.split(".")[1:]), value)
    return dict(changed)


def replaced(values: Any, path: tuple[str | int, ...], value: Any) -> Any:
    """A copy of JSON values with another value at a key path; None takes the key away.

    Missing mappings are made; what the path does not pass is shared with the original.

    Raises
    ------
    LookupError
        If the path leads into a plain value or behind the end of a list.
    """
    if not path:
        return value
    first, rest = path[0], path[1:]
    if isinstance(values, list | tuple):
        index = index_in(values, first)
        return [*values[:index], replaced(values[index], rest, value), *values[index + 1 :]]
    if not isinstance(values, Mapping | None):
        raise LookupError(f"{value_in_words(values)} stands there, which has no keys")
    if values is None and str(first).isdecimal():
        raise LookupError(f"{first} does not exist; there is no list")
    inner = dict(values or {})
    if value is None and not rest:
        inner.pop(first, None)
    else:
        inner[first] = replaced(inner.get(first), rest, value)
    return inner


def index_in(values: Sequence[Any], part: str | int) -> int:
    """The index in a list that a part of a key path names; lists are not counted from their end."""
    if str(part).isdecimal() and len(str(part)) <= 6 and int(part) < len(values):
        return int(part)
    there = f"has {len(values)} entries, numbered from 0" if values else "is empty"
    raise LookupError(f"{part} does not exist; the list there {there}")


def value_at(specification: Mapping[str, Any], path: str) -> Any:
    """The value at a key path that begins with ``problem.``."""
    node: Any = specification
    for part in path.split(".")[1:]:
        node = node[index_in(node, part)] if isinstance(node, list | tuple) else node[part]
    return node


def leads_somewhere(specification: Mapping[str, Any], path: str) -> bool:
    """Whether a value stands at a key path that begins with ``problem.``."""
    try:
        value_at(specification, path)
    except (LookupError, TypeError):
        return False
    return True


def counts_in_words(values: Iterable[str]) -> str:
    """``ok: 998; diverged: 2``, or the one word that all members have."""
    counts = Counter(values)
    if len(counts) == 1:
        return next(iter(counts))
    return "; ".join(f"{value}: {count}" for value, count in counts.most_common())


def swept_in_words(key: str, values: Sequence[object]) -> str:
    """The values of a key, one by one, or least and largest: ``stiffness = 1 ... 9 (17 values)``.

    Of lists and texts the first and the last.
    """
    texts = list(dict.fromkeys(map(value_in_words, values)))
    if len(texts) <= MOST_VALUES:
        return f"{key} = {', '.join(texts)}"
    numbers = [value for value in values if isinstance(value, int | float)]
    if len(numbers) == len(values):
        texts = list(dict.fromkeys(map(value_in_words, sorted(numbers))))
    return f"{key} = {texts[0]} ... {texts[-1]} ({len(texts)} values)"
