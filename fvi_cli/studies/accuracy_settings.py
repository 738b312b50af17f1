"""The tolerance that an experiment gives in place of a ladder."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Self

from pydantic import PrivateAttr

from fvi_cli.integrator.method import AnyMethod, ForcingQuadrature, Method
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import Fraction, Keys, Positive, key

USUAL_STAGES = (10, 12, 8)
RULES: tuple[ForcingQuadrature, ...] = ("exact", "galerkin")


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
