"""Statistics of residuals: errors, a criterion to compare models, a test for noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import Evaluation, rms

SINGULAR = 1e-9
"""Singular values of the scaled derivatives below this: some parameters cannot be separated."""
ROUND_OFF = 1e-9
"""Residuals below this share of the data are round-off, not noise, and are not tested."""


def covariance(at: Evaluation, variance: float) -> tuple[Array, Array, bool]:
    """Correlations and standard errors of inner parameters; and whether they are determined."""
    jacobian = np.zeros((1, 0)) if at.jacobian is None else at.jacobian
    sizes = np.linalg.norm(jacobian, axis=0)
    p = sizes.size
    if not np.all(sizes > 0):
        return np.eye(p), np.full(p, math.inf), False
    _, singular, right = np.linalg.svd(jacobian / sizes, full_matrices=False)
    least = np.maximum(singular, 1e-300)
    covariance = (right.T / least**2) @ right
    errors = np.sqrt(np.diag(covariance))
    correlations = covariance / np.outer(errors, errors)
    return correlations, math.sqrt(variance) * errors / sizes, bool(singular[-1] > SINGULAR)


def series_freedoms(at: Evaluation, sizes: Sequence[int]) -> Array:
    r"""Degrees of freedom of the residuals of every series, ``(n_series,)``.

    With H the matrix that projects data onto the motions that the parameters make, and n_c values
    in series c, these are :math:`n_c - \mathrm{tr} H_{cc}` (Patterson and Thompson, *Recovery of
    inter-block information*, 1971: the variance of every series by restricted likelihood).
    """
    left, _ = _factors(at)
    ends = np.cumsum(sizes)[:-1]
    used = [float(np.sum(part**2)) for part in np.split(left, ends)]
    return np.asarray(np.maximum(np.array(sizes, dtype=float) - np.array(used), 0.0))


def freedoms(at: Evaluation, sizes: Sequence[int]) -> Array:
    """Degrees of freedom with which the error of every parameter is known, ``(p,)``.

    The variance of an estimate is a weighted sum of the variances of the series (Satterthwaite, *An
    approximate distribution of estimates of variance components*, 1946).
    """
    own = np.maximum(series_freedoms(at, sizes), 1e-3)
    left, inverse = _factors(at)
    rows = np.split(inverse @ left.T, np.cumsum(sizes)[:-1], axis=1)
    shares = np.array([np.sum(part**2, axis=1) for part in rows])
    shares /= np.maximum(shares.sum(axis=0), 1e-300)
    return np.asarray(1.0 / np.sum(shares**2 / own[:, None], axis=0))


def _factors(at: Evaluation) -> tuple[Array, Array]:
    """An orthonormal basis of the scaled derivatives ``(n, r)``, and the map back to parameters."""
    jacobian = np.zeros((at.residuals.size, 0)) if at.jacobian is None else at.jacobian
    sizes = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    left, singular, right = np.linalg.svd(jacobian / sizes, full_matrices=False)
    kept = singular > SINGULAR * max([1e-300, *singular])
    return left[:, kept], (right[kept].T / singular[kept]) / sizes[:, None]


def criterion(
    left: Sequence[Array], deviations: Sequence[float], p: int, *, is_known: bool
) -> float:
    """AICc for normal noise; estimated deviations count as parameters."""
    n = sum(one.size for one in left)
    if is_known:
        k = p
        value = sum(
            float(np.sum((one / deviation) ** 2))
            for one, deviation in zip(left, deviations, strict=True)
        )
    else:
        k = p + len(left)
        value = sum(one.size * math.log(max(float(np.mean(one**2)), 1e-300)) for one in left)
    if n <= k + 1:
        return math.inf
    return value + 2.0 * k + 2.0 * k * (k + 1) / (n - k - 1)


def whiteness(left: Array, values: Array) -> float:
    """Probability that noise is as correlated in time as this (Ljung and Box, 1978)."""
    n = left.size
    lags = min(10, n // 5)
    if lags < 1 or rms(left) <= ROUND_OFF * max(rms(values), 1e-300):
        return 1.0
    from scipy.special import gammaincc

    centred = left - left.mean()
    total = float(centred @ centred)
    statistic = 0.0
    for lag in range(1, lags + 1):
        correlation = float(centred[lag:] @ centred[:-lag]) / total
        statistic += n * (n + 2) * correlation**2 / (n - lag)
    return float(gammaincc(0.5 * lags, 0.5 * statistic))
