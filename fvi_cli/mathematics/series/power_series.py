r"""Truncated power series with real exponents, and their arithmetic.

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
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS, Algebra
from fvi_cli.mathematics.arrays import Array, set_arrays
from fvi_cli.mathematics.series.terms import (
    MOST_TERMS,
    SAME_EXPONENT,
    initial_terms,
    merged_terms,
    power_coefficients,
    power_rule,
)
from fvi_cli.mathematics.series.terms import SeriesError as SeriesError

SeriesFunction = Callable[["PowerSeries"], "PowerSeries"]
Taylor = Callable[[float, int], list[float]]
"""From a point and a number n to the first n Taylor coefficients of a function there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PowerSeries(Algebra):
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

    def __post_init__(self) -> None:
        exponents, coefficients = merged_terms(self.exponents, self.coefficients, self.cutoff)
        if coefficients.ndim != 1:
            raise SeriesError("the coefficients of a series are numbers, one for every exponent")
        set_arrays(self, exponents=exponents, coefficients=coefficients)
        object.__setattr__(self, "cutoff", float(self.cutoff))

    @classmethod
    def constant(cls, value: float, cutoff: float) -> PowerSeries:
        """The constant `value`."""
        return cls(exponents=np.zeros(1), coefficients=np.array([value]), cutoff=cutoff)

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

    def scaled(self, factor: float) -> PowerSeries:
        """The series times a number."""
        return replace(self, coefficients=factor * self.coefficients)


class Expandable(Protocol):
    """A formula, or anything else that can be evaluated on power series."""

    @property
    def text(self) -> str:
        """What it is called in messages."""

    def evaluate(self, values: Mapping[str, PowerSeries | float], /) -> PowerSeries | float:
        """Its value for given variables."""


def expand(expression: Expandable, cutoff: float, at: float = 0.0) -> PowerSeries:
    """Expand an expression in t, to the right of the point `at`, up to `cutoff`.

    Raises
    ------
    SeriesError
        If it has no expansion in powers there, or none that reaches the cutoff.
    """
    working = cutoff
    for _ in range(4):
        value = expression.evaluate({"t": PowerSeries.variable(working, at)})
        if not isinstance(value, PowerSeries):
            return PowerSeries.constant(value, cutoff)
        if value.cutoff >= cutoff - SAME_EXPONENT:
            return PowerSeries(
                exponents=value.exponents, coefficients=value.coefficients, cutoff=cutoff
            )
        # Roots and quotients lose some powers; begin with as many more.
        working += cutoff - value.cutoff
    raise SeriesError(f"{expression.text!r} could not be expanded up to t**{cutoff:g}")


def _lifted(value: PowerSeries | float) -> PowerSeries:
    return value if isinstance(value, PowerSeries) else PowerSeries.constant(value, math.inf)


def _sum(a: PowerSeries | float, b: PowerSeries | float) -> PowerSeries:
    one, other = _lifted(a), _lifted(b)
    return PowerSeries(
        exponents=np.concatenate((one.exponents, other.exponents)),
        coefficients=np.concatenate((one.coefficients, other.coefficients)),
        cutoff=min(one.cutoff, other.cutoff),
    )


def _product(a: PowerSeries | float, b: PowerSeries | float) -> PowerSeries:
    if not isinstance(a, PowerSeries):
        a, b = _lifted(b), a
    if not isinstance(b, PowerSeries):
        return a.scaled(float(b))
    # a O(t^Q) term of one factor meets the leading term of the other; a product is not
    # carried further than its operands, even where more terms would be known.
    known = min(
        a.cutoff + b.leading_exponent, b.cutoff + a.leading_exponent, max(a.cutoff, b.cutoff)
    )
    return PowerSeries(
        exponents=np.add.outer(a.exponents, b.exponents).ravel(),
        coefficients=np.multiply.outer(a.coefficients, b.coefficients).ravel(),
        cutoff=known,
    )


