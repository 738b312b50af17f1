"""Forces: their keys, and the values that these make."""

from __future__ import annotations

import functools
import logging
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, TypeVar

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.effects.sampled import Interpolation, SampledForce
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.keys.containers import ByForm, ListOf, Named
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import FormulaText, Number, Schema, Text
from fvi_cli.keys.settings import PlainSetting, Positive, key, record_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.records.csv_samples import (
    NO_TEXT,
    SPREADSHEETS,
    SUFFIX,
    read_at2_samples,
    read_csv_samples,
)
from fvi_cli.scenes.records.data_files import (
    end_of_samples,
    file_under,
    no_such_file,
    sampled_component,
    with_digest,
)
from fvi_cli.scenes.records.inputs import DIGEST, Digest, is_kept

_logger = logging.getLogger(__name__)
T = TypeVar("T")
STANDARD_GRAVITY: Final = 9.80665
"""Acceleration of free fall, in m/s^2 (CGPM 1901)."""
_COLUMN: Final = Text(what="the name of a column")


def _read_file(values: Mapping[str, Any], at: Cursor) -> Any:
    """The keys of samples with the digest of times and values in the file."""
    if is_kept(values.get("digest")):
        return values
    file, name = file_under(values["file"], at)
    is_at2 = file.suffix.lower() == SUFFIX
    columns = () if is_at2 else (values["time"], values.get("column", ""))

    def read() -> Array:
        found = read_at2_samples(file, name) if is_at2 else read_csv_samples(file, name, *columns)
        return np.column_stack([found.time, found.values])

    if file.suffix.lower() in SPREADSHEETS:
        return at.refuse(f"{name}: {NO_TEXT}", "file")
    if is_at2 == ("column" in values):
        if not is_at2 and not file.exists():
            return at.refuse(no_such_file(file, name), "file")
        wrong = (
            "missing; it must be the name of a column (records in AT2 need none: their names end "
            "in .at2)"
        )
        return at.refuse("not for AT2, which has one column" if is_at2 else wrong, "column")
    return with_digest(values, at, ("samples", file, *columns), read)


@dataclass(frozen=True, kw_only=True)
class Scale(Number):
    """A factor, or the letter g for the acceleration of free fall."""

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"a finite number, or g for {STANDARD_GRAVITY} m/s^2"

    def read(self, at: Cursor) -> Any:
        """A float."""
        return STANDARD_GRAVITY if at.scalar == "g" else super().read(at)

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [super().schema(defs), {"const": "g"}]}


