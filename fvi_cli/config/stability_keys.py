"""The keys of ``stability``: what ``fvi stability`` looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from fvi_cli.config.complaints import Complaints, KeyPath
from fvi_cli.config.document import MappingNode, Node
from fvi_cli.config.ranges import Range
from fvi_cli.config.records import Key, OneOrMany, Record
from fvi_cli.config.shapes import INVALID, OPTIONAL, Flag, Number, Schema, is_complete
from fvi_cli.studies.stability_settings import RegionSettings, StabilitySettings

MOST_POINTS: Final = 250_000
"""Points of one stability region."""


@dataclass(frozen=True, kw_only=True)
class PositiveRange:
    """A rising range of positive numbers, written as a range or as a list."""

    expected: str = "{from: 0.01, to: 1e6, number: 100, spacing: log}, or an increasing list"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A list of floats."""
        shape = Range() if isinstance(node, MappingNode) else OneOrMany(shape=Number(), most=10_000)
        values = shape.read(node, path, complaints)
        if not is_complete(values):
            return INVALID
        for before, value in zip([0.0, *values], values, strict=False):
            if not value > before:
                message = f"{value:g} is not allowed; numbers must be positive and increase"
                complaints.add(node.place, path, message)
                return INVALID
        return values

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        listed = {"type": "array", "items": Number().schema(), "minItems": 1}
        return {"anyOf": [Range().schema(), listed]}


_ORDER: Final = Number(above=0.0, below=2.0)
_REGION_KEYS: Final = Record(
    keys=(
        Key(
            name="orders",
            shape=OneOrMany(shape=_ORDER, most=20),
            meaning="Orders of damping, in (0, 2): one plane for each.",
        ),
        Key(
            name="stiffness",
            shape=PositiveRange(),
            meaning="Values of h**2 k / m, the stiffness as one step sees it.",
        ),
        Key(
            name="damping",
            shape=PositiveRange(),
            meaning="Values of mu h**(2 - order) / m, the damping as one step sees it.",
        ),
    )
)


@dataclass(frozen=True, kw_only=True)
class Region:
    """Where stability regions are drawn."""

    expected: str = "{orders: [...], stiffness: {...}, damping: {...}}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A mapping of lists."""
        values = _REGION_KEYS.read(node, path, complaints)
        if not is_complete(values):
            return INVALID
        points = len(values["stiffness"]) * len(values["damping"])
        if points > MOST_POINTS:
            complaints.add(node.place, path, f"{points} points; at most {MOST_POINTS} are allowed")
            return INVALID
        return values

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return _REGION_KEYS.schema()


STABILITY: Final = Record(
    keys=(
        Key(
            name="observe",
            shape=Flag(),
            meaning="Run every method from random data and compare with what is predicted.",
            default=True,
        ),
        Key(
            name="region",
            shape=Region(),
            meaning="Draw stability regions in the plane of stiffness and damping of a step.",
            default=OPTIONAL,
        ),
    )
)


def stability_settings(values: Mapping[str, Any]) -> StabilitySettings:
    """The settings that a mapping read by :data:`STABILITY` describes."""
    region = None
    if "region" in values:
        region = RegionSettings(**{key: tuple(entry) for key, entry in values["region"].items()})
    return StabilitySettings(is_observed=values["observe"], region=region)
