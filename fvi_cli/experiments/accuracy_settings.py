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

    Raises
    ------
    ValueError
        If it is not a positive number.
    """

    tolerance: float

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance < math.inf:
            raise ValueError(f"tolerance: {self.tolerance!r} is not allowed; it must be positive")


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
