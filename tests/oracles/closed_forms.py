"""Responses in closed form."""

from __future__ import annotations

import mpmath
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm
from scipy.special import wofz

Array = NDArray[np.float64]


def half_order_response(
    order: float,
    times: ArrayLike,
    *,
    mass: float = 1.0,
    coefficient: float = 1.0,
    stiffness: float = 1.0,
    x0: float = 0.0,
    v0: float = 0.0,
    step: float = 0.0,
) -> tuple[Array, Array]:
    r"""Compute x and x' of :math:`m x'' + \mu D^\gamma x + k x = f`, Caputo, order 1/2 or 3/2.

    With :math:`z = \sqrt{s}`, :math:`z X(z) = \sum_i A_i / (z - r_i)` over the roots of
    :math:`m z^4 + \mu z^{2\gamma} + k`, and :math:`x(t) = \sum_i A_i w(-i r_i \sqrt{t})`, w the
    function of Faddeeva (J.L. Gonzalez-Santander, A. Apelblat, arXiv 2501.05972).
    """
    if order not in (0.5, 1.5):
        raise ValueError(f"order: {order!r} is not 1/2 or 3/2")
    polynomial = np.zeros(5)
    polynomial[[0, 4]] = mass, stiffness
    polynomial[4 - round(2 * order)] += coefficient
    data = np.array([mass * x0, 0.0, mass * v0, 0.0])
    data += coefficient * (
        np.array([0.0, 0.0, 0.0, x0]) if order == 0.5 else np.array([0.0, x0, 0.0, v0])
    )
    numerator = np.append(data, step)
    denominator = np.append(polynomial, 0.0)
    roots = np.append(np.roots(polynomial), 0.0)
    weights = np.polyval(numerator, roots) / np.polyval(np.polyder(denominator), roots)
    # with weights at a root 0 that is not simple the sum is not the response
    if stiffness == 0:
        raise ValueError("stiffness: 0 makes a double root")
    waves = wofz(-1j * np.multiply.outer(np.sqrt(np.asarray(times, dtype=float)), roots))
    return (waves @ weights).real, (waves @ (weights * roots**2)).real


def mittag_leffler(a: float, b: float, argument: float) -> float:
    r""":math:`E_{a,b}(z) = \sum_k z^k / \Gamma(a k + b)`, with as many digits as it cancels."""
    size = abs(argument) ** (1 / a)
    with mpmath.workdps(int(30 + 0.9 * size)):
        z, total, k = mpmath.mpf(argument), mpmath.mpf(0), 0
        while True:
            term = z**k * mpmath.rgamma(mpmath.mpf(a) * k + b)
            total += term
            k += 1
            if a * k > size + 2 and abs(term) < mpmath.mpf(10) ** (-mpmath.mp.dps):
                return float(total)


def free_flight(
    order: float, times: ArrayLike, *, mass: float, coefficient: float, v0: float
) -> tuple[Array, Array]:
    r"""Compute x and x' of :math:`m x'' + \mu D^\gamma x = 0` from x = 0 (Riemann-Liouville).

    :math:`x = v_0 t E_{2-\gamma, 2}(-\mu t^{2-\gamma} / m)`, and with the index 1 the velocity.
    """
    t = np.atleast_1d(np.asarray(times, dtype=float))
    arguments = -coefficient / mass * t ** (2 - order)
    x, v = ([mittag_leffler(2 - order, b, z) for z in arguments.tolist()] for b in (2.0, 1.0))
    return v0 * t * np.array(x), v0 * np.array(v)


def classical_response(
    mass: ArrayLike,
    damping: ArrayLike,
    stiffness: ArrayLike,
    x0: ArrayLike,
    v0: ArrayLike,
    times: ArrayLike,
) -> tuple[Array, Array]:
    """Compute x and x', shape ``(n, d)``, of M x'' + C x' + K x = 0 by the exponential."""
    m, c, k = (
        np.atleast_2d(np.asarray(value, dtype=float)) for value in (mass, damping, stiffness)
    )
    start = np.concatenate([np.atleast_1d(x0), np.atleast_1d(v0)]).astype(float)
    d = len(m)
    upper = np.concatenate([np.zeros((d, d)), np.eye(d)], axis=1)
    lower = -np.linalg.solve(m, np.concatenate([k, c], axis=1))
    generator = np.concatenate([upper, lower])
    found = np.array([expm(t * generator) @ start for t in np.atleast_1d(np.asarray(times))])
    return found[:, :d], found[:, d:]
