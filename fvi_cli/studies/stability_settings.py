"""The settings of an experiment for ``fvi stability``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Final

from pydantic import AfterValidator, Field

from fvi_cli.scenes.keys.mistakes import Wrong, refused
from fvi_cli.scenes.keys.values import BY_FORM, ONE_OR_MANY, Keys, Order, Range, key

MOST_POINTS: Final = 250_000
"""Most points of one stability region."""


def _rising(values: list[float] | Range) -> list[float]:
    numbers = values.values() if isinstance(values, Range) else values
    for before, value in zip([0.0, *numbers], numbers, strict=False):
        if not value > before:
            words = f"{value:g} is not allowed; numbers must be positive and increase"
            raise refused(Wrong((), words))
    return numbers


Rising = Annotated[list[float] | Range, BY_FORM, AfterValidator(_rising)]


class Region(Keys):
    """A part of the plane in which stability regions are drawn."""

    orders: Annotated[list[Order], Field(min_length=1, max_length=20), ONE_OR_MANY] = key(
        "Orders of damping, in (0, 2): one plane for each."
    )
    stiffness: Rising = key("Values of h**2 k / m, the stiffness as one step sees it.")
    damping: Rising = key("Values of mu h**(2 - order) / m, the damping as one step sees it.")

    @property
    def axes(self) -> tuple[list[float], list[float]]:
        """The values of stiffness and of damping."""
        return _rising(self.stiffness), _rising(self.damping)

    def mistakes(self) -> Iterator[Wrong]:
        """Too many points."""
        stiffness, damping = self.axes
        if (points := len(stiffness) * len(damping)) > MOST_POINTS:
            yield Wrong((), f"{points} points; at most {MOST_POINTS} are allowed")


class StabilitySettings(Keys):
    """Regions that ``fvi stability`` examines."""

    region: Region | None = key(
        "Draw stability regions in the plane of stiffness and damping of a step.", None
    )


USUAL = StabilitySettings()
"""The default settings."""