class Samples(
    PlainSetting,
    expected="samples such as {file: quake.csv, column: a, time: t, interpolation: linear}",
    refused=dict.fromkeys(
        ("unit", "units"), "not a key: write scale: g for a record in g, in metres and seconds"
    ),
):
    """Samples from a file that is read together with the configuration."""

    file: Annotated[str, Text(what="the path of a CSV file, from the configuration's folder")] = (
        key(
            "CSV file with names of columns in its first line, or a record of ground motion in "
            "AT2 (PEER), in units of g; a relative path begins at the configuration."
        )
    )
    column: Annotated[str | None, _COLUMN] = key(
        "Column of the values, in their unit divided by scale; AT2 has none.", default=None
    )
    time: Annotated[str, _COLUMN] = key(
        "Column of the times, which increase from 0 or before to final_time or later.", default="t"
    )
    interpolation: Interpolation = key(
        "Between the samples: straight lines (order 2 at most) or a cubic spline (4).",
        default="linear",
    )
    scale: Annotated[float, Scale()] = key(
        "Factor of the values; g: 9.80665, for a record in g and motion in metres and seconds.",
        default=1.0,
    )
    beyond: Literal["refuse", "zero"] = key(
        "zero: the force is zero after the last sample, where that comes before final_time.",
        default="refuse",
    )
    digest: Digest = DIGEST

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The keys with the digest of times and values in the file."""
        return _read_file(values, at)


SAMPLES: Final = record_of(Samples)

Parameters = Annotated[
    Mapping[str, float] | None, Named(shape=Number(), example="{amplitude: 0.3, omega: 1.2}")
]
PARAMETERS: Final = key(
    "Values of names that the expressions of the problem may hold, and those of quantities, events "
    "and impacts; problem.parameters.<name> can be swept.",
    default=None,
)
_EXPRESSIONS: Final = ("forcing", "ground_acceleration", "exact", "function", "displacement")
_NAME: Final = re.compile(r"(?<![\w.])[A-Za-z_]\w*")


def with_parameters(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """The values of a problem with numbers in place of parameters in expressions of t."""
    numbers = values.get("parameters")
    if not isinstance(numbers, Mapping) or not numbers:
        return values

    def bound(value: Any) -> Any:
        if isinstance(value, str):
            return _NAME.sub(
                lambda name: f"({numbers[name[0]]!r})" if name[0] in numbers else name[0], value
            )
        if isinstance(value, Mapping):
            return value if "file" in value else {key: bound(one) for key, one in value.items()}
        return [bound(one) for one in value] if isinstance(value, list | tuple) else value

    return {key: bound(one) if key in _EXPRESSIONS else one for key, one in values.items()}


PIECES_EXAMPLE: Final = "{pieces: [{until: 1.0, value: 8}, {value: 0}]}"
_FORCE: Final = FormulaText()
_UNTIL: Final = key("Last time of the piece; the last piece has none.", unit="time", default=None)
_VALUE: Final = ByForm(single=_FORCE, several=ListOf(shape=_FORCE, example="[sin(t), 0]"))


class ForcePiece(PlainSetting):
    """A force in one time interval."""

    until: Positive | None = _UNTIL
    value_: Annotated[Any, _VALUE] = key(
        "Force in this piece: number or expression in t, or one per coordinate."
    )


class GroundPiece(PlainSetting):
    """An acceleration in one time interval."""

    until: Positive | None = _UNTIL
    value_: Annotated[str, FormulaText()] = key(
        "Acceleration in this piece: number or expression in t."
    )


_PIECES: Final = key("Pieces in the order of time; jumps are allowed between them.")


def _list_of(piece: type[PlainSetting]) -> ListOf:
    return ListOf(shape=record_of(piece), example="[{until: 1, value: 8}, {value: 0}]")


class ForcePieces(PlainSetting):
    """A force that jumps."""

    pieces: Annotated[Any, _list_of(ForcePiece)] = _PIECES


class GroundPieces(PlainSetting):
    """An acceleration that jumps."""

    pieces: Annotated[Any, _list_of(GroundPiece)] = _PIECES


_COMPONENT: Final = ByForm(single=_FORCE, mappings=(SAMPLES,))


class ForcesAt(PlainSetting):
    """Forces on some coordinates."""

    at: Annotated[
        Mapping[str, Any],
        Named(shape=_COMPONENT, names="coordinates", example="{x3: sin(t)}"),
    ] = key("Forces on some coordinates, by their names; none on the others.")


_FORCES: Final = ByForm(
    single=_FORCE,
    several=ListOf(shape=_COMPONENT, example="[sin(t), {file: quake.csv, column: a}]"),
    mappings=(record_of(ForcePieces), record_of(ForcesAt), SAMPLES),
    example=f"{PIECES_EXAMPLE}, where the value may be a list",
    name="Force",
)
_GROUND: Final = ByForm(
    single=FormulaText(),
    mappings=(record_of(GroundPieces), SAMPLES),
    example=PIECES_EXAMPLE,
    name="GroundMotion",
)
Forces = Annotated[Any, _FORCES]
GroundMotion = Annotated[Any, _GROUND]
FORCING: Final = key(
    "Force f(t): number or expression in t, one per coordinate, {pieces: [...]}, {at: {x3: ...}} "
    "for some coordinates, or samples, {file: force.csv, column: f}.",
    default="0",
)
GROUND_ACCELERATION: Final = key(
    "Acceleration a(t) of the ground: number or expression in t, {pieces: [...]}, or samples, "
    "{file: quake.csv, column: a}.",
    unit="length per time^2",
    default="0",
)


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
    if isinstance(value, str) and value == "0":
        return None
    pieces = []
    if isinstance(value, Mapping) and "pieces" in value:
        for index, piece in enumerate(value["pieces"]):
            place = f"{key}.pieces.{index}.value"
            components = expressions(piece["value"], dimension, place, parameters)
            until = float(piece.get("until", math.inf))
            pieces.append(ForcingPiece(components=components, until=until))
        return Forcing(pieces=tuple(pieces))

    def component(entry: object, place: str) -> tuple[ForceComponent, float]:
        """A component, and the time from which on it is 0."""
        if not isinstance(entry, Mapping):
            return _expression(entry, place, parameters), math.inf
        try:
            return sampled_component(entry, final_time), end_of_samples(entry, final_time)
        except ValueError as error:
            raise ArgumentError(place, str(error)) from None

    zero = _expression("0", key)
    if isinstance(value, Mapping) and "at" in value:
        given = by_coordinate(value["at"], names, f"{key}.at")
        found: tuple[tuple[ForceComponent, float], ...] = tuple(
            component(given.get(name, "0"), f"{key}.at.{name}") for name in names
        )
    else:
        found = _per_coordinate(value, dimension, key, component)
    if all(_is_zero(one) for one, _ in found):
        return None
    for until in sorted({math.inf, *(end for _, end in found)}):
        left = tuple(one if end >= until else zero for one, end in found)
        pieces.append(ForcingPiece(components=left, until=until))
    return Forcing(pieces=tuple(pieces))


def by_coordinate(given: Mapping[str, T], names: Sequence[str], place: str) -> Mapping[str, T]:
    """Values by coordinate; refuses names that are not coordinates."""
    for name in given:
        if name not in names:
            known = listed(names[:6]) + ", ..." * (len(names) > 6)
            raise ArgumentError(
                place,
                f"{excerpt(name)!r} is not a coordinate{suggestion(name, names)} "
                f"(coordinates: {known})",
            )
    return given


def _is_zero(component: ForceComponent) -> bool:
    if isinstance(component, SampledForce):
        return component.formula is None and not component.coefficients.any()
    return component.is_constant and component.evaluate({}) == 0


def expressions(
    value: object, dimension: int, place: str, parameters: Mapping[str, float] | None = None
) -> tuple[Expression, ...]:
    """Expressions in t, one for every coordinate, from a single one or from a list."""
    return _per_coordinate(
        value, dimension, place, functools.partial(_expression, parameters=parameters)
    )


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
        if isinstance(value, float | int) and not isinstance(value, bool):
            return Expression.of_number(value, variables=("t",))
        text = str(value)
        known = parameters or {}
        return _parsed(text, tuple((name, known[name]) for name in _named(text, known)))
    except ValueError as error:
        raise ArgumentError(place, str(error)) from None


def _named(text: str, parameters: Mapping[str, float]) -> list[str]:
    """Parameters that occur in a text."""
    return sorted(parameters.keys() & set(_NAME.findall(text))) if parameters else []


@functools.lru_cache(maxsize=1024)
def _parsed(text: str, parameters: tuple[tuple[str, float], ...]) -> Expression:
    # cached, since thousands of members of a sweep have the same force
    return Expression.parse(text, variables=("t",), constants=dict(parameters))
