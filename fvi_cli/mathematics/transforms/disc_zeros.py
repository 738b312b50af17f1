r"""Zeros of an analytic function in a disc: how many, and where.

The function f is analytic in the open unit disc, real on the real axis, and given by its
logarithm, because determinants overflow. Zeros are counted by the argument principle on a circle
around 0 (Henrici, *Applied and Computational Complex Analysis* 1, section 4.10) and found by
Newton's iteration with mutual repulsion (O. Aberth, Math. Comp. 27, 1973, 339-344), which has
found all of them when it has found as many as were counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.transforms.argument import (
    Followed,
    LogFunction,
    PathError,
    follow,
    principal_changes,
)

USUAL_DEGREE = 8
"""Zeros of the determinant of a few unknowns."""

LARGEST_COUNT = 64
"""More zeros than these are not looked for one by one."""

_FIRST_RATIO = 1.35
_ITERATIONS = 60
_ACCURACY = 1e-9


class ZeroCountError(ValueError):
    """The zeros in a disc could not be counted: one of them lies on the circle itself."""


def _half_circle(log_function: LogFunction, radius: float, degree: int) -> Followed:
    """Values on the upper half circle."""
    if not 0 < radius < 1:
        raise ValueError(f"radius: {radius!r} is not allowed; it must lie in (0, 1)")
    try:
        found = follow(
            log_function,
            lambda angles: circle_points(radius, angles),
            circle_angles(radius, degree),
        )
    except PathError:
        found = None
    if found is None or round(found.turn / math.pi) < 0:
        raise ZeroCountError(f"radius: a zero lies on the circle of radius {radius!r}")
    return found


def circle_angles(radius: float, degree: int) -> Array:
    r"""Angles in :math:`[0, \pi]` to begin with, closer to each other at both ends."""
    least = min(max(1.0 - radius, 1e-12), 0.3)
    number = math.ceil(math.log(math.pi / 2 / least) / math.log(_FIRST_RATIO)) + 2
    rising = np.geomspace(least / 2, math.pi / 2, number)
    even = np.linspace(0.0, math.pi, 2 * degree)
    return np.unique(np.concatenate([even, rising, math.pi - rising[:-1]]))


def circle_points(radius: float, angles: Array) -> ComplexArray:
    """The points of the circle at these angles."""
    points = np.asarray(radius * np.exp(1j * angles), dtype=np.complex128)
    # exactly real at the ends, where f is real
    points[angles == 0.0] = radius
    points[angles == math.pi] = -radius
    return points


def find_zeros(
    log_function: LogFunction, radius: float, degree: int = USUAL_DEGREE
) -> ComplexArray | None:
    r"""All zeros in :math:`|z| < \rho`, smallest modulus first; None where that fails.

    Raises
    ------
    ZeroCountError
        If a zero lies on the circle to round-off.
    """
    return zeros_in_disc(log_function, radius, degree).zeros


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscZeros:
    """The zeros in a disc.

    Parameters
    ----------
    count
        How many there are, each as often as its multiplicity.
    zeros
        Where they are, smallest modulus first; None where they could not be told apart.
    """

    count: int
    zeros: ComplexArray | None


def zeros_in_disc(
    log_function: LogFunction, radius: float, degree: int = USUAL_DEGREE
) -> DiscZeros:
    """Number and places of the zeros in a disc, from one circle of values.

    Parameters
    ----------
    log_function
        Any branch of log f at an array of points, minus infinity at a zero.
    radius
        The radius, in (0, 1).
    degree
        About how many zeros there are, in and around the disc.

    Raises
    ------
    ZeroCountError
        If a zero lies on the circle to round-off.
    ValueError
        For a radius outside (0, 1).
    """
    circle = _half_circle(log_function, radius, degree)
    count = round(circle.turn / math.pi)
    if count == 0:
        return DiscZeros(count=0, zeros=np.empty(0, dtype=np.complex128))
    if count > LARGEST_COUNT:
        return DiscZeros(count=count, zeros=None)
    z = _repelled(log_function, _seeds(circle.points, circle.values, count), radius)
    if not _are_all(log_function, z, radius):
        return DiscZeros(count=count, zeros=None)
    return DiscZeros(count=count, zeros=np.asarray(z[np.argsort(np.abs(z))]))


def enclosed_zero_modulus(
    log_function: LogFunction, radius: float, degree: int = USUAL_DEGREE
) -> float:
    r"""Modulus of the smallest of the zeros in :math:`|z| < \rho`, of which there is one at least.

    Certain, but slow: halves the gap between a circle without zeros and one with some.
    """
    high = -math.log(radius)
    low, high = high, high + 1.0
    while (inside := _zeros_inside(log_function, math.exp(-high), degree)) is None or inside.size:
        if inside is not None:
            return float(np.abs(inside[0]))
        low, high = high, 2 * high
        if high > 700:
            return 0.0
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        inside = _zeros_inside(log_function, math.exp(-middle), degree)
        if inside is None:
            low = middle
        elif inside.size:
            return float(np.abs(inside[0]))
        else:
            high = middle
    return math.exp(-low)


def _zeros_inside(log_function: LogFunction, radius: float, degree: int) -> ComplexArray | None:
    """Zeros in the disc; None where there are some, but which is not known."""
    try:
        return find_zeros(log_function, radius, degree)
    except ZeroCountError:
        return None


def _seeds(points: ComplexArray, values: ComplexArray, count: int) -> ComplexArray:
    r"""Zeros by their power sums :math:`\frac{1}{2 \pi i} \oint z^k \, d \log f`.

    L. M. Delves, J. N. Lyness, *A numerical method for locating the zeros of an analytic
    function*, Math. Comp. 21, 1967, 543-560.
    """
    radius = abs(points[0])
    scaled = points / radius
    powers = scaled ** np.arange(1, count + 1)[:, None]
    middle = 0.5 * (powers[:, 1:] + powers[:, :-1])
    sums = (middle @ principal_changes(values)).imag / math.pi
    # Newton's identities
    polynomial = np.zeros(count + 1)
    polynomial[0] = 1.0
    for k in range(1, count + 1):
        polynomial[k] = -(sums[:k] @ polynomial[k - 1 :: -1][:k]) / k
    z = np.roots(polynomial) * radius
    seeds = np.zeros(count, dtype=np.complex128)
    seeds[: z.size] = z
    # apart from each other, and inside
    seeds = seeds + 1e-9 * radius * np.exp(1j * np.arange(count))
    size = np.abs(seeds)
    return np.asarray(np.where(size < radius, seeds, seeds / np.maximum(size, 1e-300) * radius))


def _newton(log_function: LogFunction, z: ComplexArray) -> ComplexArray:
    """The correction f / f' from a difference of nearby values."""
    shift = 1e-6 * np.minimum(np.maximum(np.abs(z), 1e-3), np.abs(1.0 - z))
    values = log_function(np.concatenate([z, z + shift]))
    here, there = values[: z.size], values[z.size :]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        ratio = np.expm1(there - here)
        step = shift / np.where(ratio == 0, 1e-300, ratio)
    return np.asarray(np.where(np.isneginf(here.real), 0.0, np.nan_to_num(step)))


