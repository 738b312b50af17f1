"""Settings of an experiment: its tolerance, figures with settings, regions of ``fvi stability``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Final, Self

from pydantic import AfterValidator, Field, PrivateAttr

from fvi_cli.integrator.method import AnyMethod, ForcingQuadrature, Method
from fvi_cli.scenes.keys.mistakes import Wrong, refused
from fvi_cli.scenes.keys.values import (
    BY_FORM,
    ONE_OR_MANY,
    Fraction,
    Keys,
    NotNegative,
    Order,
    Positive,
    Range,
    key,
)

USUAL_STAGES = (10, 12, 8)
RULES: tuple[ForcingQuadrature, ...] = ("exact", "galerkin")
EXTENTS: Final = ("peak", "rms", "least", "greatest")
"""Numbers of a quantity over a whole run; ``plot: peak_drift`` is the peak of `drift`."""
LONGEST_NAME: Final = 100
"""Most characters that the name of a file has after the name of the experiment."""
EXAMPLE: Final = "{plot: peak_drift, against: problem.damping.0.coefficient}"
MOST_POINTS: Final = 250_000
"""Most points of one stability region."""


class Accuracy(Keys):
    """A tolerance in place of numbers of steps."""

    _stages: int | None = PrivateAttr(None)
    tolerance: Positive | None = key(
        "Largest error of the position, absolute, in report.norm; this or relative.", None
    )
    relative: Fraction | None = key("The same as a share of the largest position of the run.", None)
    max_step: Positive | None = key("Longest step, in the unit of time.", None)

    def mistakes(self) -> Iterator[Wrong]:
        """Either a tolerance or a share is given."""
        if self.tolerance is not None and self.relative is not None:
            yield Wrong(("relative",), "not together with tolerance: give one", of_key=True)
        if self.tolerance is None and self.relative is None:
            yield Wrong((), "a tolerance is missing; write {tolerance: 1e-8}, or relative")

    @property
    def stages(self) -> int | None:
        """Number of stages by the method that is given beside it; None: it follows."""
        return self._stages

    def with_stages(self, stages: int) -> Self:
        """The same tolerance for a method."""
        made = self.model_copy()
        made._stages = stages
        return made

    @property
    def methods(self) -> tuple[AnyMethod, ...]:
        """The methods that a run may end with."""
        return tuple(
            Method(cq="gauss", degree=stages, start="none", forcing_quadrature=rule)
            for stages in (USUAL_STAGES if self.stages is None else (self.stages,))
            for rule in RULES
        )

    def length(self, amplitude: float) -> float:
        """The tolerance as a length, for a motion of this size."""
        return self.tolerance or (self.relative or 0.0) * amplitude

    def specification(self) -> dict[str, object]:
        """All settings that determine the steps, as JSON values."""
        given = {
            "tolerance": self.tolerance,
            "relative": self.relative,
            "max_step": self.max_step,
            "stages": self.stages,
        }
        return {name: value for name, value in given.items() if value is not None}


class FigureSettings(Keys):
    """A figure of the outputs, quantities and events of an experiment."""

    plot: str | None = key(
        "What is drawn: peak_, rms_, least_ or greatest_ before the name of a quantity, or an "
        "event of which every occurrence is a dot (a bifurcation diagram).",
        None,
    )
    against: str | None = key(
        "The swept key below it; a second one makes curves, a third one colours.", None
    )
    section: str | None = key(
        "In place of plot: velocity against position at every occurrence of this event.", None
    )
    ensemble: Annotated[list[str], Field(min_length=1, max_length=12)] | None = key(
        "In place of plot: mean over the members at every time, with bands of one standard "
        "deviation and of all members, a panel for each of these coordinates and quantities; of "
        "designs with a sweep a mean for every design.",
        None,
    )
    after: NotNegative = key("Of events: those before this time are left out.", 0.0, unit="time")

    def mistakes(self) -> Iterator[Wrong]:
        """Incomplete settings (``plot`` without ``against``) and contradictory ones."""
        given = [name for name, value in self if value is not None and name != "after"]
        kind = next((one for one in ("section", "ensemble") if one in given), "")
        for name in given if kind else ():
            if name != kind:
                yield Wrong((name,), f"not together with {kind}: write two figures", of_key=True)
        for name, example in (("plot", "peak_drift"), ("against", "problem.stiffness")):
            if not kind and name not in given:
                yield Wrong((name,), f"missing; write {name}: {example}")

    @property
    def extent(self) -> tuple[str, str]:
        """Extent and quantity in `plot`, (``peak``, ``drift``); two empty words if it has none."""
        match = re.fullmatch(rf"({'|'.join(EXTENTS)})_(.+)", self.plot or "")
        return (match[1], match[2]) if match else ("", "")

    @property
    def file_name(self) -> str:
        """The part of file names that follows the name of the experiment."""
        words = f"section-{self.section}"
        if self.ensemble is not None:
            words = "-".join(("ensemble", *self.ensemble))
            if len(words) > LONGEST_NAME:
                words = f"ensemble-{self.ensemble[0]}-and-{len(self.ensemble) - 1}-more"
        elif self.plot is not None:
            words = f"{self.plot}-against-{(self.against or '').removeprefix('problem.')}"
        return re.sub(r"[^A-Za-z0-9]+", "-", words).strip("-")


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
