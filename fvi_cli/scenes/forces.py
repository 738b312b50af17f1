"""Forces: their keys, and the values that these make."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, Final, TypeVar

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.errors import ArgumentError, excerpt, listed, suggestion
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.keys.mistakes import KeyPath, Wrong
from fvi_cli.scenes.keys.values import BY_FORM, Formula, FormulaOrMany, Keys, Positive, key
from fvi_cli.scenes.records.samples import Samples

T = TypeVar("T")
_NAME: Final = re.compile(r"(?<![\w.])[A-Za-z_]\w*")
PARTS: Final = 97
"""Parts of an interval at whose ends a formula must be finite; a prime number, so that no usual
grid has points there."""


class Piece(Keys):
    """A force during a part of the time."""

    until: Positive | None = key("Its last time; the last piece has none.", None, unit="time")
    value: FormulaOrMany = key("Expression in t, or a list of one per coordinate.")


class Pieces(Keys):
    """A force that may jump."""

    pieces: list[Piece] = key("Pieces in the order of time.", min_length=1)

    def mistakes(self) -> Iterator[Wrong]:
        """Ends that are missing, superfluous or do not increase."""
        before = 0.0
        for number, piece in enumerate(self.pieces):
            is_last, at = number == len(self.pieces) - 1, ("pieces", number, "until")
            if (piece.until is None) != is_last:
                yield Wrong(at, "every piece but the last has an end, and only these")
            elif piece.until is not None and piece.until <= before:
                yield Wrong(at, f"{piece.until:g} is not after {before:g}; ends must increase")
            before = piece.until or before


Component = Annotated[Formula | Samples, BY_FORM]


class ForcesAt(Keys):
    """Forces on some coordinates."""

    at: dict[str, Component] = key("Forces by names of coordinates; none on the others.")


Forces = Annotated[Formula | list[Component] | Pieces | ForcesAt | Samples, BY_FORM]
TimeFunction = Annotated[Formula | Pieces | Samples, BY_FORM]
Parameters = dict[str, float]

FORCING: Final = key(
    "Force f(t): number or expression in t, one per coordinate, {pieces: [...]}, {at: {x3: ...}} "
    "for some coordinates, or samples, {file: force.csv, column: f}.",
    "0",
    unit="mass length per time^2",
)
GROUND_ACCELERATION: Final = key(
    "Acceleration a(t) of the ground: number or expression in t, {pieces: [...]}, or samples, "
    "{file: quake.csv, column: a}.",
    "0",
    unit="length per time^2",
)
PARAMETERS: Final = key(
    "Values of names that the expressions of the problem may hold, and those of quantities, events "
    "and impacts; problem.parameters.<name> can be swept.",
    {},
)


def formulas_of(
    force: object, path: KeyPath, final_time: float
) -> Iterator[tuple[KeyPath, str, float, float]]:
    """The formulas of a force with their key paths, each with the interval on which it acts."""
    if isinstance(force, str):
        yield path, force, 0.0, final_time
    elif isinstance(force, list):
        for number, one in enumerate(force):
            yield from formulas_of(one, (*path, number), final_time)
    elif isinstance(force, ForcesAt):
        for name, one in force.at.items():
            yield from formulas_of(one, (*path, "at", name), final_time)
    elif isinstance(force, Pieces):
        begin = 0.0
        for number, piece in enumerate(force.pieces):
            end = final_time if piece.until is None else min(piece.until, final_time)
            where = (*path, "pieces", number, "value")
            for at, formula, *_ in formulas_of(piece.value, where, final_time):
                yield at, formula, min(begin, end), end
            begin = end


@functools.lru_cache(maxsize=1024)
def objection(
    text: str,
    parameters: tuple[tuple[str, float], ...],
    begin: float,
    end: float,
    *,
    is_force: bool,
) -> str:
    """What is wrong with an expression in t on an interval; empty if nothing is.

    A force must be finite inside and integrable at its beginning; a known solution or function
    must be finite at both ends too.
    """
    shares = np.arange(PARTS + 1) / PARTS
    times = begin + (end - begin) * (shares[1:-1] if is_force else shares)
    expression = _parsed(text, parameters)
    values = np.broadcast_to(np.asarray(expression.evaluate({"t": times})), times.shape)
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        what = "not a real number" if math.isnan(values[wrong[0]]) else "infinite"
        return f"is {what} at t = {times[wrong[0]]:.6g}; it must be finite up to final_time"
    if not is_force or np.isfinite(expression.evaluate({"t": np.array([begin])})).all():
        return ""
    # f(t) t falls towards the beginning where the integral is finite
    near = (end - begin) * np.array([1e-12, 1e-9])
    nearest, next_one = np.abs(expression.evaluate({"t": begin + near})) * near
    if not nearest > 0.995 * next_one:
        return ""
    return f"has an infinite integral at t = {begin:g}; powers of t above -1 are allowed"


def build_forcing(
    value: object,
    dimension: int,
    key: str = "forcing",
    *,
    final_time: float = math.inf,
    names: Sequence[str] = (),
    parameters: Mapping[str, float] | None = None,
) -> Forcing | None:
    """A force from the value under its key, whose formulas keep parameters; None when it is 0."""
    if value == "0":
        return None
    if isinstance(value, Pieces):
        places = [f"{key}.pieces.{index}.value" for index in range(len(value.pieces))]
        components: list[tuple[ForceComponent, ...]] = [
            expressions(piece.value, dimension, place, parameters)
            for piece, place in zip(value.pieces, places, strict=True)
        ]
        ends = [piece.until or math.inf for piece in value.pieces]
    else:

        def component(entry: object, place: str) -> tuple[ForceComponent, float]:
            """A component, and the time from which on it is 0."""
            if not isinstance(entry, Samples):
                return _expression(entry, place, parameters), math.inf
            try:
                return entry.component(final_time), entry.end(final_time)
            except ArgumentError as error:
                raise error.below(place) from None

        if isinstance(value, ForcesAt):
            given = by_coordinate(value.at, names, f"{key}.at")
            found = tuple(component(given.get(one, "0"), f"{key}.at.{one}") for one in names)
        else:
            found = _per_coordinate(value, dimension, key, component)
        zero, ends = _expression("0", key), sorted({math.inf, *(end for _, end in found)})
        components = [tuple(one if end >= until else zero for one, end in found) for until in ends]
    pieces = zip(components, ends, strict=True)
    return Forcing(pieces=tuple(ForcingPiece(components=one, until=end) for one, end in pieces))


def by_coordinate(given: Mapping[str, T], names: Sequence[str], place: str) -> Mapping[str, T]:
    """Values by coordinate; refuses names that are not coordinates."""
    for name in given:
        if name not in names:
            known = listed(names[:6]) + ", ..." * (len(names) > 6)
            message = (
                f"{excerpt(name)!r} is not a coordinate{suggestion(name, names)} "
                f"(coordinates: {known})"
            )
            raise ArgumentError(f"{place}.{name}", message, at_key=True)
    return given


def expressions(
    value: object, dimension: int, place: str, parameters: Mapping[str, float] | None = None
) -> tuple[Expression, ...]:
    """Expressions in t, one for every coordinate, from a single one or from a list."""
    read = functools.partial(_expression, parameters=parameters)
    return _per_coordinate(value, dimension, place, read)


def _per_coordinate(
    value: object, dimension: int, place: str, read: Callable[[object, str], T]
) -> tuple[T, ...]:
    if not isinstance(value, list | tuple):
        return (read(value, place),) * dimension
    if len(value) != dimension:
        raise ArgumentError(place, f"{len(value)} entries for {dimension} degrees of freedom")
    return tuple(read(entry, f"{place}.{index}") for index, entry in enumerate(value))


def _expression(
    value: object, place: str, parameters: Mapping[str, float] | None = None
) -> Expression:
    try:
        text, known = str(value), parameters or {}
        named = sorted(known.keys() & set(_NAME.findall(text))) if known else []
        return _parsed(text, tuple((name, known[name]) for name in named))
    except ValueError as error:
        raise ArgumentError(place, str(error)) from None


@functools.lru_cache(maxsize=1024)
def _parsed(text: str, parameters: tuple[tuple[str, float], ...]) -> Expression:
    # cached, since thousands of members of a sweep have the same force
    return Expression.parse(text, variables=("t",), constants=dict(parameters))
