"""Forces that are not formulas: given by samples, or by a Python function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array, set_arrays

Interpolation = Literal["linear", "cubic", "previous"]

INTERPOLATION_ORDERS: Final[Mapping[str, int]] = {"linear": 2, "cubic": 4, "previous": 1}
"""Order of every interpolation: the highest order of a method that its knots allow."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledForce:
    r"""One component of a force as a piecewise polynomial through samples.

    .. math:: f(t) = \sum_{j=0}^{p-1} c_{jk} (t - t_k)^{p-1-j}, \qquad t_k \le t \le t_{k+1}
    """

    knots: Array  # times t_0 < t_1 < ... < t_n, shape (n + 1,)
    coefficients: Array  # the c_jk, shape (p, n), the highest power first
    source: str = "samples"  # where the samples come from, for messages

    def __post_init__(self) -> None:
        set_arrays(self, knots=self.knots, coefficients=self.coefficients)

    @classmethod
    def through(
        cls,
        time: ArrayLike,
        values: ArrayLike,
        interpolation: Interpolation,
        *,
        source: str = "samples",
    ) -> SampledForce:
        """The force through samples.

        ``linear``: straight lines. ``cubic``: the spline with two continuous derivatives, whose
        third is continuous at the second and the last but one sample as well ("not a knot").
        ``previous``: each value holds until the next time.

        Raises
        ------
        ValueError
            For an unknown interpolation, too few samples, or samples that are not allowed.
        """
        if interpolation not in INTERPOLATION_ORDERS:
            words = ", ".join(INTERPOLATION_ORDERS)
            raise ArgumentError("interpolation", f"{interpolation!r} is not one of {words}")
        knots, at_knots = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
        least = max(2, INTERPOLATION_ORDERS[interpolation])
        if knots.ndim != 1 or knots.shape != at_knots.shape or knots.size < least:
            raise ValueError(
                f"{source}: {knots.size} times and {at_knots.size} values; {interpolation} "
                f"interpolation needs at least {least} of both"
            )
        if not (np.isfinite([knots, at_knots]).all() and np.all(np.diff(knots) > 0)):
            raise ValueError(f"{source}: times must increase and every number must be finite")
        if interpolation == "cubic":
            from scipy.interpolate import CubicSpline

            return cls(knots=knots, coefficients=CubicSpline(knots, at_knots).c, source=source)
        slopes = np.diff(at_knots) / np.diff(knots)
        rows = [slopes, at_knots[:-1]] if interpolation == "linear" else [at_knots[:-1]]
        return cls(knots=knots, coefficients=np.stack(rows), source=source)

    @property
    def order(self) -> int:
        """Number p of coefficients of every piece, the order of the interpolation."""
        return int(self.coefficients.shape[0])

    def evaluate(self, names: Mapping[str, Any]) -> Array:
        """The force at the times under ``t``.

        Before the first and after the last sample the outermost polynomials are continued, only
        to allow for round-off at the ends. At a knot the later polynomial holds.
        """
        time = np.asarray(names["t"], dtype=float)
        pieces = np.searchsorted(self.knots, time, side="right") - 1
        pieces = np.clip(pieces, 0, self.coefficients.shape[1] - 1)
        offset = time - self.knots[pieces]
        values = self.coefficients[0, pieces]
        for row in self.coefficients[1:]:
            values = values * offset + row[pieces]
        return np.asarray(values)


@dataclass(frozen=True, kw_only=True, eq=False)
class FunctionForce:
    """One component of a force as a function of the time."""

    # from times of any shape to the force, in the same shape; smooth between the break points of
    # the forcing
    function: Callable[[Array], Array]

    def evaluate(self, names: Mapping[str, Any]) -> Array:
        """The force at the times under ``t``.

        Raises
        ------
        ExpressionError
            Where the function gives another shape, or no real numbers.
        """
        time = np.asarray(names["t"], dtype=float)
        values = np.asarray(self.function(time))
        if values.shape not in (time.shape, ()) or values.dtype.kind not in "fiu":
            name = getattr(self.function, "__name__", "a function")
            raise ExpressionError(
                f"{name}: it gives {values.dtype} of shape {values.shape} for times of shape "
                f"{time.shape}; it must give a number for each"
            )
        return np.asarray(np.broadcast_to(values, time.shape), dtype=float)
