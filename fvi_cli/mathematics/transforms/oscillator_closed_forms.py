r"""Closed forms of linear responses: classical damping, and orders 1/2 and 3/2.

As in :mod:`fvi_cli.mathematics.transforms.fractional_oscillator`, a response is the inverse Laplace
transform of :math:`N(s)/P(s)`. Every closed form here is a sum whose terms may be larger than the
sum; their size is returned beside it, so that the caller can tell what rounding did.

References
----------
J.L. González-Santander, A. Apelblat, arXiv 2501.05972, for partial fractions in
:math:`\sqrt s` and the Faddeeva function; K.S. Miller, B. Ross, *An Introduction to the Fractional
Calculus and Fractional Differential Equations* (Wiley, 1993).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.transforms.characteristic import CharacteristicFunction

Array = NDArray[np.float64]
LongComplexArray = NDArray[np.clongdouble]
LongArray = NDArray[np.longdouble]
Coefficients = dict[int, np.longdouble]


def classical_response(
    characteristic: CharacteristicFunction, numerator: Mapping[float, float], time: Array
) -> tuple[Array, Array] | None:
    r"""Response of :math:`m x'' + c x' + k x = f` in elementary functions.

    With :math:`a = c/2m` and :math:`d = k/m - a^2` it is a polynomial plus
    :math:`e^{-at}` times cosine and sine of :math:`\sqrt d\,t` (hyperbolic for negative d, a power
    of t at d = 0), written so that it neither overflows nor cancels near d = 0.

    Parameters
    ----------
    characteristic
        P; every damping order must be 1.
    numerator
        N: powers of s (integers up to 1) to coefficients.
    time
        Times >= 0, any shape.

    Returns
    -------
    tuple[Array, Array] | None
        The response and the sum of the moduli of its terms; None if the orders or powers are not
        integers.
    """
    denominator = _integer_powers(dict(characteristic.terms), 1)
    top = _integer_powers(numerator, 1)
    if denominator is None or top is None:
        return None
    top, denominator = _without_zero(top, denominator)
    polar, rest = _divided(top, denominator)
    t: LongArray = np.asarray(time, dtype=np.longdouble)
    parts = [_power(c, t, j - 1.0) for j, c in polar.items()]
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        if max(denominator) == 2:
            parts.extend(_quadratic(denominator, top, rest, t))
        elif max(denominator) == 1:
            rate = denominator[0] / denominator[1]
            parts.append(rest.get(0, np.longdouble(0)) / denominator[1] * np.exp(-rate * t))
        return _summed(parts, t)


def faddeeva_response(
    characteristic: CharacteristicFunction, numerator: Mapping[float, float], time: Array
) -> tuple[Array, Array] | None:
    r"""Response for damping orders among 1/2, 1, 3/2, by partial fractions in :math:`\sqrt s`.

    With the simple roots r_i of the quartic :math:`Q(z) = P(z^2)` and
    :math:`c_i = N(r_i^2)/Q'(r_i)`,

    .. math:: x(t) = \sum_i c_i r_i\,w(-i r_i \sqrt t) + \sum_{j\ge 2} p_j t^{j/2-1}/\Gamma(j/2)

    where w is Faddeeva's function and :math:`p_j z^{-j}` the polar part at z = 0.

    Parameters
    ----------
    characteristic
        P; twice every damping order must be an integer.
    numerator
        N: powers of s (multiples of 1/2 up to 1) to coefficients.
    time
        Times >= 0, any shape.

    Returns
    -------
    tuple[Array, Array] | None
        The response and the sum of the moduli of its terms, which is large near multiple roots;
        None if the powers do not fit or roots coincide.
    """
    from scipy.special import wofz

    denominator = _integer_powers(dict(characteristic.terms), 2)
    top = _integer_powers(numerator, 2)
    if denominator is None or top is None:
        return None
    top, denominator = _without_zero(top, denominator)
    polar, _ = _divided(top, denominator)
    roots = _roots(denominator)
    slopes = _polynomial({j - 1: j * c for j, c in denominator.items() if j}, roots)
    if np.any(slopes == 0):
        return None
    t: LongArray = np.asarray(time, dtype=np.longdouble)
    parts: list[LongArray | LongComplexArray] = []
    parts.extend(_power(c, t, j / 2 - 1.0) for j, c in polar.items() if j > 1)
    # Not the remainder of the division, in which the slow roots' large coefficients cancel.
    weights = _polynomial(top, roots) / slopes * roots
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        for root, weight in zip(roots, weights, strict=True):
            side = -1.0 if root.real > 0 else 1.0
            argument = -1j * side * root * np.sqrt(t)
            values = side * wofz(argument.astype(complex)).astype(np.clongdouble)
            if side < 0:
                # w(z) = 2 exp(-z^2) - w(-z): long phases deserve more than double precision.
                values = values + 2.0 * np.exp(root * root * t)
            parts.append(weight * values)
        return _summed(parts, t)


def _power(coefficient: np.longdouble, t: LongArray, exponent: float) -> LongArray:
    """Transform of coefficient times s^(-exponent - 1)."""
    return np.asarray(
        coefficient * t ** np.longdouble(exponent) / math.gamma(exponent + 1.0),
        dtype=np.longdouble,
    )


def _integer_powers(terms: Mapping[float, float], multiple: int) -> Coefficients | None:
    result: Coefficients = {}
    for power, coefficient in terms.items():
        index = multiple * power
        if index != round(index):
            return None
        result[round(index)] = np.longdouble(coefficient)
    return result


def _without_zero(top: Coefficients, bottom: Coefficients) -> tuple[Coefficients, Coefficients]:
    """Both divided by the power of the variable that the denominator contains."""
    lowest = min(bottom)
    return (
        {power - lowest: c for power, c in top.items() if c},
        {power - lowest: c for power, c in bottom.items()},
    )


def _divided(top: Coefficients, bottom: Coefficients) -> tuple[Coefficients, Coefficients]:
    """Polar part {j: coefficient of z^-j} at z = 0, and the numerator that remains."""
    rest = dict(top)
    polar: Coefficients = {}
    for power in range(min(rest, default=0), 0):
        coefficient = rest.pop(power, np.longdouble(0)) / bottom[0]
        if coefficient:
            polar[-power] = coefficient
            for other, c in bottom.items():
                if other:
                    rest[power + other] = (
                        rest.get(power + other, np.longdouble(0)) - coefficient * c
                    )
    return polar, rest


def _quadratic(
    denominator: Coefficients, top: Coefficients, rest: Coefficients, t: LongArray
) -> list[LongArray]:
    zero = np.longdouble(0)
    m = denominator[2]
    a = denominator.get(1, zero) / (2 * m)
    product = denominator[0] / m
    d = product - a * a
    if abs(d) > 0.01 * a * a:
        root = np.sqrt(np.clongdouble(-d))
        large = -a - root if a > 0 else -a + root
        pair = np.array([large, product / large])
        weights = _polynomial(top, pair) / (2 * m * (pair + a))
        return [np.asarray((w * np.exp(r * t)).real) for w, r in zip(weights, pair, strict=True)]
    # Nearly equal roots: one formula across d = 0.
    if d > 0:
        root = np.sqrt(d)
        cosine = np.exp(-a * t) * np.cos(root * t)
        sine = np.exp(-a * t) * np.sin(root * t) / root
    elif d == 0:
        cosine = np.exp(-a * t)
        sine = t * cosine
    else:
        root = np.sqrt(-d)
        cosine = np.exp((root - a) * t) * (1 + np.exp(-2 * root * t)) / 2
        sine = -np.exp((root - a) * t) * np.expm1(-2 * root * t) / (2 * root)
    first = rest.get(1, zero) / m
    return [first * cosine, (rest.get(0, zero) / m - a * first) * sine]


def _roots(coefficients: Coefficients) -> LongComplexArray:
    degree = max(coefficients)
    if degree == 0:
        return np.zeros(0, dtype=np.clongdouble)
    dense = [float(coefficients.get(power, 0.0)) for power in range(degree, -1, -1)]
    roots = np.roots(dense).astype(np.clongdouble)
    slope = {power - 1: power * c for power, c in coefficients.items() if power}
    for _ in range(4):
        derivative = _polynomial(slope, roots)
        roots = roots - _polynomial(coefficients, roots) / np.where(derivative == 0, 1, derivative)
    return roots


def _polynomial(coefficients: Coefficients, z: LongComplexArray) -> LongComplexArray:
    """Sum of powers, negative ones too."""
    lowest = min(coefficients, default=0)
    total = np.zeros(z.shape, dtype=np.clongdouble)
    for power in range(max(coefficients, default=0), lowest - 1, -1):
        total = total * z + coefficients.get(power, np.longdouble(0))
    return total * z**lowest


def _summed(parts: Sequence[LongArray | LongComplexArray], t: LongArray) -> tuple[Array, Array]:
    total = np.zeros(t.shape, dtype=np.longdouble)
    size = np.zeros(t.shape, dtype=np.longdouble)
    for part in parts:
        total = total + part.real
        size = size + np.abs(part)
    return total.astype(float), size.astype(float)
