"""Discrete fractional derivatives and integrals of a whole sequence, from its past.

Sign convention: the exponent e is the order of *differentiation*. ``e > 0`` differentiates,
``e < 0`` integrates, ``e = 0`` does nothing. In the literature on convolution quadrature the same
operator of order e > 0 is often written ``J^{-e}``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import convolution_weights

# Up to this length the plain sum is as quick as the transform and rounds less.
_LONGEST_DIRECT_SUM = 1024


def left_operator(bdf_order: int, exponent: float, step_size: float, values: ArrayLike) -> Array:
    """The retarded operator, which acts on the past, of values ``(N + 1,)`` or ``(N + 1, d)``.

    ``(J_- X)_k = h**-e sum_{n=0..k} w_n X_{k-n}`` with ``sum_n w_n z^n = gamma_p(z)**e``: for
    e in (0, 2] the left Riemann-Liouville derivative of order e at ``t_k = k h``, for e in (-2, 0)
    the integral of order -e; in units of `values` times time to the power -e. Operators of one
    formula and one step obey ``J^a J^b = J^(a+b)`` exactly, as their symbols are powers of one
    series (Lubich, *Discretized fractional calculus*, SIAM J. Math. Anal. 17, 1986; Hariz Belgacem,
    Jimenez, Ober-Bloebaum, arXiv 2403.18362).
    """
    samples = np.asarray(values, dtype=np.float64)
    n_samples = samples.shape[0]
    weights = convolution_weights(bdf_order, exponent, n_samples)
    # A stencil of finite length (integer exponent) is short however long the sequence is.
    support = int(np.flatnonzero(weights)[-1]) + 1
    columns = samples.reshape(n_samples, -1)
    if support * n_samples <= _LONGEST_DIRECT_SUM**2:
        convolved = np.empty_like(columns)
        for column in range(columns.shape[1]):
            convolved[:, column] = np.convolve(columns[:, column], weights[:support])[:n_samples]
    else:
        # SciPy's transforms bring its special functions with them
        from scipy import fft

        length = fft.next_fast_len(2 * n_samples - 1, real=True)
        transform = fft.rfft(weights, length)[:, None] * fft.rfft(columns, length, axis=0)
        convolved = fft.irfft(transform, length, axis=0)[:n_samples]
    return np.asarray(step_size**-exponent * convolved.reshape(samples.shape), dtype=np.float64)
