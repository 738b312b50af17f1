"""Motions without fractional memory by Dormand and Prince's method of order 8."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Acceleration = Callable[[float, Array, Array, Array], ArrayLike]
"""x'' from t, x, x' and the internal variables z, shape ``(n, d)``."""


@dataclass(frozen=True, eq=False)
class OrdinarySolution:
    """Motion on [0, T], and how far the positions of one with a larger tolerance are from it."""

    pieces: tuple[tuple[float, Any], ...]
    dimension: int
    error: Array
    """Largest difference for every component, shape ``(d,)``."""

    def position(self, times: ArrayLike) -> Array:
        """Positions, shape ``(n, d)``."""
        return self._state(times)[:, : self.dimension]

    def velocity(self, times: ArrayLike) -> Array:
        """Velocities, shape ``(n, d)``."""
        return self._state(times)[:, self.dimension : 2 * self.dimension]

    def _state(self, times: ArrayLike) -> Array:
        t = np.atleast_1d(np.asarray(times, dtype=float))
        starts = np.array([start for start, _ in self.pieces])
        index = np.searchsorted(starts, t, side="right") - 1
        found = [self.pieces[n][1](time) for n, time in zip(index, t, strict=True)]
        return np.array(found)


def solve_ordinary(
    acceleration: Acceleration,
    x0: ArrayLike,
    v0: ArrayLike,
    final_time: float,
    *,
    relaxation_times: Sequence[float] = (),
    breaks: Sequence[float] = (),
    longest_step: float = math.inf,
) -> OrdinarySolution:
    r"""Solve x'' = acceleration(t, x, x', z) with :math:`z_i' = x' - z_i / \tau_i`, z(0) = 0.

    So :math:`z_i = \int_0^t e^{-(t-s)/\tau_i} x'(s) ds`: the force of a Prony series is
    :math:`A \sum_i g_i z_i` beside its relaxed stiffness.
    """
    x, v = (np.atleast_1d(np.array(value, dtype=float)) for value in (x0, v0))
    d = x.size
    rates = 1 / np.array(relaxation_times, dtype=float)
    edges = [0.0, *sorted(t for t in breaks if 0 < t < final_time), final_time]

    def slope(t: float, state: Array) -> Array:
        rate, z = state[d : 2 * d], state[2 * d :].reshape(-1, d)
        inner = rate - rates[:, None] * z
        return np.concatenate([rate, np.atleast_1d(acceleration(t, state[:d], rate, z)), *inner])

    def solve(tolerance: float) -> tuple[tuple[float, Any], ...]:
        state = np.concatenate([x, v, np.zeros(rates.size * d)])
        pieces = []
        for start, end in itertools.pairwise(edges):
            found = solve_ivp(
                slope,
                (start, end),
                state,
                method="DOP853",
                rtol=tolerance,
                atol=tolerance * 1e-3,
                dense_output=True,
                max_step=min(longest_step, end - start),
            )
            if not found.success:
                raise ArithmeticError(found.message)
            pieces.append((start, found.sol))
            state = found.y[:, -1]
        return tuple(pieces)

    fine, coarse = solve(3e-14), solve(1e-12)
    times = np.linspace(0.0, final_time, 997)
    one, other = (OrdinarySolution(pieces, d, x).position(times) for pieces in (fine, coarse))
    return OrdinarySolution(fine, d, np.max(np.abs(one - other), axis=0))
