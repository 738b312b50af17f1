"""A function along a motion, in pieces on each of which a polynomial stands for it.

On every piece (a step, or a part of one) the function is interpolated in Chebyshev points; where
the last coefficients have not decayed the piece is halved. The extremes of the polynomials are
found as eigenvalues; between two neighbours among them and the ends of the pieces the function is
monotone, so that a change of sign encloses exactly one root, and two roots in a step are two
changes (Boyd, *Solving Transcendental Equations*, SIAM 2014, sections 2 and 3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from fvi_cli.mathematics.arrays import Array, Places

Along = Callable[[Places, Array], Array]
"""Values at places of steps, shapes ``(n,)`` and ``(n,)`` to ``(n,)``."""

Columns = tuple[NDArray[np.generic], ...]

POINTS = 17
"""Chebyshev points of a piece."""
DECAY = 1e-9
"""Last coefficients of a piece that is not halved, relative to the largest."""
LEAST_HALVINGS, MOST_HALVINGS = 4, 7
AT_A_TIME = 2048
"""Steps that are worked out together."""
ROOT_SWEEPS = 80


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """Pieces of steps with the values of a function in their Chebyshev points.

    Parameters
    ----------
    step, begin, end
        Number of the step and places in it, shape ``(n,)``, in the order of time.
    values
        At the Chebyshev points of the second kind from `begin` to `end`, shape ``(n, POINTS)``.
    coefficients
        Of the Chebyshev polynomials, shape ``(n, POINTS)``.
    """

    step: Places
    begin: Array
    end: Array
    values: Array
    coefficients: Array


_NODES = -np.cos(np.pi * np.arange(POINTS) / (POINTS - 1))
TO_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_NODES, POINTS - 1)).T
_SLOPES = chebyshev.chebder(np.eye(POINTS), axis=0).T
_INTEGRALS = np.array([0.0 if k % 2 else 2.0 / (1.0 - k * k) for k in range(2 * POINTS)])
_DEGREES = np.arange(POINTS)
# integrals of products of two Chebyshev polynomials
_PRODUCTS = 0.5 * (
    _INTEGRALS[_DEGREES[:, None] + _DEGREES] + _INTEGRALS[np.abs(_DEGREES[:, None] - _DEGREES)]
)


def pieces_of(along: Along, n_steps: int, last_place: float = 1.0) -> Iterator[Pieces]:
    """The pieces of all steps, of the last one up to a place in it, some steps at a time."""
    for first in range(0, n_steps, AT_A_TIME):
        step = np.arange(first, min(first + AT_A_TIME, n_steps))
        begin, end = np.zeros(step.size), np.ones(step.size)
        if step[-1] == n_steps - 1:
            end[-1] = last_place
        done: list[Columns] = []
        before = step.size
        for depth in range(MOST_HALVINGS + 1):
            tau = places_in(begin, end)
            values = along(np.repeat(step, POINTS), tau.ravel()).reshape(tau.shape)
            coefficients = coefficients_of(values)
            size = np.abs(coefficients)
            rough = size[:, -2:].max(axis=1) > DECAY * size.max(axis=1)
            # where halving makes none smoother the function is round-off
            is_noise = depth >= LEAST_HALVINGS and int(rough.sum()) > 1.8 * before
            before = int(rough.sum())
            if depth == MOST_HALVINGS or is_noise:
                rough[:] = False
            smooth = ~rough
            done.append(
                (step[smooth], begin[smooth], end[smooth], values[smooth], coefficients[smooth])
            )
            if not rough.any():
                break
            step, begin, end = halve(step, begin, end, rough)
        yield join_in_order(done)


def places_in(begin: Array, end: Array) -> Array:
    """Chebyshev points of pieces, shape ``(n, POINTS)``."""
    tau = begin[:, None] + 0.5 * (_NODES + 1.0) * (end - begin)[:, None]
    tau[:, -1] = end
    return np.asarray(tau)


def coefficients_of(values: Array) -> Array:
    """Chebyshev coefficients of values, both of shape ``(n, POINTS)``."""
    # a single point without a value, such as t = 0, is no reason to halve
    return np.asarray(np.where(np.isfinite(values), values, 0.0) @ TO_COEFFICIENTS)


def halve(
    step: Places, begin: Array, end: Array, chosen: NDArray[np.bool_]
) -> tuple[Places, Array, Array]:
    """Both halves of the chosen pieces."""
    step, begin, end = step[chosen], begin[chosen], end[chosen]
    middle = 0.5 * (begin + end)
    return (
        np.repeat(step, 2),
        np.stack([begin, middle], axis=1).ravel(),
        np.stack([middle, end], axis=1).ravel(),
    )


def join_in_order(done: list[Columns]) -> Pieces:
    """Pieces from groups of their fields, in the order of time."""
    columns = [np.concatenate(one) for one in zip(*done, strict=True)]
    order = np.lexsort((columns[1], columns[0]))
    return Pieces(
        step=columns[0][order],
        begin=columns[1][order],
        end=columns[2][order],
        values=columns[3][order],
        coefficients=columns[4][order],
    )


def may_change_sign(found: Pieces) -> NDArray[np.bool_]:
    """Whether the polynomial of a piece may have a root."""
    size = np.abs(found.coefficients)
    return np.asarray(size[:, 1:].sum(axis=1) >= size[:, 0])


def may_exceed(found: Pieces, least: float, greatest: float) -> NDArray[np.bool_]:
    """Whether the polynomial of a piece may leave an interval."""
    middle, reach = found.coefficients[:, 0], np.abs(found.coefficients[:, 1:]).sum(axis=1)
    return np.asarray((middle + reach > greatest) | (middle - reach < least))


def stations(found: Pieces, wanted: NDArray[np.bool_]) -> tuple[Places, Array]:
    """Ends of pieces and extremes of some, by time: number of the step, and place in it.

    Parameters
    ----------
    found
        The pieces.
    wanted
        Those whose extremes are wanted, shape ``(n,)``.
    """
    slopes = found.coefficients[wanted] @ _SLOPES
    piece, inside = _roots(slopes)
    own = np.flatnonzero(wanted)[piece]
    begin, end = found.begin[own], found.end[own]
    step = np.concatenate([found.step, found.step, found.step[own]])
    place = np.concatenate([found.begin, found.end, begin + 0.5 * (inside + 1.0) * (end - begin)])
    order = np.lexsort((place, step))
    return step[order], place[order]


def _roots(coefficients: Array) -> tuple[Places, Array]:
    """Real roots in [-1, 1] of Chebyshev series, as eigenvalues: whose they are, and the roots."""
    size = np.abs(coefficients)
    counted = size > 1e-14 * size.max(axis=1, keepdims=True, initial=0.0)
    degrees = np.where(counted, np.arange(size.shape[1]), 0).max(axis=1, initial=0)
    owners, roots = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    for degree in np.unique(degrees[degrees > 0]).tolist():
        own = np.flatnonzero(degrees == degree)
        # the colleague matrix, in the symmetric scaling of NumPy's chebcompanion
        matrix = np.zeros((own.size, degree, degree))
        beside = np.full(degree - 1, 0.5)
        beside[:1] = np.sqrt(0.5)
        index = np.arange(degree - 1)
        matrix[:, index, index + 1] = matrix[:, index + 1, index] = beside
        scale = np.full(degree, np.sqrt(0.5))
        scale[0] = 1.0
        series = coefficients[own, : degree + 1]
        factor = 0.5 if degree > 1 else 1.0
        matrix[:, :, -1] -= factor * series[:, :-1] / series[:, -1:] * (scale / scale[-1])
        values = np.linalg.eigvals(matrix)
        # nearly double extremes leave the real axis by the root of round-off
        kept = (np.abs(values.imag) < 1e-4) & (np.abs(values.real) < 1.0)
        owners.append(np.repeat(own, degree).reshape(values.shape)[kept])
        roots.append(values.real[kept])
    return np.concatenate(owners), np.concatenate(roots)


def square_of(found: Pieces) -> Array:
    """Integral of the squared polynomial of every piece, in parts of a step, shape ``(n,)``."""
    product = np.einsum("nk,kl,nl->n", found.coefficients, _PRODUCTS, found.coefficients)
    return np.asarray(0.5 * (found.end - found.begin) * product)


def bracketed_roots(
    along: Along, step: Places, left: Array, right: Array, at_left: Array, at_right: Array
) -> Array:
    """Roots between places with values of different sign, all at once, shape ``(n,)``.

    Bisection with inverse quadratic interpolation (Chandrupatla, *Advances in Engineering
    Software* 28, 1997), to round-off in the place.
    """
    a, b, fa, fb = right.copy(), left.copy(), at_right.copy(), at_left.copy()
    c, fc = a.copy(), fa.copy()
    share = np.full(a.size, 0.5)
    for _ in range(ROOT_SWEEPS):
        place = a + share * (b - a)
        value = along(step, place)
        same = np.sign(value) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = place, value
        nearer = np.abs(fa) < np.abs(fb)
        best = np.where(nearer, a, b)
        width = np.abs(b - a)
        least = 4e-16 * np.maximum(np.abs(best), 1e-3)
        if np.all((width <= 2.0 * least) | (np.where(nearer, fa, fb) == 0.0)):
            break
        with np.errstate(all="ignore"):
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            quadratic = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            share = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (
                fc - fb
            )
            limit = least / width
        usable = quadratic & np.isfinite(share)
        share = np.where(usable, share, 0.5)
        share = np.clip(share, np.minimum(limit, 0.5), np.maximum(1.0 - limit, 0.5))
    return np.asarray(best)
