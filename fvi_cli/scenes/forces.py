"""Forces: their keys, and the values that these make."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, TypeVar

from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.errors import ArgumentError, excerpt, listed, suggestion
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.keys.mistakes import KeyPath
from fvi_cli.scenes.keys.values import (
    BY_FORM,
    Formula,
    FormulaOrMany,
    Keys,
    Positive,
    key,
    names_in,
)
from fvi_cli.scenes.records.samples import Samples

T = TypeVar("T")


class Piece(Keys):
    """A force during a part of the time."""

    until: Positive | None = key("Its last time; the last piece has none.", None, unit="time")
    value: FormulaOrMany = key("Expression in t, or a list of one per coordinate.")


class Pieces(Keys):
    """A force that may jump."""

    pieces: list[Piece] = key("Pieces in the order of time.", min_length=1)


Component = Annotated[Formula | Samples, BY_FORM]


class ForcesAt(Keys):
    """Forces on some coordinates."""

    at: dict[str, Component] = key("Forces by names of coordinates; none on the others.")


Forces = Annotated[Formula | list[Component] | Pieces | ForcesAt | Samples, BY_FORM]
TimeFunction = Annotated[Formula | Pieces | Samples, BY_FORM]
GROUND_ACCELERATION: Final = key(
    "Acceleration a(t) of the ground: number or expression in t, {pieces: [...]}, or samples, "
    "{file: quake.csv, column: a}.",
    "0",
    unit="length per time^2",
)


def formulas_of(value: object, path: KeyPath) -> Iterator[tuple[KeyPath, str]]:
    """The formulas in what stands at a key path, each with its own."""
    parts: Any = ()
    if isinstance(value, str):
        yield path, value
    elif isinstance(value, list):
        parts = enumerate(value)
    elif isinstance(value, dict):
        parts = value.items()
    elif isinstance(value, Pieces | Piece | ForcesAt):
        parts = value
    for name, one in parts:
        yield from formulas_of(one, (*path, name))


def build_forcing(
    value: object,
    names: Sequence[str],
    key: str,
    final_time: float,
    parameters: Mapping[str, float],
) -> Forcing | None:
    """A force on coordinates, whose formulas keep parameters; None when it is 0.

    Raises
    ------
    ArgumentError
        For sizes and names that do not fit, and samples that do not reach over [0, T].
    """
    if value == "0":
        return None

    def component(entry: object, place: str) -> tuple[ForceComponent, float]:
        """A component, and the time from which on it is 0."""
        if isinstance(entry, Samples):
            return entry.component, entry.end(final_time)
        return _expression(entry, place, parameters), math.inf

    if isinstance(value, Pieces):
        ends = [piece.until or math.inf for piece in value.pieces]
        components: list[tuple[ForceComponent, ...]] = [
            expressions(piece.value, names, f"{key}.pieces.{number}.value", parameters)
            for number, piece in enumerate(value.pieces)
        ]
    else:
        found = for_each(value, names, key, component)
        zero, ends = _expression("0", key, {}), sorted({math.inf, *(end for _, end in found)})
        components = [tuple(one if end >= until else zero for one, end in found) for until in ends]
    pieces = zip(components, ends, strict=True)
    try:
        force = Forcing(
            pieces=tuple(ForcingPiece(components=one, until=end) for one, end in pieces)
        )
    except ArgumentError as error:
        raise error.below(key) from None
    if words := force.objection(final_time):
        raise ArgumentError(key, words)
    return force


def expressions(
    value: object, names: Sequence[str], place: str, parameters: Mapping[str, float]
) -> tuple[Expression, ...]:
    """Expressions in t, one for every coordinate."""
    return for_each(value, names, place, functools.partial(_expression, parameters=parameters))


def for_each(
    value: Any, names: Sequence[str], place: str, read: Callable[[Any, str], T]
) -> tuple[T, ...]:
    """What a key says of every coordinate: one value for all, a list, or values `at` some."""
    if (some := getattr(value, "at", None)) is not None:
        for name in some.keys() - {*names}:
            known = listed(names[:6]) + ", ..." * (len(names) > 6)
            words = f"{excerpt(name)!r} is not a coordinate{suggestion(name, names)}"
            words += f" (coordinates: {known})"
            raise ArgumentError(f"{place}.at.{name}", words, at_key=True)
        return tuple(read(some.get(name, 0), f"{place}.at.{name}") for name in names)
    if not isinstance(value, list):
        return (read(value, place),) * len(names)
    if len(value) != len(names):
        raise ArgumentError(place, f"{len(value)} entries for {len(names)} degrees of freedom")
    return tuple(read(entry, f"{place}.{index}") for index, entry in enumerate(value))


def _expression(value: object, place: str, parameters: Mapping[str, float]) -> Expression:
    try:
        named = sorted(parameters.keys() & names_in(str(value)))
        return _parsed(str(value), tuple((name, parameters[name]) for name in named))
    except ValueError as error:
        raise ArgumentError(place, str(error)) from None


@functools.lru_cache(maxsize=1024)
def _parsed(text: str, parameters: tuple[tuple[str, float], ...]) -> Expression:
    # cached, since thousands of members of a sweep have the same force
    return Expression.parse(text, variables=("t",), constants=dict(parameters))
