"""The tolerance that an experiment gives in place of a ladder, and the result of its search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from fvi_cli.integrator.method import AnyMethod, ForcingQuadrature, Method
from fvi_cli.integrator.trajectory import Outcome
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.settings import Fraction, Positive, Setting, key

USUAL_STAGES = (10, 12, 8)
RULES: tuple[ForcingQuadrature, ...] = ("exact", "galerkin")


class Accuracy(Setting, forms=(("tolerance",), ("relative",))):
    """A tolerance in place of numbers of steps."""

    stages: ClassVar[int | None] = None
    """Number of stages by the method that is given beside it; None: it follows."""
    tolerance: Positive | None = key(
        "Largest error of the position, absolute, in report.norm; this or relative.", default=None
    )
    relative: Fraction | None = key(
        "The same as a share of the largest position of the run.", default=None
    )
    max_step: Positive | None = key("Longest step, in the unit of time.", default=None)

    @classmethod
    def check_presence(cls, at: Cursor) -> None:
        """Either a tolerance or a share is given."""
        if at.has("tolerance") and at.has("relative"):
            at.refuse_key("relative", "not together with tolerance: give one of them")
        if not at.has("tolerance") and not at.has("relative"):
            at.refuse("missing; give a tolerance, such as 1e-8, or relative", "tolerance")

    @property
    def words(self) -> str:
        """The requested tolerance, in words."""
        if self.tolerance is not None:
            return f"{self.tolerance:g}"
        return f"{self.relative:g} of the largest position"

    @property
    def methods(self) -> tuple[AnyMethod, ...]:
        """The methods that a run may end with."""
        return tuple(
            Method(cq="gauss", degree=stages, start="none", forcing_quadrature=rule)
            for stages in (USUAL_STAGES if self.stages is None else (self.stages,))
            for rule in RULES
        )

    def specification(self) -> dict[str, object]:
        """All settings that determine the steps, as JSON values."""
        given = {
            "tolerance": self.tolerance,
            "relative": self.relative,
            "max_step": self.max_step,
            "stages": self.stages,
        }
        return {name: value for name, value in given.items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class Assurance:
    """The error of a run that was chosen for a tolerance, as far as it is known."""

    tolerance: float  # requested tolerance, a length
    estimate: float  # estimated error; nan where no second run could be compared
    attempts: tuple[str, ...]  # one line for every run of the search, this one included
    outcome: Outcome = "met"
    """``met``, ``unreliable`` or ``refused``."""
    relative: float | None = None
    """The tolerance as a share of the largest position; None: it was given as a length."""
