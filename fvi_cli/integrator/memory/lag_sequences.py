r"""Lower block-triangular Toeplitz matrices by their first block column.

A *lag sequence* ``(..., B, a, b)`` is the first block column of such a matrix ``(..., B a, B b)``;
that of fewer steps is a leading slice of it.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fvi_cli.mathematics.arrays import Array


def expand(lags: Array) -> Array:
    """The whole matrix ``(..., B a, B b)`` of a lag sequence ``(..., B, a, b)``."""
    *lead, n, a, b = lags.shape
    if n == 1:
        return np.asarray(lags[..., 0, :, :])
    padded = np.zeros((*lead, 2 * n - 1, a, b))
    padded[..., n - 1 :, :, :] = lags
    window = sliding_window_view(padded, n, axis=-3)[..., ::-1]
    whole = np.ascontiguousarray(np.moveaxis(window, -1, -2))
    return np.asarray(whole.reshape(*lead, n * a, n * b))


def constant_lags(first: Array, later: Array, count: int) -> Array:
    """Lag sequence with one matrix on the diagonal and another one everywhere below."""
    found = np.repeat(np.asarray(later, dtype=float)[None], count, axis=0)
    found[0] = first
    return found
