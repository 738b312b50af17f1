"""Statistics of residuals: errors, a criterion to compare models, a test for noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array

SINGULAR = 1e-9
"""Singular values of the scaled derivatives below this: some parameters cannot be separated."""
ROUND_OFF = 1e-9
"""Noise is at least this share of the data: less is round-off."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearised:
    r"""The linear problem at a minimum: n residuals of s series, p parameters.

    With H the matrix that projects data onto the motions that the parameters make, and n_c values
    in series c, the residuals of the series have :math:`n_c - \mathrm{tr} H_{cc}` degrees of
    freedom (Patterson and Thompson, *Recovery of inter-block information*, 1971: the variance of
    every series by restricted likelihood). The variance of an estimate is a weighted sum of those
    of the series (Satterthwaite, *An approximate distribution of estimates of variance components*,
    1946).
    """

    is_regular: bool  # whether the data determine all parameters
    errors: Array  # standard errors, (p,); infinite if they do not
    correlations: Array  # (p, p)
    series_freedoms: Array  # (s,)
    freedoms: Array  # with which the error of every parameter is known, (p,)


def linearised(jacobian: Array, sizes: Sequence[int]) -> Linearised:
    """Errors and degrees of freedom from the derivatives of residuals, over their deviations."""
    norms = np.linalg.norm(jacobian, axis=0)
    norms[norms == 0] = 1.0
    left, singular, right = np.linalg.svd(jacobian / norms, full_matrices=False)
    kept = singular > SINGULAR * singular.max(initial=0.0)
    inverse = (right[kept].T / singular[kept]) @ left[:, kept].T
    starts = np.cumsum([0, *sizes[:-1]])
    used = np.add.reduceat(np.sum(left[:, kept] ** 2, axis=1), starts)
    own = np.maximum(np.array(sizes) - used, 1e-3)
    shares = np.add.reduceat(inverse**2, starts, axis=1)
    total = shares.sum(axis=1)
    errors = np.sqrt(total) / norms
    with np.errstate(all="ignore"):
        correlations = inverse @ inverse.T / np.sqrt(np.outer(total, total))
        freedoms = total**2 / np.sum(shares**2 / own, axis=1)
    is_regular = bool(kept.all())
    return Linearised(
        is_regular=is_regular,
        errors=errors if is_regular else np.full(errors.size, math.inf),
        correlations=correlations if is_regular else np.eye(errors.size),
        series_freedoms=own,
        freedoms=freedoms,
    )


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def criterion(left: Sequence[Array], misfit: float, p: int, *, is_known: bool) -> float:
    """AICc for normal noise; estimated deviations count as parameters."""
    n, k = sum(one.size for one in left), p if is_known else p + len(left)
    value = misfit
    if not is_known:
        value = sum(one.size * math.log(max(float(np.mean(one**2)), 1e-300)) for one in left)
    return value + 2.0 * k * n / (n - k - 1) if n > k + 1 else math.inf


def whiteness(left: Array, values: Array) -> float:
    """Probability that noise is as correlated in time as this (Ljung and Box, 1978)."""
    n = left.size
    lags = min(10, n // 5)
    if lags < 1 or rms(left) <= ROUND_OFF * rms(values):
        return 1.0
    from scipy.special import gammaincc

    centred = left - left.mean()
    squares = np.array([float(centred[lag:] @ centred[: n - lag]) ** 2 for lag in range(lags + 1)])
    weights = n * (n + 2) / (n - np.arange(1, lags + 1))
    return float(gammaincc(0.5 * lags, 0.5 * float(weights @ squares[1:]) / squares[0]))