def _repelled(log_function: LogFunction, z: ComplexArray, radius: float) -> ComplexArray:
    for _ in range(_ITERATIONS):
        step = _newton(log_function, z)
        gaps = z[:, None] - z[None, :]
        np.fill_diagonal(gaps, np.inf)
        gaps = np.where(gaps == 0, 1e-14, gaps)
        repulsion = 1.0 - step * np.sum(1.0 / gaps, axis=1)
        step = step / np.where(repulsion == 0, 1.0, repulsion)
        # half way to the border of the disc of analyticity at the most
        room = 0.5 * np.maximum(np.abs(z), 0.1)
        size = np.abs(step)
        step = np.where(size > room, step * (room / np.maximum(size, 1e-300)), step)
        z = z - step
        away = np.abs(z) > 1.0 - 0.5 * (1.0 - radius)
        z = np.where(away, z / np.maximum(np.abs(z), 1e-300) * radius * 0.98, z)
        if np.all(np.abs(step) < 1e-12 * np.maximum(np.abs(z), 1e-3)) and not away.any():
            break
    return z


def _are_all(log_function: LogFunction, z: ComplexArray, radius: float) -> bool:
    """Whether every z is a zero in the disc and no two are the same one."""
    if np.any(np.abs(z) >= radius):
        return False
    if np.any(np.abs(_newton(log_function, z)) > _ACCURACY * np.abs(1.0 - z)):
        return False
    gaps = np.abs(z[:, None] - z[None, :])
    np.fill_diagonal(gaps, np.inf)
    return bool(gaps.min() > 1e-7 * np.abs(1.0 - z).min()) if z.size > 1 else True