def _quotient(a: PowerSeries | float, b: PowerSeries | float) -> PowerSeries:
    if isinstance(b, PowerSeries):
        return _product(a, _real_power(b, -1.0))
    if b == 0:
        raise SeriesError("division by zero has no expansion in powers of t")
    return _lifted(a).scaled(1.0 / float(b))


def _power(base: PowerSeries | float, exponent: PowerSeries | float) -> PowerSeries:
    if not isinstance(exponent, PowerSeries):
        return _real_power(_lifted(base), float(exponent))
    if isinstance(base, PowerSeries):
        if exponent.exponents.size == 1 and exponent.exponents[0] == 0:
            return _real_power(base, float(exponent.coefficients[0]))
        return _EXP(_product(exponent, _LOG(base)))
    if not base > 0:
        raise SeriesError(f"{base!r} to a power that varies has no expansion in powers of t")
    return _EXP(exponent.scaled(math.log(base)))


def _composition(series: PowerSeries, name: str, coefficients_at: Taylor) -> PowerSeries:
    """Substitute a series into the Taylor series of a function at its constant term."""
    value = _start_of(series, name)
    rest = series.without_initial_terms(1.0)
    step = rest.leading_exponent
    if rest.exponents.size and math.isinf(series.cutoff):
        raise SeriesError(f"{name} of an exact sum has infinitely many terms; give it a cutoff")
    count = math.ceil((series.cutoff - SAME_EXPONENT) / step) if rest.exponents.size else 1
    if count > MOST_TERMS:
        raise SeriesError(f"{name}: more than {MOST_TERMS} exponents below {series.cutoff:g}")
    with np.errstate(all="ignore"):
        coefficients = coefficients_at(value, max(count, 1))
    if not all(map(math.isfinite, coefficients)):
        raise SeriesError(f"{name} has no finite Taylor coefficients at {value:g}")
    # Horner's scheme; a partial sum is cut where later factors take its terms beyond the cutoff
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


def _real_power(series: PowerSeries, exponent: float) -> PowerSeries:
    integral = exponent.is_integer()
    if exponent == 0:
        return PowerSeries.constant(1.0, series.cutoff)
    # an exact sum has no Taylor series, only powers that are exact again
    if integral and 1 <= exponent <= (MOST_TERMS if math.isinf(series.cutoff) else 16):
        half = _real_power(series, exponent // 2)
        square = _product(half, half)
        return _product(square, series) if exponent % 2 else square
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
        lambda value, count: power_coefficients(exponent, count),
    )
    return PowerSeries(
        exponents=unit.exponents + lead * exponent,
        coefficients=unit.coefficients * factor,
        cutoff=min(unit.cutoff + lead * exponent, series.cutoff if lead >= 0 else math.inf),
    )


def _start_of(series: PowerSeries, name: str) -> float:
    """The value at t = 0 of the argument of a function."""
    if series.leading_exponent < 0 or series.cutoff <= 0:
        raise SeriesError(f"{name} of something unbounded at 0 has no expansion in powers of t")
    return series.coefficient(0.0)


def _cycle(name: str, *derivatives: Callable[[float], float]) -> SeriesFunction:
    """A function with periodic derivatives; `derivatives` has one period from the function on."""

    def coefficients(value: float, count: int) -> list[float]:
        sizes = [float(one(value)) for one in derivatives]
        return [sizes[k % len(sizes)] / math.factorial(min(k, 170)) for k in range(count)]

    return lambda series: _composition(series, name, coefficients)


def _integral(name: str, slope: Callable[[Any], Any]) -> SeriesFunction:
    r"""A function by its derivative: :math:`f(x(0)) + \int f'(x)\, x'\, dt`."""

    def function(series: PowerSeries) -> PowerSeries:
        start = _start_of(series, name)
        with np.errstate(all="ignore"):
            value = float(NUMPY_FUNCTIONS[name](np.float64(start)))
        if not math.isfinite(value):
            raise SeriesError(f"{name} at {start:g} has no expansion in powers of t")
        rate = series.derivative()
        if not rate.exponents.size:
            return PowerSeries.constant(value, series.cutoff)
        terms = _product(slope(series), rate)
        integral = PowerSeries(
            exponents=terms.exponents + 1.0,
            coefficients=terms.coefficients / (terms.exponents + 1.0),
            cutoff=terms.cutoff + 1.0,
        )
        return _sum(integral, value)

    return function


