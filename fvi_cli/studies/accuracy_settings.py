"""What a tolerance in place of a ladder asks for, and what it came to."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fvi_cli.integrator.method import AnyMethod, Method, Start


def _usual(degree: int, start: Start) -> Method:
    return Method(cq="gauss", degree=degree, start=start)


USUAL_CANDIDATES: tuple[AnyMethod, ...] = tuple(
    _usual(degree, start) for degree in (4, 3, 2) for start in ("series", "none")
)
"""The methods of which one is chosen where a configuration names none."""


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """A tolerance in place of numbers of steps.

    Parameters
    ----------
    tolerance
        Largest error of the position, absolute, in the norm of the experiment.
    candidates
        The methods of which one is chosen.

    Raises
    ------
    ValueError
        If the tolerance is not a positive number, or there is no candidate.
    """

    tolerance: float
    candidates: tuple[AnyMethod, ...] = USUAL_CANDIDATES

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance < math.inf:
            raise ValueError(f"tolerance: {self.tolerance!r} is not allowed; it must be positive")
        if not self.candidates:
            raise ValueError("candidates: at least one method is needed")

    def specification(self) -> dict[str, object]:
        """What determines the choice, as JSON values."""
        return {
            "tolerance": self.tolerance,
            "candidates": [method.case for method in self.candidates],
        }


@dataclass(frozen=True, kw_only=True)
class Assurance:
    """What is known of the error of a run that was chosen for a tolerance.

    Parameters
    ----------
    tolerance
        What was asked for.
    estimate
        Estimated error from N steps against N/2; nan where there was nothing to compare.
    choice
        In one line: which method on how many steps, and why.
    attempts
        One line for every run that was made on the way, this one included.
    """

    tolerance: float
    estimate: float
    choice: str
    attempts: tuple[str, ...]
