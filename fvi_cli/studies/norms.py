"""Norms of an error over a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context
from typing import Final, Literal

import numpy as np

from fvi_cli.mathematics.arrays import Array

Norm = Literal["max", "final", "l2"]
NORMS: Final[tuple[Norm, ...]] = ("max", "final", "l2")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Errors of a run in every norm, kept so that the points of the run need not be."""

    max: float
    final: float
    l2: float
    largest: float  # position of the reference, or of the run where there is no reference
    round_off: float  # error by round-off, relative to `largest`
    reference: float  # error of the reference in the maximum norm; nan: there is none

    def unit(self, norm: Norm, final_time: float) -> float:
        """The norm of an error of one everywhere: in l2 it grows with the length of the run."""
        return math.sqrt(final_time) if norm == "l2" else 1.0

    def scale(self, norm: Norm, final_time: float) -> float:
        """The error of a run that stays at zero."""
        return self.unit(norm, final_time) * self.largest

    def floor(self, norm: Norm, final_time: float) -> float:
        """Errors below this are round-off or the reference's own error."""
        round_off = self.scale(norm, final_time) * self.round_off
        if math.isnan(self.reference):
            return round_off
        return max(round_off, 10 * self.unit(norm, final_time) * self.reference)


def round_up(bound: float) -> str:
    """A bound with two digits, rounded upwards so that it stays a bound up to round-off."""
    digits = Context(prec=2, rounding=ROUND_CEILING).create_decimal(f"{bound:.12g}")
    return f"{float(digits):.1e}"


def point_weights(time: Array, step_size: float, every: int, grading: float) -> float | Array:
    """Weights of points in l2, times; a kept point reaches half-way to its kept neighbours."""
    if every > 1:
        gaps = np.diff(time, prepend=time[0] - step_size, append=time[-1] + step_size)
        return np.asarray(0.5 * (gaps[:-1] + gaps[1:]))
    if grading != 1.0:
        return np.diff(time, prepend=0.0)
    return step_size


def error_norm(position: Array, exact: Array, step_size: float | Array, norm: Norm) -> float:
    r"""Norm of position - exact, both of shape ``(n, d)``.

    ``max``: over components and grid points; ``final``: over components at the last point;
    ``l2``: :math:`(\sum_k h_k |e_k|^2)^{1/2}` with the Euclidean norm of the components, where
    h_k is `step_size`, or one size for every point, shape ``(n,)``.
    Values that are not finite give nan or infinity, never a number that looks right.

    Raises
    ------
    ValueError
        If the shapes differ or the norm is not known.
    """
    if position.shape != exact.shape:
        raise ValueError(f"shapes differ: {position.shape} and {exact.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.abs(position - exact)
        if norm == "max":
            return float(error.max())
        if norm == "final":
            return float(error[-1].max())
        if norm == "l2":
            scale = float(error.max())
            if not 0 < scale < np.inf:
                return scale
            squares = ((error / scale) ** 2).sum(axis=1)
            return scale * float(np.sqrt((step_size * squares).sum()))
    raise ValueError(f"norm: {norm!r} is not one of max, final, l2")
