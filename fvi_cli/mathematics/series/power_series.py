r"""Truncated power series with real exponents, as values that calculate.

A series stands for :math:`\sum_\sigma c_\sigma t^\sigma + O(t^Q)` as t falls to 0, with finitely
many real exponents below the cutoff Q. Every operation keeps track of how far its result is known,
so that a result never claims a coefficient that its operands do not determine. Such expansions
carry the solutions of fractional differential equations near their start: Diethelm, *The Analysis
of Fractional Differential Equations*, Springer 2010, section 6.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.mathematics.arrays import Array, set_arrays
from fvi_cli.mathematics.series.taylor import (
    MOST_TERMS,
    SAME_EXPONENT,
    TAYLOR,
    Taylor,
    initial_terms,
    merged_terms,
    power_coefficients,
    power_rule,
)
from fvi_cli.mathematics.series.taylor import SeriesError as SeriesError


@dataclass(frozen=True, kw_only=True, eq=False)
class PowerSeries:
    r"""The series :math:`\sum_i c_i t^{\sigma_i} + O(t^Q)` for t > 0.

    Exponents closer than 1e-9 are one exponent; exponents that close to an integer are that
    integer. A coefficient that is smaller than the round-off of the sum it comes from is 0.

    Raises
    ------
    SeriesError
        If a coefficient is not finite, or more than 512 terms remain.
    """

    exponents: Array  # the powers sigma_i, shape (n,); they may be negative
    coefficients: Array  # the c_i, shape (n,)
    # Q: terms from here on are not known, and dropped. Infinite for a finite sum known exactly
    cutoff: float
    # NumPy scalars on the left must leave the operation to this class.
    __array_ufunc__ = None

    def __post_init__(self) -> None:
        exponents, coefficients = merged_terms(self.exponents, self.coefficients, self.cutoff)
        if coefficients.ndim != 1:
            raise SeriesError("the coefficients of a series are numbers, one for every exponent")
        set_arrays(self, exponents=exponents, coefficients=coefficients)
        object.__setattr__(self, "cutoff", float(self.cutoff))

    @classmethod
    def monomial(cls, coefficient: float, exponent: float, cutoff: float) -> PowerSeries:
        """The single term c t**exponent."""
        return cls(
            exponents=np.array([exponent]), coefficients=np.array([coefficient]), cutoff=cutoff
        )

    @classmethod
    def constant(cls, value: float, cutoff: float) -> PowerSeries:
        """The constant `value`."""
        return cls.monomial(value, 0.0, cutoff)

    @classmethod
    def variable(cls, cutoff: float, at: float = 0.0) -> PowerSeries:
        """The variable itself around the point `at`: at + t."""
        return cls(exponents=np.array([0.0, 1.0]), coefficients=np.array([at, 1.0]), cutoff=cutoff)

    @property
    def leading_exponent(self) -> float:
        """Smallest exponent, or the cutoff when no term is known."""
        return float(self.exponents[0]) if self.exponents.size else self.cutoff

    def coefficient(self, exponent: float) -> float:
        """Coefficient of t**exponent, 0 when it does not occur."""
        near = np.abs(self.exponents - exponent) <= SAME_EXPONENT
        return float(self.coefficients[near].sum())

    def __call__(self, time: ArrayLike) -> Array:
        """The sum of the known terms at `time` >= 0; infinite at 0 if an exponent is negative."""
        time = np.asarray(time, dtype=float)
        if not self.exponents.size:
            return np.zeros(time.shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(time[..., None] ** self.exponents @ self.coefficients)

    def __repr__(self) -> str:
        terms = " + ".join(
            f"{c:.6g} t**{s:.6g}" for c, s in zip(self.coefficients, self.exponents, strict=True)
        )
        return f"<{terms or '0'} + O(t**{self.cutoff:.6g})>"

    def __neg__(self) -> PowerSeries:
        return self._scaled(-1.0)

    def __pos__(self) -> PowerSeries:
        return self

    def __add__(self, other: PowerSeries | float) -> PowerSeries:
        other = self._lifted(other)
        return PowerSeries(
            exponents=np.concatenate((self.exponents, other.exponents)),
            coefficients=np.concatenate((self.coefficients, other.coefficients)),
            cutoff=min(self.cutoff, other.cutoff),
        )

    __radd__ = __add__

    def __sub__(self, other: PowerSeries | float) -> PowerSeries:
        return self + (-other)

    def __rsub__(self, other: float) -> PowerSeries:
        return (-self) + other

    def __mul__(self, other: PowerSeries | float) -> PowerSeries:
        if not isinstance(other, PowerSeries):
            return self._scaled(float(other))
        # a O(t^Q) term of one factor meets the leading term of the other; a product is not
        # carried further than its operands even where that would be known.
        known = min(
            self.cutoff + other.leading_exponent,
            other.cutoff + self.leading_exponent,
            max(self.cutoff, other.cutoff),
        )
        return PowerSeries(
            exponents=np.add.outer(self.exponents, other.exponents).ravel(),
            coefficients=np.multiply.outer(self.coefficients, other.coefficients).ravel(),
            cutoff=known,
        )

    __rmul__ = __mul__

    def __truediv__(self, other: PowerSeries | float) -> PowerSeries:
        if isinstance(other, PowerSeries):
            return self * other**-1
        if other == 0:
            raise SeriesError("division by zero has no expansion in powers of t")
        return self._scaled(1.0 / float(other))

    def __rtruediv__(self, other: float) -> PowerSeries:
        return self**-1 * other

    def __pow__(self, exponent: PowerSeries | float) -> PowerSeries:
        if isinstance(exponent, PowerSeries):
            if exponent.exponents.size == 1 and exponent.exponents[0] == 0:
                return self ** float(exponent.coefficients[0])
            return _exp(exponent * _log(self))
        return _real_power(self, float(exponent))

    def __rpow__(self, base: float) -> PowerSeries:
        if not base > 0:
            raise SeriesError(f"{base!r} to a power that varies has no expansion in powers of t")
        return _exp(self._scaled(math.log(base)))

    def fractional_derivative(self, order: float) -> PowerSeries:
        r"""Riemann-Liouville derivative by the power rule; an integral for a negative order.

        .. math:: D^\gamma t^\sigma = \frac{\Gamma(\sigma+1)}{\Gamma(\sigma+1-\gamma)}
                  t^{\sigma-\gamma}

        The Caputo derivative is that of the series without its integer powers below `order`:
        see :meth:`without_initial_terms`.

        Raises
        ------
        SeriesError
            If an exponent is -1 or less, where the term is not integrable.
        """
        if self.exponents.size and self.exponents[0] <= -1 + SAME_EXPONENT:
            raise SeriesError(f"t**{self.exponents[0]:g} is not integrable at 0")
        return PowerSeries(
            exponents=self.exponents - order,
            coefficients=self.coefficients * power_rule(self.exponents, order),
            cutoff=self.cutoff - order,
        )

    def without_initial_terms(self, order: float) -> PowerSeries:
        """The series without t**0, t**1, ... below `order` (what Caputo subtracts)."""
        kept = ~initial_terms(self.exponents, order)
        return replace(self, exponents=self.exponents[kept], coefficients=self.coefficients[kept])

    def derivative(self) -> PowerSeries:
        """Ordinary first derivative."""
        return PowerSeries(
            exponents=self.exponents - 1.0,
            coefficients=self.coefficients * self.exponents,
            cutoff=self.cutoff - 1.0,
        )

    def _lifted(self, other: PowerSeries | float) -> PowerSeries:
        if isinstance(other, PowerSeries):
            return other
        return PowerSeries.constant(float(other), math.inf)

    def _scaled(self, factor: float) -> PowerSeries:
        return replace(self, coefficients=factor * self.coefficients)


class Expandable(Protocol):
    """A formula, or anything else that can be evaluated on power series."""

    @property
    def text(self) -> str:
        """What it is called in messages."""

    def evaluate(
        self,
        values: Mapping[str, PowerSeries | float],
        functions: Mapping[str, Callable[..., Any]],
        /,
    ) -> PowerSeries | float:
        """Its value for given variables."""


def expand(
    expression: Expandable, cutoff: float, at: float = 0.0, variable: str = "t"
) -> PowerSeries:
    """Expand an expression in one variable, to the right of the point `at`, up to `cutoff`.

    Raises
    ------
    SeriesError
        If it has no expansion in powers there, or none that reaches the cutoff.
    """
    working = cutoff
    for _ in range(4):
        value = expression.evaluate({variable: PowerSeries.variable(working, at)}, SERIES_FUNCTIONS)
        if not isinstance(value, PowerSeries):
            return PowerSeries.constant(value, cutoff)
        if value.cutoff >= cutoff - SAME_EXPONENT:
            return PowerSeries(
                exponents=value.exponents, coefficients=value.coefficients, cutoff=cutoff
            )
        # Roots and quotients lose some powers; begin with as many more.
        working += cutoff - value.cutoff
    raise SeriesError(f"{expression.text!r} could not be expanded up to t**{cutoff:g}")


def _composition(series: PowerSeries, name: str, coefficients_at: Taylor) -> PowerSeries:
    """Substitute a series into the Taylor series of a function at its constant term."""
    if series.leading_exponent < 0 or series.cutoff <= 0:
        raise SeriesError(f"{name} of something unbounded at 0 has no expansion in powers of t")
    value = series.coefficient(0.0)
    rest = series.without_initial_terms(1.0)
    step = rest.leading_exponent
    if not rest.exponents.size:
        return PowerSeries.constant(
            _coefficients_at(value, 1, name, coefficients_at)[0], series.cutoff
        )
    if math.isinf(series.cutoff):
        raise SeriesError(f"{name} of an exact sum has infinitely many terms; give it a cutoff")
    count = math.ceil((series.cutoff - SAME_EXPONENT) / step)
    if count > MOST_TERMS:
        raise SeriesError(f"{name}: more than {MOST_TERMS} exponents below {series.cutoff:g}")
    coefficients = _coefficients_at(value, max(count, 1), name, coefficients_at)
    # Horner's scheme; a partial sum is needed no further than its later factors leave it
    exponents, sums = np.zeros(1), np.array([coefficients[-1]])
    for power, coefficient in zip(
        range(len(coefficients) - 2, -1, -1), reversed(coefficients[:-1]), strict=True
    ):
        exponents, sums = merged_terms(
            np.append(np.add.outer(exponents, rest.exponents), 0.0),
            np.append(np.multiply.outer(sums, rest.coefficients), coefficient),
            series.cutoff - power * step,
        )
    return PowerSeries(exponents=exponents, coefficients=sums, cutoff=series.cutoff)


def _coefficients_at(value: float, count: int, name: str, coefficients_at: Taylor) -> list[float]:
    try:
        coefficients = coefficients_at(value, count)
    except (OverflowError, ZeroDivisionError):
        coefficients = [math.inf]
    if not all(map(math.isfinite, coefficients)):
        raise SeriesError(f"{name} has no finite Taylor coefficients at {value:g}")
    return coefficients


def _real_power(series: PowerSeries, exponent: float) -> PowerSeries:
    integral = exponent.is_integer()
    if exponent == 0:
        return PowerSeries.constant(1.0, series.cutoff)
    # an exact sum has exact powers only
    if integral and 1 <= exponent <= (MOST_TERMS if math.isinf(series.cutoff) else 16):
        half = _real_power(series, exponent // 2)
        return half * half * series if exponent % 2 else half * half
    if not series.exponents.size:
        if exponent < 0:
            raise SeriesError(f"0**{exponent:g} has no expansion in powers of t")
        known = series.cutoff * exponent if exponent < 1 else series.cutoff
        return PowerSeries(exponents=np.empty(0), coefficients=np.empty(0), cutoff=known)
    lead, first = float(series.exponents[0]), float(series.coefficients[0])
    if first < 0 and not integral:
        raise SeriesError(f"a negative number to the power {exponent:g} is not real")
    try:
        factor = float(first**exponent)
    except OverflowError:
        raise SeriesError(f"a power {exponent:g} overflows") from None
    ratio = PowerSeries(
        exponents=series.exponents - lead,
        coefficients=series.coefficients / first,
        cutoff=series.cutoff - lead,
    )
    unit = _composition(
        ratio,
        f"a power {exponent:g}",
        lambda value, count: power_coefficients(value, exponent, count),
    )
    return PowerSeries(
        exponents=unit.exponents + lead * exponent,
        coefficients=unit.coefficients * factor,
        cutoff=min(unit.cutoff + lead * exponent, series.cutoff if lead >= 0 else math.inf),
    )


def _abs(series: PowerSeries) -> PowerSeries:
    """To the right of 0 the sign is that of the leading term."""
    if series.exponents.size and series.coefficients[0] < 0:
        return -series
    return series


def _sign(series: PowerSeries) -> PowerSeries:
    if not series.exponents.size:
        raise SeriesError("sign of something that is 0 at the start has no expansion")
    return PowerSeries.constant(math.copysign(1.0, series.coefficients[0]), series.cutoff)


def _cbrt(series: PowerSeries) -> PowerSeries:
    if series.exponents.size and series.coefficients[0] < 0:
        return -((-series) ** (1 / 3))
    return series ** (1 / 3)


def _gamma(series: PowerSeries) -> PowerSeries:
    raise SeriesError("the Gamma function of something that varies is not expanded in powers of t")


def _select(a: Any, b: Any, below: Any, above: Any) -> Any:
    """What is taken to the right of 0: the leading term of the difference decides."""
    difference = a - b
    if not difference.coefficients.size:  # equal as far as they are known
        return (below + above) * 0.5 + difference * 0.0
    return below if difference.coefficients[0] < 0 else above


def _composed(name: str, coefficients_at: Taylor) -> Callable[[PowerSeries], PowerSeries]:
    return lambda series: _composition(series, name, coefficients_at)


_exp, _log = _composed("exp", TAYLOR["exp"]), _composed("log", TAYLOR["log"])
SERIES_FUNCTIONS: Final[Mapping[str, Callable[..., Any]]] = MappingProxyType(
    {
        **{name: _composed(name, coefficients) for name, coefficients in TAYLOR.items()},
        "sqrt": lambda series: series**0.5,
        "cbrt": _cbrt,
        "log1p": lambda series: SERIES_FUNCTIONS["log"](1.0 + series),
        "abs": _abs,
        "sign": _sign,
        "gamma": _gamma,
        "min": lambda a, b: _select(a, b, a, b),
        "max": lambda a, b: _select(a, b, b, a),
        "select": _select,
    }
)
"""The functions an expression may call, on power series."""
