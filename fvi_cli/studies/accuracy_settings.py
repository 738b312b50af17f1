"""What a tolerance in place of a ladder asks for, and what it came to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from fvi_cli.integrator.method import AnyMethod, ForcingQuadrature, Method
from fvi_cli.integrator.trajectory import Outcome

MeshChoice = Literal["adaptive", "uniform"]


USUAL_CANDIDATES: tuple[AnyMethod, ...] = tuple(
    Method(cq="gauss", degree=degree, start="graded") for degree in (4, 3, 2)
)
"""The methods of which one is chosen where a configuration names none."""


def _adaptive(degree: int, rule: ForcingQuadrature) -> Method:
    return Method(cq="gauss", degree=degree, start="none", forcing_quadrature=rule)


RULES: tuple[ForcingQuadrature, ...] = ("exact", "galerkin")
ADAPTIVE_CANDIDATES: tuple[AnyMethod, ...] = tuple(
    _adaptive(degree, rule) for degree in (10, 8, 6, 5, 4) for rule in RULES
)
"""The methods that runs on adaptive meshes come to."""


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """A tolerance in place of numbers of steps.

    Parameters
    ----------
    tolerance
        Largest error of the position, absolute, in the norm of the experiment.
    relative
        The same as a share of the largest position of the run; one of the two.
    mesh
        ``adaptive``: steps are found on the way; ``uniform``: N equal steps are chosen.
    candidates
        The methods of which one is chosen.

    Raises
    ------
    ValueError
        If not exactly one positive number is given, or there is no candidate.
    """

    tolerance: float | None = None
    relative: float | None = None
    mesh: MeshChoice = "uniform"
    candidates: tuple[AnyMethod, ...] = USUAL_CANDIDATES

    def __post_init__(self) -> None:
        if (self.tolerance is None) == (self.relative is None):
            raise ValueError("tolerance: give either tolerance or relative")
        for name in ("tolerance", "relative"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ValueError(f"{name}: {value!r} is not allowed; it must be positive")
        if self.relative is not None and self.relative >= 1:
            raise ValueError(f"relative: {self.relative!r} is not allowed; it must be less than 1")
        if not self.candidates:
            raise ValueError("candidates: at least one method is needed")

    @property
    def words(self) -> str:
        """What is asked for, in words."""
        if self.tolerance is not None:
            return f"{self.tolerance:g}"
        return f"{self.relative:g} of the largest position"

    def specification(self) -> dict[str, object]:
        """What determines the choice, as JSON values."""
        given = {"tolerance": self.tolerance, "relative": self.relative}
        asked = {name: value for name, value in given.items() if value is not None}
        if self.mesh == "adaptive":
            return {**asked, "mesh": "adaptive"}
        return {**asked, "candidates": [method.case for method in self.candidates]}


@dataclass(frozen=True, kw_only=True)
class Assurance:
    """What is known of the error of a run that was chosen for a tolerance.

    Parameters
    ----------
    tolerance
        What was asked for, a length.
    estimate
        Estimated error; nan where there was nothing to compare.
    choice
        In one line: which method on how many steps, and why.
    attempts
        One line for every run that was made on the way, this one included.
    outcome
        ``met``, ``unreliable`` or ``refused``.
    relative
        What was asked for as a share of the largest position; None: a length.
    """

    tolerance: float
    estimate: float
    choice: str
    attempts: tuple[str, ...]
    outcome: Outcome = "met"
    relative: float | None = None
