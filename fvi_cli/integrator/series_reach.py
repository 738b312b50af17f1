"""How far an expansion in powers of t is good."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.expansion import Expansion
from fvi_cli.mathematics.power_series import SAME_EXPONENT

Array = NDArray[np.float64]

LARGEST_LOG: Final = 700.0
"""Times beyond exp of it, and below exp of its negative, are no numbers."""

MOST_TRIALS: Final = 100


def sizes_by_mass(expansion: Expansion, scene: Scene) -> Array:
    """Norms of the coefficients by the mass matrix, the same in all coordinates."""
    a = expansion.coefficients
    # divided before they are squared: coefficients of 1e200 and 1e-200 are in range, squares not
    largest = np.abs(a).max(axis=1)
    a = a / np.where(largest > 0, largest, 1.0)[:, None]
    return np.asarray(largest * np.sqrt(np.einsum("ni,ij,nj->n", a, scene.inertia.mass, a)))


def time_of_validity(expansion: Expansion, scene: Scene, last_powers: float) -> float:
    r"""Largest t at which the last terms do not outweigh the others.

    .. math:: \sum_{\sigma \ge Q-2} |a_\sigma| t^\sigma \le \sum_{0<\sigma<Q-2} |a_\sigma| t^\sigma

    (with `last_powers` in place of 2). The size of a coefficient is its norm by the mass matrix,
    which does not depend on the choice of coordinates. The quotient of the two sums increases with
    t, so that Newton's iteration in log t, kept between bounds, finds the time. A sum that ends
    before Q - 2 is good for ever; it gets the length of the run.
    """
    sizes = sizes_by_mass(expansion, scene)
    used = (expansion.exponents > 0) & (sizes > 0)
    exponents, logs = expansion.exponents[used], np.log(sizes[used])
    last = exponents >= expansion.cutoff - last_powers - SAME_EXPONENT
    if not last.any():
        return scene.final_time
    if last.all():
        return 0.0
    used_by = [(exponents[chosen], logs[chosen]) for chosen in (last, ~last)]

    def excess(log_time: float) -> tuple[float, float]:
        """Log of the quotient of the sums, and its slope."""
        values = [_log_sum(powers, sizes, log_time) for powers, sizes in used_by]
        return values[0][0] - values[1][0], values[0][1] - values[1][1]

    low, high = -LARGEST_LOG, LARGEST_LOG
    log_time = math.log(scene.final_time)
    for _ in range(MOST_TRIALS):
        value, slope = excess(log_time)
        low, high = (low, log_time) if value > 0 else (log_time, high)
        change = -value / slope if slope > 0 else -math.inf
        if abs(change) <= 4e-16 * max(1.0, abs(log_time)):
            break
        following = log_time + change
        # a last step of round-off may leave the bounds, which are then very close
        log_time = following if low < following < high else 0.5 * (low + high)
        if high - low <= 4e-16 * max(1.0, abs(high)):
            break
    return math.exp(log_time)


def _log_sum(exponents: Array, logs: Array, log_time: float) -> tuple[float, float]:
    """Log of a sum of powers of t, and its slope in log t."""
    terms = logs + exponents * log_time
    largest = float(terms.max())
    parts = np.exp(terms - largest)
    total = float(parts.sum())
    return largest + math.log(total), float(parts @ exponents) / total