def _cbrt(series: PowerSeries) -> PowerSeries:
    if series.exponents.size and series.coefficients[0] < 0:
        return _real_power(series.scaled(-1.0), 1 / 3).scaled(-1.0)
    return _real_power(series, 1 / 3)


def _gamma(series: PowerSeries) -> PowerSeries:
    raise SeriesError("the Gamma function of something that varies is not expanded in powers of t")


def _sign_of(series: PowerSeries) -> float:
    """The sign to the right of 0, which is that of the leading term; 0 if no term is known."""
    if math.isinf(series.cutoff):
        raise SeriesError("the sign of an exact sum is known to the right of 0 only")
    return math.copysign(1.0, series.coefficients[0]) if series.exponents.size else 0.0


def _sign(series: PowerSeries) -> PowerSeries:
    sign = _sign_of(series)
    if sign == 0:
        raise SeriesError("sign of something that is 0 at the start has no expansion")
    return PowerSeries.constant(sign, series.cutoff)


def _select(a: Any, b: Any, below: Any, above: Any) -> Any:
    """The value that is taken to the right of 0."""
    difference = a - b
    sign = _sign_of(difference)
    if sign == 0:  # equal as far as they are known
        return (below + above) * 0.5 + difference * 0.0
    return below if sign < 0 else above


_EXP, _LOG = _cycle("exp", np.exp), _integral("log", lambda x: 1.0 / x)
PowerSeries.rules = MappingProxyType(
    {
        "negative": lambda series: series.scaled(-1.0),
        "add": _sum,
        "subtract": lambda a, b: _sum(a, -b),
        "multiply": _product,
        "divide": _quotient,
        "power": _power,
        "square": lambda series: _real_power(series, 2.0),
        "sqrt": lambda series: _real_power(series, 0.5),
        "cbrt": _cbrt,
        "exp": _EXP,
        "expm1": _integral("expm1", _EXP),
        "log": _LOG,
        "log1p": _integral("log1p", lambda x: 1.0 / (1.0 + x)),
        "sin": _cycle("sin", np.sin, np.cos, lambda x: -np.sin(x), lambda x: -np.cos(x)),
        "cos": _cycle("cos", np.cos, lambda x: -np.sin(x), lambda x: -np.cos(x), np.sin),
        "tan": lambda series: np.sin(series) / np.cos(series),
        "sinh": _cycle("sinh", np.sinh, np.cosh),
        "cosh": _cycle("cosh", np.cosh, np.sinh),
        "tanh": lambda series: np.sinh(series) / np.cosh(series),
        "arcsin": _integral("arcsin", lambda x: (1.0 - x**2) ** -0.5),
        "arccos": _integral("arccos", lambda x: -((1.0 - x**2) ** -0.5)),
        "arctan": _integral("arctan", lambda x: 1.0 / (1.0 + x**2)),
        "arcsinh": _integral("arcsinh", lambda x: (1.0 + x**2) ** -0.5),
        "arccosh": _integral("arccosh", lambda x: (x**2 - 1.0) ** -0.5),
        "arctanh": _integral("arctanh", lambda x: 1.0 / (1.0 - x**2)),
        "absolute": lambda series: series.scaled(_sign_of(series) or 1.0),
        "sign": _sign,
        "gamma": _gamma,
        "minimum": lambda a, b: _select(a, b, a, b),
        "maximum": lambda a, b: _select(a, b, b, a),
        "select": _select,
    }
)
"""The functions an expression may call, on power series."""
