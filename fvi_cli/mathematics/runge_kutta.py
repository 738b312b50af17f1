"""Powers of the matrices of Runge-Kutta methods for convolution quadrature."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.mathematics.arrays import Array

# the trapezoidal rule errs by exp(-48) for eigenvalues of size 1/70 to 1 within 75 degrees of
# the positive axis
_FIRST, _LAST, _WIDTH = -1.0, 6.0, 0.25
_FAR = 300.0  # logarithm of x beyond which the resolvent is at its limit


def matrix_power(matrix: Array, exponent: float) -> Array:
    r"""The power :math:`B^\theta` of a matrix whose symmetric part has no negative eigenvalue.

    :math:`B^{-s} = \frac{\sin \pi s}{\pi} \int_0^\infty x^{s - 1} (1 + x B)^{-1} dx`, 0 < s < 1,
    and a factor B more where the exponent is positive. Eigenvectors, which lose digits, are not
    used.

    B is ``(m, m)``, its eigenvalues of size 1/70 to 1 and within 75 degrees of the positive axis,
    as those of Gauss and Lobatto IIIC methods; exponents lie in (-1, 1).
    """
    unit = np.eye(matrix.shape[0])
    if exponent == 0:
        return unit
    # s and 1 - s, neither of them rounded
    s, rest = (-exponent, 1 + exponent) if exponent < 0 else (1 - exponent, exponent)
    end = math.log(45.0 / min(s, rest)) + 0.5
    u = np.arange(_FIRST - end, _LAST + end, _WIDTH)
    left, right = np.exp(_FIRST - u), np.exp(u - _LAST)
    logs = u - left + right
    # far out the resolvent is at its limit, the power of x is not
    near = np.clip(logs, -_FAR, _FAR)
    resolvents = np.linalg.inv(np.exp(-near)[:, None, None] * unit + matrix)
    powers = np.exp(np.where(logs < 0, s * logs - near, -rest * logs)) * (1 + left + right)
    sine = math.sin(math.pi * min(s, rest))
    power = np.tensordot(powers, resolvents, axes=1) * (_WIDTH * sine / math.pi)
    return np.asarray(power if exponent < 0 else matrix @ power)
