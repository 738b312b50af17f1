"""Statistics of residuals: errors, a criterion to compare models, a test for noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import Evaluation

SINGULAR = 1e-9
"""Singular values of the scaled derivatives below this: some parameters cannot be separated."""
ROUND_OFF = 1e-9
"""Residuals below this share of the data are round-off, not noise, and are not tested."""


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def covariance(at: Evaluation, variance: float) -> tuple[Array, Array, bool]:
    """Correlations and standard errors of inner parameters; and whether they are determined."""
    sizes, _, singular, right = _factors(at)
    if not np.all(sizes > 0):
        return np.eye(sizes.size), np.full(sizes.size, math.inf), False
    found = (right.T / np.maximum(singular, 1e-300) ** 2) @ right
    errors = np.sqrt(np.diag(found))
    correlations = found / np.outer(errors, errors)
    return correlations, math.sqrt(variance) * errors / sizes, bool(singular[-1] > SINGULAR)


def _factors(at: Evaluation) -> tuple[Array, Array, Array, Array]:
    """Sizes of the derivatives, and the singular values and vectors of those of size 1."""
    sizes = np.linalg.norm(at.jacobian, axis=0)
    scaled = at.jacobian / np.where(sizes > 0, sizes, 1.0)
    return sizes, *np.linalg.svd(scaled, full_matrices=False)


def _basis(at: Evaluation) -> tuple[Array, Array]:
    """An orthonormal basis of the derivatives ``(n, r)``, and the map back to parameters."""
    sizes, left, singular, right = _factors(at)
    kept = singular > SINGULAR * singular.max(initial=0.0)
    back = (right[kept].T / singular[kept]) / np.maximum(sizes, 1e-300)[:, None]
    return left[:, kept], back


def series_freedoms(at: Evaluation, sizes: Sequence[int]) -> Array:
    r"""Degrees of freedom of the residuals of every series, ``(n_series,)``.

    With H the matrix that projects data onto the motions that the parameters make, and n_c values
    in series c, these are :math:`n_c - \mathrm{tr} H_{cc}` (Patterson and Thompson, *Recovery of
    inter-block information*, 1971: the variance of every series by restricted likelihood).
    """
    parts = np.split(_basis(at)[0], np.cumsum(sizes)[:-1])
    used = np.array([float(np.sum(part**2)) for part in parts])
    return np.asarray(np.maximum(np.array(sizes) - used, 0.0))


def freedoms(at: Evaluation, sizes: Sequence[int]) -> Array:
    """Degrees of freedom with which the error of every parameter is known, ``(p,)``.

    The variance of an estimate is a weighted sum of the variances of the series (Satterthwaite, *An
    approximate distribution of estimates of variance components*, 1946).
    """
    own = np.maximum(series_freedoms(at, sizes), 1e-3)
    left, inverse = _basis(at)
    rows = np.split(inverse @ left.T, np.cumsum(sizes)[:-1], axis=1)
    shares = np.array([np.sum(part**2, axis=1) for part in rows])
    shares /= np.maximum(shares.sum(axis=0), 1e-300)
    return np.asarray(1.0 / np.maximum(np.sum(shares**2 / own[:, None], axis=0), 1e-300))


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
    if lags < 1 or rms(left) <= ROUND_OFF * max(rms(values), 1e-300):
        return 1.0
    from scipy.special import gammaincc

    centred = left - left.mean()
    squares = np.array([float(centred[lag:] @ centred[: n - lag]) ** 2 for lag in range(lags + 1)])
    weights = n * (n + 2) / (n - np.arange(1, lags + 1))
    return float(gammaincc(0.5 * lags, 0.5 * float(weights @ squares[1:]) / squares[0]))
