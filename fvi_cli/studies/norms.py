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

    @property
    def floor(self) -> float:
        """Largest error of a component that is round-off or the reference's own error."""
        round_off = self.largest * self.round_off
        return round_off if math.isnan(self.reference) else max(round_off, 10 * self.reference)


def unit_of(norm: Norm, final_time: float, dimension: int) -> float:
    r"""Norm of an error of one in every component at all times, :math:`\sqrt{T d}` in l2."""
    return math.sqrt(final_time * dimension) if norm == "l2" else 1.0


def round_up(bound: float) -> str:
    """A bound with two digits, rounded upwards so that it stays a bound up to round-off."""
    digits = Context(prec=2, rounding=ROUND_CEILING).create_decimal(f"{bound:.12g}")
    return f"{float(digits):.1e}"


def point_weights(time: Array) -> Array:
    """Weights of points in l2, times: the step before each, for the first the one after it."""
    return np.diff(time, prepend=2 * time[0] - time[1]) if time.size > 1 else np.zeros(1)


def error_norm(position: Array, exact: Array, weights: float | Array, norm: Norm) -> float:
    r"""Norm of position - exact, both of shape ``(n, d)``.

    ``max``: over components and grid points; ``final``: over components at the last point;
    ``l2``: :math:`(\sum_k h_k |e_k|^2)^{1/2}` with the Euclidean norm of the components and the
    `weights` h_k, one or shape ``(n,)``.
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
            return scale * float(np.sqrt((weights * squares).sum()))
    raise ValueError(f"norm: {norm!r} is not one of max, final, l2")
