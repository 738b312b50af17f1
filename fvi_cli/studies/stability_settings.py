"""The settings of an experiment for ``fvi stability``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Final

from fvi_cli.keys.containers import OneOrMany
from fvi_cli.keys.cursor import INVALID, Cursor, is_complete
from fvi_cli.keys.nodes import MappingNode
from fvi_cli.keys.ranges import RANGE
from fvi_cli.keys.scalars import Number, Schema, Shape
from fvi_cli.keys.settings import Setting, key

MOST_POINTS: Final = 250_000
"""Most points of one stability region."""


@dataclass(frozen=True, kw_only=True)
class PositiveRange(Shape):
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

    def build(self, value: Any) -> Any:
        """A tuple."""
        return tuple(value) if isinstance(value, list) else value

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        listed = {"type": "array", "items": Number().schema(defs), "minItems": 1}
        return {"anyOf": [RANGE.schema(defs), listed]}


Rising = Annotated[tuple[float, ...], PositiveRange()]
Orders = Annotated[tuple[float, ...], OneOrMany(shape=Number(above=0.0, below=2.0), most=20)]


class Region(Setting, expected="{orders: [...], stiffness: {...}, damping: {...}}"):
    """A part of the plane in which stability regions are drawn."""

    orders: Orders = key("Orders of damping, in (0, 2): one plane for each.")
    stiffness: Rising = key("Values of h**2 k / m, the stiffness as one step sees it.")
    damping: Rising = key("Values of mu h**(2 - order) / m, the damping as one step sees it.")

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The values, or a complaint where the region has too many points."""
        points = len(self.stiffness) * len(self.damping)
        if points > MOST_POINTS:
            return at.refuse(f"{points} points; at most {MOST_POINTS} are allowed")
        return values


class StabilitySettings(Setting):
    """Regions that ``fvi stability`` examines."""

    region: Region | None = key(
        "Draw stability regions in the plane of stiffness and damping of a step.", default=None
    )


USUAL = StabilitySettings.of({})
"""The default settings."""
