r"""Transforms of relaxation laws as fractions of sums of powers.

Multiplied by its denominators, the characteristic function of a scene with laws is a sum of powers
again, whose zeros and branch cut are known how to be dealt with. The factors by which it is
multiplied have no zeros off the negative axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fvi_cli.effects.laws.cole_cole import ColeCole
from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.effects.laws.tempered import TemperedPower

Powers = dict[float, float]
"""Powers of s with their coefficients."""

SAME_POWER = 1e-12
MOST_RATES = 8
"""Point masses up to which polynomials that are multiplied out keep their digits."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fraction:
    r"""A kernel's :math:`\hat k(s)` as a quotient of two sums of powers of p = s + l."""

    above: Powers
    below: Powers


def plus(one: Powers, other: Powers, factor: float = 1.0) -> Powers:
    """The sum of one and a multiple of the other, powers that agree to round-off as one."""
    powers = dict(one)
    for power, coefficient in other.items():
        same = next((known for known in powers if abs(known - power) < SAME_POWER), power)
        powers[same] = powers.get(same, 0.0) + factor * coefficient
    return powers


def product(*factors: Powers) -> Powers:
    """The product."""
    total: Powers = {0.0: 1.0}
    for factor in factors:
        found: Powers = {}
        for power, coefficient in factor.items():
            found = plus(found, {p + power: c for p, c in total.items()}, coefficient)
        total = found
    return total


def shifted(polynomial: Powers, decay: float) -> Powers:
    """A sum of powers of s as one of p = s + l.

    Raises
    ------
    ValueError
        For powers that are no integers >= 0, unless l is zero.
    """
    if decay == 0:
        return polynomial
    total: Powers = {}
    for power, coefficient in polynomial.items():
        if power < 0 or power != round(power):
            raise ValueError(f"power {power:g}: no polynomial")
        total = plus(total, product(*[{1.0: 1.0, 0.0: -decay}] * round(power)), coefficient)
    return total


def fraction_of(kernel: RelaxationKernel, decay: float) -> Fraction:
    """The quotient for a kernel.

    Raises
    ------
    ValueError
        Where it is none in powers of p = s + l.
    """
    if isinstance(kernel, TemperedPower) and kernel.rate == decay:
        return Fraction(above={kernel.order - 1.0: 1.0}, below={0.0: 1.0})
    if isinstance(kernel, ColeCole) and decay == 0:
        size = kernel.time**kernel.order
        below = {0.0: 1.0, kernel.order: size}
        return Fraction(above={kernel.order - 1.0: size}, below=below)
    if kernel.ends is not None or len(kernel.masses) > MOST_RATES:
        raise ValueError(f"{kernel}: no quotient of a few powers")
    factors: list[Powers] = [{1.0: 1.0, 0.0: rate - decay} for rate, _ in kernel.masses]
    above: Powers = {}
    for index, (_, weight) in enumerate(kernel.masses):
        others = [*factors[:index], *factors[index + 1 :]]
        above = plus(above, product(*others), weight)
    return Fraction(above=above, below=product(*factors))


def common_decay(kernels: Sequence[RelaxationKernel]) -> float:
    """The rate l for which all kernels are quotients of powers of s + l.

    Raises
    ------
    ValueError
        If there is none.
    """
    shifts = {kernel.shift for kernel in kernels if kernel.ends is not None}
    if len(shifts) > 1:
        raise ValueError("laws of different least rates: no common powers")
    return next(iter(shifts), 0.0)
