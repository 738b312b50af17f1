"""What a search for a tolerance knows of a run, and where it begins."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array

LOOSE: Final = 30.0
POWER: Final = 1.3
"""The error of the delivered run is below (local tolerance)^1.3 / 30, relative to the motion."""
COARSEST: Final = 0.01
"""No local tolerance is larger than this share of the motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Round:
    """A run with what another one says of its error: differences at times, and shares of them."""

    run: Trajectory
    line: str
    times: Array = field(default_factory=lambda: np.zeros(1))
    differences: Array = field(default_factory=lambda: np.array([math.inf]))
    at_points: float = math.inf
    between: float = math.inf

    @property
    def estimate(self) -> float:
        """Estimated largest error at any time, a length; infinite where none is known."""
        return max(self.at_points, self.between) if self.run.status == "ok" else math.inf

    @property
    def amplitude(self) -> float:
        """Largest position, a length."""
        return amplitude_of(self.run)


def amplitude_of(run: Trajectory) -> float:
    """Largest position of a run, a length."""
    found = float(np.abs(run.position).max())
    return found if math.isfinite(found) else 0.0


def first_local(target: float, amplitude: float) -> float:
    """Local tolerance to begin with, a length."""
    if target <= 0:
        # nothing is known to move, in no unit of length
        return 1.0
    if amplitude <= 0:
        return target
    # of less than the tolerance nothing is known
    amplitude = max(amplitude, target)
    share = (LOOSE * target / amplitude) ** (1 / POWER)
    return float(amplitude * min(COARSEST, share))
