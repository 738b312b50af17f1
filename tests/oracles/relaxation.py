r"""Exact solutions of linear equations, with and without relaxation laws.

Transforms of laws are fractions of sums of powers of s. Multiplied by the denominators, the
characteristic function of a scene with laws is again a sum of powers, whose zeros and branch cut
are treated as without laws. The denominators have no zeros off the negative axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.laws.cole_cole import ColeCole
from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.mathematics.arrays import Array

from .characteristic import (
    Terms,
    ZeroCluster,
    characteristic_zeros,
)
from .fractional_oscillator import contour_response

MOST_TERMS = 30
"""Most powers of s in a sum whose zeros are searched; the work grows with their square."""
Inputs = Sequence[tuple[float, Mapping[float, float]]]
"""Pairs (start, N): from `start` on the input with transform N(s), by powers of s."""
Powers = dict[float, float]
"""Coefficients by power of s."""

SAME_POWER = 1e-12
MOST_RATES = 8
"""Most relaxation rates of a law: more factors, multiplied out, would lose digits."""


@dataclass(frozen=True, kw_only=True)
class LinearResponse:
    r"""Solution x(t) of a linear equation with constant coefficients.

    .. math:: m x'' + \sum_j \mu_j D^{\gamma_j} x + \sum_i g_i k_i * x' + k x = f(t)
    """

    # the left-hand side in powers of s, multiplied by the denominators of laws
    terms: Terms
    # pairs (start, N): from `start` on, the response with transform N(s)/P(s) is added
    inputs: tuple[tuple[float, Mapping[float, float]], ...]
    zeros: tuple[ZeroCluster, ...]
    position: float = 0.0  # position at t = 0

    def __call__(self, time: Array) -> Array:
        """The position at `time`, same shape; not finite where it exceeds the range of doubles."""
        time = np.asarray(time, dtype=float)
        if np.any(time < 0):
            raise ValueError("time: negative times are not allowed")
        total = np.where(time == 0, self.position, 0.0)
        for start, numerator in self.inputs:
            since = time - start
            chosen = since > 0
            if numerator and np.any(chosen):
                with np.errstate(over="ignore", invalid="ignore"):
                    total[chosen] += contour_response(
                        self.terms, self.zeros, numerator, since[chosen]
                    )
        return total


def law_response(
    plain: Terms,
    inputs: Inputs,
    laws: Sequence[tuple[RelaxationKernel, float]],
    position: float,
) -> LinearResponse:
    """The response of an equation with laws that are relaxed at `position`.

    `plain` is the left-hand side and `inputs` the right-hand side without laws; the first input
    begins at 0.
    """
    sizes: dict[RelaxationKernel, float] = {}
    for kernel, size in laws:
        sizes[kernel] = sizes.get(kernel, 0.0) + size
    fractions = {kernel: fraction_of(kernel) for kernel in sizes}
    everything = product(*(below for _, below in fractions.values()))
    memory: Powers = {}
    for kernel, size in sizes.items():
        others = [below for other, (_, below) in fractions.items() if other != kernel]
        memory = plus(memory, product(fractions[kernel][0], *others), size)
    total = plus(product(dict(plain), everything), product({1.0: 1.0}, memory))
    if len(total) > MOST_TERMS:
        raise ValueError(f"laws: {len(total)} powers; zeros of up to {MOST_TERMS} are looked for")
    terms = tuple((power, total[power]) for power in sorted(total, reverse=True) if total[power])
    changed: list[tuple[float, Mapping[float, float]]] = []
    for index, (start, numerator) in enumerate(inputs):
        powers = product(dict(numerator), everything)
        if index == 0:
            powers = plus(powers, memory, position)
        changed.append((start, {power: c for power, c in powers.items() if c}))
    return LinearResponse(
        terms=terms,
        inputs=tuple(changed),
        zeros=characteristic_zeros(terms),
        position=position,
    )


def plus(one: Powers, other: Powers, factor: float = 1.0) -> Powers:
    """The sum `one` + `factor` * `other`; powers that agree up to round-off are merged."""
    powers = dict(one)
    for power, coefficient in other.items():
        same = next((known for known in powers if abs(known - power) < SAME_POWER), power)
        powers[same] = powers.get(same, 0.0) + factor * coefficient
    return powers


def product(*factors: Powers) -> Powers:
    """The product of sums of powers."""
    total: Powers = {0.0: 1.0}
    for factor in factors:
        found: Powers = {}
        for power, coefficient in factor.items():
            found = plus(found, {p + power: c for p, c in total.items()}, coefficient)
        total = found
    return total


def fraction_of(kernel: RelaxationKernel) -> tuple[Powers, Powers]:
    r"""Numerator and denominator of a kernel's :math:`\hat k(s)` in powers of s."""
    if isinstance(kernel, ColeCole):
        size = kernel.time**kernel.order
        return {kernel.order - 1.0: size}, {0.0: 1.0, kernel.order: size}
    if kernel.peak is not None or len(kernel.masses) > MOST_RATES:
        raise ValueError(f"{kernel}: no quotient of a few powers")
    factors: list[Powers] = [{1.0: 1.0, 0.0: rate} for rate, _ in kernel.masses]
    above: Powers = {}
    for index, (_, weight) in enumerate(kernel.masses):
        others = [*factors[:index], *factors[index + 1 :]]
        above = plus(above, product(*others), weight)
    return above, product(*factors)
