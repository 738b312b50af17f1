r"""Finite sums :math:`\sum c\,t^\beta` as an algebra, to recognise forces that are of that kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from types import MappingProxyType
from typing import Final

_MOST_TERMS = 200


class NotAPowerSum(ValueError):  # noqa: N818
    """An operation leads out of the finite sums of powers."""


@dataclass(frozen=True)
class PowerSum:
    r"""The function :math:`\sum_\beta c_\beta t^\beta` of t > 0, exponents real.

    Parameters
    ----------
    terms
        Exponents to coefficients.
    """

    terms: Mapping[float, float] = field(default_factory=dict)

    @classmethod
    def variable(cls) -> PowerSum:
        """The function t."""
        return cls({1.0: 1.0})

    @classmethod
    def lift(cls, value: PowerSum | float) -> PowerSum:
        """A sum as it is, a number as a constant function."""
        return value if isinstance(value, PowerSum) else cls({0.0: float(value)})

    def __add__(self, other: PowerSum | float) -> PowerSum:
        return PowerSum(_collected([*self.terms.items(), *PowerSum.lift(other).terms.items()]))

    __radd__ = __add__

    def __neg__(self) -> PowerSum:
        return PowerSum({exponent: -c for exponent, c in self.terms.items()})

    def __sub__(self, other: PowerSum | float) -> PowerSum:
        return self + (-PowerSum.lift(other))

    def __rsub__(self, other: float) -> PowerSum:
        return PowerSum.lift(other) - self

    def __mul__(self, other: PowerSum | float) -> PowerSum:
        factor = PowerSum.lift(other).terms
        return PowerSum(
            _collected([(a + b, c * d) for a, c in self.terms.items() for b, d in factor.items()])
        )

    __rmul__ = __mul__

    def __truediv__(self, other: PowerSum | float) -> PowerSum:
        return self * PowerSum.lift(other) ** -1

    def __rtruediv__(self, other: float) -> PowerSum:
        return PowerSum.lift(other) / self

    def __pow__(self, power: PowerSum | float) -> PowerSum:
        if isinstance(power, PowerSum):
            power = power.constant()
        if len(self.terms) == 1:
            ((exponent, coefficient),) = self.terms.items()
            if coefficient > 0 or (coefficient < 0 and float(power).is_integer()):
                return PowerSum({exponent * power: float(coefficient) ** power})
        if float(power).is_integer() and 0 <= power <= _MOST_TERMS:
            result = PowerSum.lift(1.0)
            for _ in range(int(power)):
                result = result * self
            return result
        raise NotAPowerSum(f"{self.terms!r} to the power {power!r}")

    def __rpow__(self, base: float) -> PowerSum:
        return PowerSum.lift(float(base) ** self.constant())

    def constant(self) -> float:
        """The value of a sum that does not depend on t.

        Raises
        ------
        NotAPowerSum
            If it does.
        """
        if any(self.terms[exponent] for exponent in self.terms if exponent):
            raise NotAPowerSum(f"{self.terms!r} is not a constant")
        return self.terms.get(0.0, 0.0)

    @property
    def is_polynomial(self) -> bool:
        """Whether every exponent is a natural number."""
        return all(e >= 0 and float(e).is_integer() for e, c in self.terms.items() if c)

    def shifted(self, start: float) -> PowerSum:
        """The polynomial of :math:`t - start`, rounded once at the end.

        Raises
        ------
        NotAPowerSum
            If it is no polynomial.
        """
        if start == 0:
            return self
        if not self.is_polynomial:
            raise NotAPowerSum(f"{self.terms!r} is no polynomial, and no power sum about {start}")
        sums: dict[int, Fraction] = {}
        for exponent, coefficient in self.terms.items():
            degree = int(exponent)
            for j in range(degree + 1):
                term = (
                    Fraction(coefficient) * math.comb(degree, j) * Fraction(start) ** (degree - j)
                )
                sums[j] = sums.get(j, Fraction(0)) + term
        return PowerSum({float(j): float(value) for j, value in sums.items() if value})

    def transform(self) -> dict[float, float]:
        r"""Laplace transform: :math:`t^\beta` becomes :math:`\Gamma(\beta+1) s^{-\beta-1}`.

        Raises
        ------
        NotAPowerSum
            If an exponent is not above -1, or too large.
        """
        result: dict[float, float] = {}
        for exponent, coefficient in self.terms.items():
            if coefficient:
                if not -1 < exponent < 100:
                    raise NotAPowerSum(f"t**{exponent!r} has no Laplace transform in range")
                result[-exponent - 1.0] = coefficient * math.gamma(exponent + 1.0)
        return result


def _collected(pairs: list[tuple[float, float]]) -> dict[float, float]:
    if len(pairs) > _MOST_TERMS * _MOST_TERMS:
        raise NotAPowerSum("too many terms")
    result: dict[float, float] = {}
    for exponent, coefficient in pairs:
        # 1/3 + 2/3 and 1 are the same exponent.
        key = next((e for e in result if abs(e - exponent) < 1e-13 * (1 + abs(e))), exponent)
        if abs(key - round(key)) < 1e-13:
            key = float(round(key))
        result[key] = result.get(key, 0.0) + coefficient
    if len(result) > _MOST_TERMS:
        raise NotAPowerSum("too many terms")
    return result


def _square_root(value: PowerSum) -> PowerSum:
    return value**0.5


def _cube_root(value: PowerSum) -> PowerSum:
    return value ** (1.0 / 3.0)


POWER_SUM_FUNCTIONS: Final[Mapping[str, Callable[[PowerSum], PowerSum]]] = MappingProxyType(
    {"sqrt": _square_root, "cbrt": _cube_root}
)
"""The elementary functions that may keep a power sum a power sum."""
