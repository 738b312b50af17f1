"""``fit``: what ``fvi fit`` fits to which measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from fvi_cli.keys.containers import ByForm, Named, OneOrMany
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.nodes import MappingNode, plain
from fvi_cli.keys.records import Key, Record, optional
from fvi_cli.keys.scalars import Flag, Number, Schema, Text
from fvi_cli.studies.fits.settings import PARTS

MOST_SETS: Final = 100


@dataclass(frozen=True, kw_only=True)
class Anything:
    """Whatever stands there, read again where it is used."""

    expected: str = "what may stand under that key"

    def read(self, at: Cursor) -> Any:
        """Plain values."""
        return plain(at.node)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {}


@dataclass(frozen=True, kw_only=True)
class Noise:
    """``auto``, a standard deviation, or one for each column."""

    expected: str = "auto, a positive number, or a mapping such as {displacement: 0.01}"

    def read(self, at: Cursor) -> Any:
        """The word, a float, or a dict."""
        if isinstance(at.node, MappingNode):
            return Named(shape=Number(above=0.0), names="columns").read(at)
        if at.scalar == "auto":
            return "auto"
        if isinstance(at.scalar, int | float) and not isinstance(at.scalar, bool):
            return Number(above=0.0).read(at)
        return at.needs(self.expected)

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        number = Number(above=0.0).schema()
        return {
            "anyOf": [
                {"const": "auto"},
                number,
                {"type": "object", "additionalProperties": number},
            ]
        }


_COLUMN: Final = Text(what="the name of a column")
_NAMES: Final = "coordinates, quantities, or expressions in coordinates"
_DATA: Final = Record(
    keys=(
        Key(
            "file",
            Text(what="the path of a CSV file"),
            "CSV file, from the configuration's folder.",
        ),
        optional("time", _COLUMN, "Column of the times; default: t."),
        optional(
            "frequency",
            _COLUMN,
            "Column of frequencies, oscillations per unit of time, in place of time: the data are "
            "a steady response to harmonic forces.",
        ),
        optional(
            "force",
            OneOrMany(shape=Text(what="a coordinate, a combination of them, or ground")),
            "Where the harmonic force of a response acts, as for fvi response.",
        ),
        Key(
            "columns",
            Named(
                shape=ByForm(
                    single=_COLUMN,
                    mappings=(
                        Record(
                            keys=tuple(
                                optional(part, _COLUMN, f"Column of the {part}.") for part in PARTS
                            )
                        ),
                    ),
                ),
                names=_NAMES,
                example="{x: displacement}",
            ),
            "What was measured, each with its column: coordinates (x, or x1, x2, ...), v and the "
            "name of one for its velocity, a for its acceleration, names under quantities, or "
            "expressions in these. Of a response: coordinates, their combinations, v or a and the "
            "name of one, with the column of the magnitude or {magnitude: ..., phase: ...} "
            "(degrees) or {real: ..., imaginary: ...}.",
        ),
        optional("name", Text(what="a name"), "Of the motion; default: the name of the file."),
        Key(
            "set",
            Named(shape=Number(), names="key paths", example="{problem.initial.position: 2.0}"),
            "Numbers of the problem that are different in this motion.",
            default={},
        ),
    )
)
_PARAMETER: Final = Record(
    keys=(
        optional("start", Number(), "Where the search begins; default: the value in the problem."),
        optional("from", Number(), "Lower bound; with from: 0 the logarithm is fitted."),
        optional("to", Number(), "Upper bound."),
        optional("fixed", Number(), "Not fitted, but held at this value."),
        optional(
            "tied",
            Text(what="the key path of another parameter"),
            "Not fitted on its own: factor times this parameter.",
        ),
        Key("factor", Number(), "Of the tie.", default=1.0),
        Key("own", Flag(), "Every motion in data has its own value.", default=False),
    ),
    refused={
        "min": "not a key: write from",
        "max": "not a key: write to",
        "initial": "not a key: write start",
        "bounds": "not a key: write from and to",
    },
)
_PARAMETERS: Final = Named(
    shape=_PARAMETER,
    names="key paths",
    example="{problem.damping.0.order: {start: 0.5, from: 0.05, to: 1.95}}",
)
_MODEL: Final = Record(
    keys=(
        Key(
            "set",
            Named(shape=Anything(), names="key paths", example="{problem.damping.0.order: 1}"),
            "What is different from the problem of the experiment.",
            default={},
        ),
        optional(
            "parameters", _PARAMETERS, "What is fitted; default: those of the fit that are not set."
        ),
    )
)
FIT: Final = Record(
    keys=(
        Key("data", OneOrMany(shape=_DATA, most=MOST_SETS), "Measured motions, one or several."),
        Key("parameters", _PARAMETERS, "Numbers of the problem that are fitted."),
        Key(
            "noise",
            Noise(),
            "Standard deviation of the noise: auto (estimated from what is left), a number, or a "
            "mapping from columns to numbers.",
            default="auto",
        ),
        optional(
            "models",
            Named(
                shape=_MODEL,
                names="names",
                example="{viscous: {set: {problem.damping.0.order: 1}}}",
            ),
            "Several descriptions that are fitted to the same data and compared; default: the one "
            "of the problem.",
        ),
    )
)
