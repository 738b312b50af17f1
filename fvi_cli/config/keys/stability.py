"""``stability``: what ``fvi stability`` looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from fvi_cli.keys.containers import Checked, OneOrMany
from fvi_cli.keys.cursor import INVALID, Cursor, is_complete
from fvi_cli.keys.nodes import MappingNode
from fvi_cli.keys.ranges import RANGE
from fvi_cli.keys.records import Key, Record, optional
from fvi_cli.keys.scalars import Flag, Number, Schema, Shape
from fvi_cli.studies.stability_settings import RegionSettings, StabilitySettings

MOST_POINTS: Final = 250_000
"""Points of one stability region."""


@dataclass(frozen=True, kw_only=True)
class PositiveRange:
    """A rising range of positive numbers, written as a range or as a list."""

    expected: str = "{from: 0.01, to: 1e6, number: 100, spacing: log}, or an increasing list"

    def read(self, at: Cursor) -> Any:
        """A list of floats."""
        listed: Shape = OneOrMany(shape=Number())
        values = (RANGE if isinstance(at.node, MappingNode) else listed).read(at)
        if not is_complete(values):
            return INVALID
        for before, value in zip([0.0, *values], values, strict=False):
            if not value > before:
                return at.refuse(f"{value:g} is not allowed; numbers must be positive and increase")
        return values

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        listed = {"type": "array", "items": Number().schema(), "minItems": 1}
        return {"anyOf": [RANGE.schema(), listed]}


def _limited(values: Mapping[str, Any], at: Cursor) -> Any:
    points = len(values["stiffness"]) * len(values["damping"])
    if points > MOST_POINTS:
        return at.refuse(f"{points} points; at most {MOST_POINTS} are allowed")
    return values


_REGION: Final = Checked(
    shape=Record(
        keys=(
            Key(
                "orders",
                OneOrMany(shape=Number(above=0.0, below=2.0), most=20),
                "Orders of damping, in (0, 2): one plane for each.",
            ),
            Key(
                "stiffness",
                PositiveRange(),
                "Values of h**2 k / m, the stiffness as one step sees it.",
            ),
            Key(
                "damping",
                PositiveRange(),
                "Values of mu h**(2 - order) / m, the damping as one step sees it.",
            ),
        )
    ),
    check=_limited,
    words="{orders: [...], stiffness: {...}, damping: {...}}",
)

STABILITY: Final = Record(
    keys=(
        Key(
            "observe",
            Flag(),
            "Run every method from random data and compare with what is predicted.",
            default=True,
        ),
        optional(
            "region",
            _REGION,
            "Draw stability regions in the plane of stiffness and damping of a step.",
        ),
    )
)


def stability_settings(values: Mapping[str, Any]) -> StabilitySettings:
    """The settings that a mapping read by :data:`STABILITY` describes."""
    region = None
    if "region" in values:
        region = RegionSettings(**{key: tuple(entry) for key, entry in values["region"].items()})
    return StabilitySettings(is_observed=values["observe"], region=region)
