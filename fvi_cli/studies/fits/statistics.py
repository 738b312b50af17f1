"""What the residuals of a fit say: errors, a criterion to compare models, a test for noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import Evaluation, rms

SINGULAR = 1e-9
"""Of the scaled derivatives: below it some parameters can be traded for others."""
ROUND_OFF = 1e-9
"""Of the data: what is left below it is no noise of theirs, and nothing is said of it."""


def covariance(at: Evaluation, variance: float) -> tuple[Array, Array, bool]:
    """Correlations and standard errors of what the fit works with, and whether there are any."""
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


def criterion(
    left: Sequence[Array], deviations: Sequence[float], p: int, *, is_known: bool
) -> float:
    """AICc of normal noise; deviations that are estimated count as parameters."""
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
