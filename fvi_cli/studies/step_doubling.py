"""What a run and one on half as many steps say of each other."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.studies.experiment import Norm
from fvi_cli.studies.norms import error_norm

EPSILON: Final = float(np.finfo(float).eps)

LAST_PART: Final = 0.1
"""For the norm at the final time runs are compared on this last part of the grid: at a single
point two runs may agree by accident."""


def round_off_floor(scale: float, n_steps: int, final_time: float, norm: Norm) -> float:
    """Errors below this are round-off: 100 eps max|x| sqrt(N), in l2 times sqrt(T)."""
    unit = math.sqrt(final_time) if norm == "l2" else 1.0
    return 100 * EPSILON * scale * unit * math.sqrt(n_steps)


def difference_norm(fine: Trajectory, coarse: Trajectory, norm: Norm) -> float:
    """Norm of the difference of a run and one on half as many steps; inf where one did not end."""
    if fine.status != "ok" or coarse.status != "ok":
        return math.inf
    values, others = fine.position[::2], coarse.position
    if norm == "final":
        first = int((1.0 - LAST_PART) * (others.shape[0] - 1))
        return error_norm(values[first:], others[first:], coarse.step_size, "max")
    return error_norm(values, others, coarse.step_size, norm)
