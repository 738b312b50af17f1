"""The tolerance that an experiment gives in place of a ladder, and the result of its search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from fvi_cli.integrator.method import AnyMethod, ForcingQuadrature, Method
from fvi_cli.integrator.trajectory import Outcome
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.settings import Fraction, Positive, Setting, key

MeshChoice = Literal["adaptive", "uniform"]


USUAL_CANDIDATES: tuple[AnyMethod, ...] = tuple(
    Method(cq="gauss", degree=degree, start="graded") for degree in (4, 3, 2)
)
"""The candidate methods of a configuration that names none."""


RULES: tuple[ForcingQuadrature, ...] = ("exact", "galerkin")
ADAPTIVE_CANDIDATES: tuple[AnyMethod, ...] = tuple(
    Method(cq="gauss", degree=degree, start="none", forcing_quadrature=rule)
    for degree in (10, 8, 6, 5, 4, 12)
    for rule in RULES
)
"""The methods that a run on an adaptive mesh may end with."""


class Accuracy(Setting, forms=(("tolerance",), ("relative",))):
    """A tolerance in place of numbers of steps, and the candidate methods."""

    candidates: ClassVar[tuple[AnyMethod, ...]] = USUAL_CANDIDATES
    tolerance: Positive | None = key(
        "Largest error of the position, absolute, in report.norm; this or relative.", default=None
    )
    relative: Fraction | None = key(
        "The same as a share of the largest position of the run.", default=None
    )
    mesh: MeshChoice | None = key(
        "adaptive: steps are chosen during the run, with 4 to 10 stages; uniform: one of the "
        "methods with a number of equal steps is chosen. Default: adaptive where no method "
        "is given.",
        default=None,
    )

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

    def specification(self) -> dict[str, object]:
        """All settings that determine the choice of method and steps, as JSON values."""
        given = {"tolerance": self.tolerance, "relative": self.relative}
        settings = {name: value for name, value in given.items() if value is not None}
        if self.mesh == "adaptive":
            return {**settings, "mesh": "adaptive"}
        return {**settings, "candidates": [method.case for method in self.candidates]}


@dataclass(frozen=True, kw_only=True)
class Assurance:
    """The error of a run that was chosen for a tolerance, as far as it is known."""

    tolerance: float  # requested tolerance, a length
    estimate: float  # estimated error; nan where no second run could be compared
    choice: str  # one line: the chosen method and number of steps, and why
    attempts: tuple[str, ...]  # one line for every run of the search, this one included
    outcome: Outcome = "met"
    """``met``, ``unreliable`` or ``refused``."""
    relative: float | None = None
    """The tolerance as a share of the largest position; None: it was given as a length."""
