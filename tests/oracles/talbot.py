r"""Linear responses by numerical inversion of their Laplace transforms, in many digits.

.. math:: Z(s) X(s) = M (s x_0 + v_0) + (\text{initial data of the memory}) + F(s), \qquad
          Z(s) = s^2 M + K + \sum_j C_j s^{\gamma_j} + \sum_i A_i G_i(s)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import mpmath
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Transform = Callable[[Any], Any]
"""A function of a complex number of mpmath."""

LEAST_DEGREE = 120
NODES_PER_RADIAN = 2.5
"""At so many nodes for every unit of t |s| the contour passes round a pole s by far."""


@dataclass(frozen=True)
class Law:
    """A force A (G0 x + a kernel * x') that has relaxed before t = 0, by its modulus G(s)."""

    modulus: Transform
    relaxed: float
    matrix: ArrayLike = 1.0


@dataclass(frozen=True)
class Load:
    """A force `vector` f(t - start) for t > start; no pole of `transform` is beyond `frequency`."""

    transform: Transform
    vector: ArrayLike = 1.0
    start: float = 0.0
    frequency: float = 0.0


def zener(
    order: float, time: float, relaxed: float, unrelaxed: float, matrix: ArrayLike = 1.0
) -> Law:
    r""":math:`G_0 + (G_\infty - G_0) (s\tau)^a / (1 + (s\tau)^a)`."""

    def modulus(s: Any) -> Any:
        power = (s * time) ** mpmath.mpf(order)
        return relaxed + (mpmath.mpf(unrelaxed) - relaxed) * power / (1 + power)

    return Law(modulus, relaxed, matrix)


def maxwell(order: float, time: float, modulus: float, matrix: ArrayLike = 1.0) -> Law:
    r""":math:`G (s\tau)^a / (1 + (s\tau)^a)`."""
    return zener(order, time, 0.0, modulus, matrix)


def prony(
    moduli: Sequence[float], times: Sequence[float], relaxed: float = 0.0, matrix: ArrayLike = 1.0
) -> Law:
    r""":math:`G_0 + \sum_i g_i s \tau_i / (1 + s \tau_i)`."""

    def modulus(s: Any) -> Any:
        parts = (g * s * tau / (1 + s * tau) for g, tau in zip(moduli, times, strict=True))
        return relaxed + sum(parts, mpmath.mpf(0))

    return Law(modulus, relaxed, matrix)


def step(vector: ArrayLike = 1.0, start: float = 0.0) -> Load:
    """A force that is constant from `start` on."""
    return Load(lambda s: 1 / s, vector, start)


def sine(frequency: float, vector: ArrayLike = 1.0, start: float = 0.0) -> Load:
    r""":math:`\sin(\omega (t - t_0))`."""
    w = mpmath.mpf(frequency)
    return Load(lambda s: w / (s * s + w * w), vector, start, frequency)


def power(exponent: float, vector: ArrayLike = 1.0, start: float = 0.0) -> Load:
    """A power of t above -1."""
    p = mpmath.mpf(exponent)
    return Load(lambda s: mpmath.gamma(p + 1) / s ** (p + 1), vector, start)


def linear_response(
    mass: ArrayLike,
    stiffness: ArrayLike,
    terms: Sequence[tuple[float, ArrayLike]],
    x0: ArrayLike,
    v0: ArrayLike,
    times: Sequence[float],
    *,
    laws: Sequence[Law] = (),
    loads: Sequence[Load] = (),
    derivative: str = "caputo",
    largest_frequency: float | None = None,
    degree: int = LEAST_DEGREE,
) -> tuple[Array, Array]:
    r"""Compute positions and velocities at times > 0, each of shape ``(n, d)``.

    Parameters
    ----------
    mass, stiffness
        M and K, numbers or shape ``(d, d)``.
    terms
        Pairs of order in (0, 2) and C.
    laws, loads
        Beside them; matrices and vectors likewise.
    largest_frequency
        No root of det Z has a larger imaginary part; as default a bound of their size.
    degree
        Least number of nodes of the contour, and of digits.
    """
    x, v = (np.atleast_1d(np.array(value, dtype=float)) for value in (x0, v0))
    d = x.size
    fractional = [(float(order), _matrix(value, d)) for order, value in terms]
    m, k = _matrix(mass, d), _matrix(stiffness, d)
    bound = largest_frequency
    if bound is None:
        bound = _largest_root(m, k, fractional, laws)

    exact_m, exact_k = _exact(m), _exact(k)
    exact_x, exact_v = _exact(x[:, None]), _exact(v[:, None])
    springpots = [(mpmath.mpf(order), _exact(matrix)) for order, matrix in fractional]
    places = [(law, _exact(_matrix(law.matrix, d))) for law in laws]

    def dynamic(s: Any) -> Any:
        total = exact_m * (s * s) + exact_k
        for order, matrix in springpots:
            total += matrix * s**order
        for law, matrix in places:
            total += matrix * law.modulus(s)
        return total

    def free(s: Any) -> Any:
        load = exact_m * (exact_x * s + exact_v)
        if derivative == "caputo":
            for order, matrix in springpots:
                data = exact_x * s ** (order - 1)
                if order > 1:
                    data += exact_v * s ** (order - 2)
                load += matrix * data
        for law, matrix in places:
            load += matrix * exact_x * ((law.modulus(s) - law.relaxed) / s)
        return load

    found = np.zeros((2, len(times), d))
    for n, time in enumerate(times):
        if np.any(x) or np.any(v):
            found[:, n] += _invert(dynamic, free, float(time), bound, degree, x)
        for each in loads:
            since = float(time) - each.start
            if since > 0:
                size = max(bound, each.frequency)
                found[:, n] += _invert(dynamic, _forced(each, d), since, size, degree, np.zeros(d))
    return found[0], found[1]


def _forced(load: Load, d: int) -> Transform:
    vector = np.broadcast_to(np.asarray(load.vector, dtype=float), (d,))[:, None]
    exact = _exact(vector)
    return lambda s: exact * load.transform(s)


def _invert(
    dynamic: Transform, load: Transform, time: float, bound: float, degree: int, start: Array
) -> Array:
    """Position and velocity at a time by the fixed contour of Talbot, shape ``(2, d)``."""
    nodes = degree + math.ceil(NODES_PER_RADIAN * bound * time)
    with mpmath.workdps(nodes):
        total = mpmath.zeros(start.size, 2)
        radius = 2 * mpmath.mpf(nodes) / (5 * mpmath.mpf(time))
        for angle_node, weight in _contour(nodes):
            s = radius * angle_node
            transform = mpmath.lu_solve(dynamic(s), load(s))
            for i, value in enumerate(transform):
                total[i, 0] += (weight * value).real
                total[i, 1] += (weight * (s * value - mpmath.mpf(float(start[i])))).real
        total *= radius / nodes
        return np.array(total.tolist(), dtype=float).T


@cache
def _contour(nodes: int) -> list[tuple[Any, Any]]:
    """Nodes s / r and weights exp(s t) (1 + i sigma), for r t = 2 M / 5.

    J. Abate, P.P. Valko, Int. J. Numer. Meth. Engng 60 (2004), section 4.
    """
    reach = 2 * mpmath.mpf(nodes) / 5
    found = [(mpmath.mpc(1), mpmath.exp(reach) / 2)]
    for k in range(1, nodes):
        angle = k * mpmath.pi / nodes
        cotangent = mpmath.cot(angle)
        node = angle * mpmath.mpc(cotangent, 1)
        slope = mpmath.mpc(1, angle + (angle * cotangent - 1) * cotangent)
        found.append((node, mpmath.exp(reach * node) * slope))
    return found


def _largest_root(
    m: Array, k: Array, terms: Sequence[tuple[float, Array]], laws: Sequence[Law]
) -> float:
    """A size beyond which the mass outweighs everything else."""
    least = np.linalg.svd(m, compute_uv=False)[-1]
    sizes = [(order, np.linalg.norm(matrix, 2)) for order, matrix in terms]
    radius = 1e-12
    while True:
        others = np.linalg.norm(k, 2) + sum(size * radius**order for order, size in sizes)
        for law in laws:
            modulus = abs(complex(law.modulus(mpmath.mpf(radius))))
            others += modulus * np.linalg.norm(_matrix(law.matrix, len(m)), 2)
        if least * radius**2 > others:
            return radius
        radius *= 1.1


def _matrix(value: ArrayLike, d: int) -> Array:
    found = np.asarray(value, dtype=float)
    return found * np.eye(d) if found.ndim == 0 else found


def _exact(values: Array) -> Any:
    return mpmath.matrix(values.tolist())
