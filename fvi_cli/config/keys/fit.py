"""``fit``: parameters and measurements for ``fvi fit``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from fvi_cli.keys.containers import ByForm, Named, OneOrMany
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import AsWritten, Number, Schema, Shape, Text
from fvi_cli.keys.settings import Setting, key, record_of

MOST_SETS: Final = 100


@dataclass(frozen=True, kw_only=True)
class Noise(Shape):
    """``auto`` or a standard deviation."""

    expected: str = "auto or a positive number"

    def read(self, at: Cursor) -> Any:
        """The word or a float."""
        if at.scalar == "auto":
            return "auto"
        if isinstance(at.scalar, int | float) and not isinstance(at.scalar, bool):
            return Number(above=0.0).read(at)
        return at.needs(self.expected)

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [{"const": "auto"}, Number(above=0.0).schema(defs)]}


_COLUMN: Final = Text(what="the name of a column")
Column = Annotated[str, _COLUMN]


class Parts(Setting):
    """Columns of the parts of an amplitude."""

    magnitude: Column | None = key("Column of the magnitude.", default=None)
    phase: Column | None = key("Column of the phase.", default=None)
    real: Column | None = key("Column of the real.", default=None)
    imaginary: Column | None = key("Column of the imaginary.", default=None)


_FORCE: Final = OneOrMany(shape=Text(what="a coordinate, a combination of them, or ground"))
_COLUMNS: Final = Named(
    shape=ByForm(single=_COLUMN, mappings=(record_of(Parts),)),
    names="coordinates, quantities, or expressions in coordinates",
    example="{x: displacement}",
)
_CHANGES: Final = Named(
    shape=Number(), names="key paths", example="{problem.initial.position: 2.0}"
)


class Data(Setting):
    """A measured motion, or a response."""

    file: Annotated[str, Text(what="the path of a CSV file")] = key(
        "CSV file, from the configuration's folder."
    )
    time: Column | None = key("Column of the times; default: t.", default=None)
    frequency: Column | None = key(
        "Column of frequencies, oscillations per unit of time, in place of time: the data are "
        "a steady response to harmonic forces.",
        default=None,
    )
    force: Annotated[tuple[str, ...] | None, _FORCE] = key(
        "Where the harmonic force of a response acts, as for fvi response.", default=None
    )
    columns: Annotated[Mapping[str, str | Parts], _COLUMNS] = key(
        "What was measured, each with its column: coordinates (x, or x1, x2, ...), v and the "
        "name of one for its velocity, a for its acceleration, names under quantities, or "
        "expressions in these. Of a response: coordinates, their combinations, v or a and the "
        "name of one, with the column of the magnitude or {magnitude: ..., phase: ...} "
        "(degrees) or {real: ..., imaginary: ...}."
    )
    name: Annotated[str | None, Text(what="a name")] = key(
        "Of the motion; default: the name of the file.", default=None
    )
    set: Annotated[Mapping[str, float], _CHANGES] = key(
        "Numbers of the problem that are different in this motion.", default={}
    )


class Parameter(
    Setting,
    refused={
        "min": "not a key: write from",
        "max": "not a key: write to",
        "initial": "not a key: write start",
        "bounds": "not a key: write from and to",
    },
):
    """A number of the problem that is fitted."""

    start: float | None = key(
        "Where the search begins; default: the value in the problem.", default=None
    )
    from_: float | None = key("Lower bound; with from: 0 the logarithm is fitted.", default=None)
    to: float | None = key("Upper bound.", default=None)


_PARAMETERS: Final = Named(
    shape=record_of(Parameter),
    names="key paths",
    example="{problem.damping.0.order: {start: 0.5, from: 0.05, to: 1.95}}",
)
Parameters = Annotated[Mapping[str, Parameter], _PARAMETERS]


class Model(Setting):
    """A model of the problem that is fitted."""

    set: Annotated[
        Mapping[str, Any],
        Named(shape=AsWritten(), names="key paths", example="{problem.damping.0.order: 1}"),
    ] = key("What is different from the problem of the experiment.", default={})
    parameters: Annotated[Mapping[str, Parameter] | None, _PARAMETERS] = key(
        "What is fitted; default: those of the fit that are not set.", default=None
    )


class Fit(Setting):
    """Parameters, models and measurements of a fit."""

    data: Annotated[tuple[Data, ...], OneOrMany(shape=record_of(Data), most=MOST_SETS)] = key(
        "Measured motions, one or several."
    )
    parameters: Parameters = key("Numbers of the problem that are fitted.")
    noise: Annotated[str | float, Noise()] = key(
        "Standard deviation of the noise: auto (estimated from the residuals), or a number.",
        default="auto",
    )
    models: Annotated[
        Mapping[str, Model] | None,
        Named(
            shape=record_of(Model),
            names="names",
            example="{viscous: {set: {problem.damping.0.order: 1}}}",
        ),
    ] = key(
        "Several descriptions that are fitted to the same data and compared; default: the one "
        "of the problem.",
        default=None,
    )
