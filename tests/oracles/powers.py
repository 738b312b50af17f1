r"""Finite sums of real powers, :math:`\sum_i c_i t^{\sigma_i}`, and what keeps them such."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Final

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array, set_arrays

SAME_EXPONENT: Final = 1e-9  # exponents closer than this are equal
MOST_TERMS: Final = 512
CANCELLED: Final = 16.0 * float(np.finfo(float).eps)
"""A sum counts as 0 below this share of the sum of the absolute values of its terms."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Powers(NDArrayOperatorsMixin):
    """A finite sum of powers of t > 0, on which formulas work.

    Raises
    ------
    ExpressionError
        If a coefficient is not finite, or more than 512 terms remain.
    """

    rules: ClassVar[Mapping[str, Callable[..., Any]]]
    exponents: Array  # the powers, increasing, shape (n,); they may be negative
    coefficients: Array  # shape (n,), without zeros

    def __post_init__(self) -> None:
        if self.exponents.size > MOST_TERMS**2 or not np.isfinite(self.coefficients).all():
            raise ExpressionError("no finite sum of powers of t")
        sums: list[list[float]] = []
        for index in np.argsort(self.exponents, kind="stable"):
            exponent, one = float(self.exponents[index]), float(self.coefficients[index])
            if not sums or exponent - sums[-1][0] > SAME_EXPONENT:
                whole = round(exponent)
                sums.append([whole if abs(exponent - whole) <= SAME_EXPONENT else exponent, 0, 0])
            sums[-1][1] += one
            sums[-1][2] += abs(one)
        kept = [(exponent, sum_) for exponent, sum_, size in sums if abs(sum_) > CANCELLED * size]
        if len(kept) > MOST_TERMS:
            raise ExpressionError(f"more than {MOST_TERMS} powers of t")
        exponents, coefficients = np.array(kept, dtype=float).reshape(-1, 2).T
        set_arrays(self, exponents=exponents, coefficients=coefficients)

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        if ufunc.__name__ not in self.rules:
            raise ExpressionError(f"the function {ufunc.__name__!r} is not available here")
        return self.rules[ufunc.__name__](*inputs)

    @classmethod
    def constant(cls, value: float) -> Powers:
        """The constant `value`."""
        return cls(exponents=np.zeros(1), coefficients=np.array([value]))

    @classmethod
    def variable(cls) -> Powers:
        """The variable t."""
        return cls(exponents=np.ones(1), coefficients=np.ones(1))

    def __repr__(self) -> str:
        pairs = zip(self.coefficients, self.exponents, strict=True)
        return " + ".join(f"{c:.6g} t**{s:.6g}" for c, s in pairs) or "0"


def _lifted(value: Powers | float) -> Powers:
    return value if isinstance(value, Powers) else Powers.constant(float(value))


def _sum(a: Powers | float, b: Powers | float) -> Powers:
    one, other = _lifted(a), _lifted(b)
    return Powers(
        exponents=np.concatenate((one.exponents, other.exponents)),
        coefficients=np.concatenate((one.coefficients, other.coefficients)),
    )


def _product(a: Powers | float, b: Powers | float) -> Powers:
    one, other = _lifted(a), _lifted(b)
    return Powers(
        exponents=np.add.outer(one.exponents, other.exponents).ravel(),
        coefficients=np.multiply.outer(one.coefficients, other.coefficients).ravel(),
    )


def _power(base: Powers | float, exponent: Powers | float) -> Powers:
    if isinstance(exponent, Powers):
        raise ExpressionError("a power that varies is no sum of powers of t")
    given, power = _lifted(base), float(exponent)
    if power.is_integer() and 0 <= power <= MOST_TERMS:
        found = Powers.constant(1.0)
        for bit in bin(int(power))[2:]:
            found = _product(found, found)
            found = _product(found, given) if bit == "1" else found
        return found
    if given.exponents.size != 1 or (given.coefficients[0] < 0 and not power.is_integer()):
        raise ExpressionError(f"a power {power:g} of {given!r} is no sum of powers of t")
    with np.errstate(all="ignore"):
        return Powers(exponents=given.exponents * power, coefficients=given.coefficients**power)


def _cbrt(base: Powers) -> Powers:
    negative = base.exponents.size == 1 and base.coefficients[0] < 0
    return _product(-1.0, _power(-base, 1 / 3)) if negative else _power(base, 1 / 3)


Powers.rules = MappingProxyType(
    {
        "negative": lambda a: _product(-1.0, a),
        "add": _sum,
        "subtract": lambda a, b: _sum(a, _product(-1.0, b)),
        "multiply": _product,
        "divide": lambda a, b: _product(a, _power(b, -1.0)),
        "power": _power,
        "square": lambda a: _product(a, a),
        "sqrt": lambda a: _power(a, 0.5),
        "cbrt": _cbrt,
    }
)
