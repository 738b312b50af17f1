r"""Power series under a decaying exponential, and their fractional derivatives.

The functions :math:`t^\sigma e^{-\lambda t}` agree with a power series at 0 and stay bounded far
away; their fractional derivatives are confluent hypergeometric functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.mathematics.graded_panels import tabulated
from fvi_cli.mathematics.kummer import kummer_functions
from fvi_cli.mathematics.power_series import initial_terms, merged_terms, power_rule

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowedSeries:
    r"""The function :math:`S(t) = e^{-\lambda t} \sum_i c_i t^{\sigma_i}` with values in R^d.

    Its components may decay at rates of their own: then it is several such functions side by side.

    All evaluations take times >= 0 of any shape and return shape ``(..., d)``. At t = 0 a term of
    negative power is infinite, and a sum of such terms may be not a number.

    Parameters
    ----------
    exponents
        Increasing powers :math:`\sigma_i > -1`, shape ``(n,)``.
    coefficients
        The :math:`c_i`, shape ``(n, d)``.
    decay
        The rate :math:`\lambda \ge 0`, or one for every component, shape ``(d,)``.

    Raises
    ------
    ValueError
        For an exponent of -1 or less, a negative rate, or sizes that do not match.
    """

    exponents: Array
    coefficients: Array
    decay: float | Array

    def __post_init__(self) -> None:
        exponents = np.array(self.exponents, dtype=float)
        coefficients = np.array(self.coefficients, dtype=float)
        if coefficients.ndim != 2 or coefficients.shape[0] != exponents.size:
            raise ValueError(
                f"coefficients: shape {coefficients.shape} does not fit {exponents.size} exponents"
            )
        if np.any(exponents <= -1):
            raise ValueError(f"exponents: {exponents.min():g} is not allowed; all must exceed -1")
        rates = self._rates
        if rates.shape not in ((1,), (coefficients.shape[1],)):
            raise ValueError(
                f"decay: {rates.size} rates do not fit {coefficients.shape[1]} components"
            )
        if not np.all((rates >= 0) & np.isfinite(rates)):
            raise ValueError(f"decay: {self.decay!r} is not allowed; it must be >= 0 and finite")
        exponents.setflags(write=False)
        coefficients.setflags(write=False)
        object.__setattr__(self, "exponents", exponents)
        object.__setattr__(self, "coefficients", coefficients)

    @classmethod
    def matching(
        cls, exponents: Array, coefficients: Array, *, cutoff: float, decay: float | Array
    ) -> WindowedSeries:
        r"""The window that agrees with :math:`\sum a_i t^{\sigma_i}` below :math:`t^Q`.

        Its coefficients are those of :math:`e^{\lambda t} \sum a_i t^{\sigma_i}` truncated at Q.
        """
        count = max(1, math.ceil(cutoff - exponents.min())) if exponents.size else 1
        powers = np.arange(count)
        rates = np.atleast_1d(np.asarray(decay, dtype=float))
        growth = np.array([rates**k / math.factorial(k) for k in range(count)])
        # in extreme units products may leave the range of numbers from the cutoff on, where they
        # are dropped
        with np.errstate(over="ignore"):
            products = coefficients[:, None, :] * growth
        merged = merged_terms(
            np.add.outer(exponents, powers).ravel(),
            products.reshape(-1, coefficients.shape[1]),
            cutoff,
        )
        return cls(exponents=merged[0], coefficients=merged[1], decay=decay)

    @classmethod
    def side_by_side(cls, windows: Sequence[WindowedSeries]) -> WindowedSeries:
        """The components of all windows, each with its own rate."""
        ends = np.cumsum([window.dimension for window in windows])
        coefficients = np.zeros((sum(window.exponents.size for window in windows), ends[-1]))
        row = 0
        for window, end in zip(windows, ends.tolist(), strict=True):
            rows = slice(row, row + window.exponents.size)
            coefficients[rows, end - window.dimension : end] = window.coefficients
            row = rows.stop
        exponents, coefficients = merged_terms(
            np.concatenate([window.exponents for window in windows]), coefficients, math.inf
        )
        rates = [np.broadcast_to(w._rates, (w.dimension,)) for w in windows]
        return cls(exponents=exponents, coefficients=coefficients, decay=np.concatenate(rates))

    @property
    def _rates(self) -> Array:
        return np.atleast_1d(np.asarray(self.decay, dtype=float))

    @property
    def dimension(self) -> int:
        """Number d of components."""
        return int(self.coefficients.shape[1])

    def position(self, time: ArrayLike) -> Array:
        """S(t)."""
        return self._windowed(self.exponents, self.coefficients, time)

    def velocity(self, time: ArrayLike) -> Array:
        """S'(t)."""
        return self._windowed(*self._differentiated(self.exponents, self.coefficients), time)

    def acceleration(self, time: ArrayLike) -> Array:
        """S''(t)."""
        first = self._differentiated(self.exponents, self.coefficients)
        return self._windowed(*self._differentiated(*first), time)

    def fractional_derivative(
        self, time: ArrayLike, order: float, kind: Literal["caputo", "riemann-liouville"]
    ) -> Array:
        r"""Fractional derivative of S of an order :math:`\gamma` in (0, 2); S' for order 1.

        .. math:: D^\gamma t^\sigma e^{-\lambda t} =
                  \frac{\Gamma(\sigma+1)}{\Gamma(\sigma+1-\gamma)} t^{\sigma-\gamma}
                  {}_1F_1(\sigma+1; \sigma+1-\gamma; -\lambda t)

        Caputo is the derivative of S - S(0), for orders above 1 of S - S(0) - S'(0) t. There the
        terms with :math:`\sigma = 0` and, for orders above 1, :math:`\sigma = 1` are summed with
        what is subtracted from them, since their difference would cancel at small t.

        Raises
        ------
        ValueError
            If the order lies outside (0, 2).
        """
        if not 0 < order < 2:
            raise ValueError(f"order: {order!r} is not allowed; it must lie in (0, 2)")
        if order == 1:
            return self.velocity(time)
        subtracted = (
            initial_terms(self.exponents, order)
            if kind == "caputo"
            else np.zeros(self.exponents.shape, dtype=bool)
        )
        factors = power_rule(self.exponents, order)

        rates = self._rates
        parts = [
            part
            for sigma, c, factor, initial in zip(
                self.exponents.tolist(), self.coefficients, factors, subtracted, strict=True
            )
            for part in _parts(sigma, c, float(factor), order, rates, initial=bool(initial))
        ]
        first = np.array([part.first for part in parts])
        second = np.array([part.second for part in parts])
        # components of one member share their rate
        distinct, place = np.unique(rates, return_inverse=True)

        def values(at: Array) -> Array:
            total = np.zeros((at.size, self.dimension))
            functions = kummer_functions(first, second, np.outer(at, distinct).ravel())
            functions = functions.reshape(first.size, at.size, distinct.size)[..., place]
            for part, function in zip(parts, functions, strict=True):
                power = at**part.power
                total += (part.scale * power[:, None] * function) * part.coefficients
            return total

        return self._on_times(values, time)

    def _differentiated(self, exponents: Array, coefficients: Array) -> tuple[Array, Array]:
        """Coefficients of S' under the same exponential: c' - lambda c."""
        return merged_terms(
            np.concatenate((exponents - 1.0, exponents)),
            np.concatenate((exponents[:, None] * coefficients, -self._rates * coefficients)),
            math.inf,
        )

    def _windowed(self, exponents: Array, coefficients: Array, time: ArrayLike) -> Array:
        def values(at: Array) -> Array:
            window = np.exp(-np.outer(at, self._rates))
            total = np.zeros((at.size, self.dimension))
            for sigma, c in zip(exponents, coefficients, strict=True):
                total += (at[:, None] ** sigma * window) * c
            return total

        return self._on_times(values, time)

    def _on_times(self, values: Callable[[Array], Array], time: ArrayLike) -> Array:
        time = np.asarray(time, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            return tabulated(values, time.ravel()).reshape(*time.shape, self.dimension)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    r"""The function :math:`s t^p {}_1F_1(a; b; -\lambda t) c` with c in R^d, s for every rate.

    In extreme units s and c are multiplied last, lest their product leave the range of numbers.
    """

    coefficients: Array
    scale: Array
    power: float
    first: float
    second: float


def _parts(
    exponent: float,
    coefficients: Array,
    factor: float,
    order: float,
    decay: Array,
    *,
    initial: bool,
) -> list[_Part]:
    """The fractional derivative of one term under the exponential.

    Of an `initial` term it is that of e^{-z} - 1 (+ z for orders above 1), or of t (e^{-z} - 1),
    with z = lambda t. Where the second parameter of the general form is 0 or -1 (its `factor` is
    0 there) it is the limit.
    """
    if initial and exponent == 1:
        scale = -decay / math.gamma(3.0 - order)
        return [
            _Part(
                coefficients=coefficients,
                scale=scale,
                power=2.0 - order,
                first=a,
                second=3.0 - order,
            )
            for a in (2.0, 1.0)
        ]
    if initial:
        n = math.ceil(order)
        scale = (-decay) ** n / math.gamma(n + 1.0 - order)
        power, a, b = n - order, 1.0, n + 1.0 - order
    elif factor == 0:
        a = exponent + 1.0
        n = round(order - a) + 1
        scale = math.gamma(a + n) * (-decay) ** n / math.factorial(n)
        power, a, b = exponent - order + n, a + n, n + 1.0
    else:
        scale = np.full(decay.shape, factor)
        power, a, b = exponent - order, exponent + 1.0, exponent + 1.0 - order
    return [_Part(coefficients=coefficients, scale=scale, power=power, first=a, second=b)]
