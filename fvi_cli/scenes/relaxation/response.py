"""Exact solutions of linear equations, with and without relaxation laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.effects.matrices import Array
from fvi_cli.mathematics.transforms.characteristic import (
    CharacteristicFunction,
    CharacteristicSum,
    ZeroCluster,
    characteristic_zeros,
)
from fvi_cli.mathematics.transforms.fractional_oscillator import contour_response
from fvi_cli.scenes.relaxation.transforms import (
    Powers,
    common_decay,
    fraction_of,
    plus,
    product,
    shifted,
)

MOST_TERMS = 30
"""Powers of s of which the zeros are looked for; their balances grow with the square."""
Inputs = Sequence[tuple[float, Mapping[float, float]]]
"""Pairs (start, N) of transforms N(s), from `start` on."""


@dataclass(frozen=True, kw_only=True)
class LinearResponse:
    r"""Solution x(t) of a linear equation with constant coefficients.

    .. math:: m x'' + \sum_j \mu_j D^{\gamma_j} x + \sum_i g_i k_i * x' + k x = f(t)

    Parameters
    ----------
    characteristic
        The left-hand side in powers of p = s + l, multiplied by the denominators of laws.
    inputs
        Pairs (start, N): from `start` on, the response with transform N(p)/P(p) is added.
    zeros
        Its zeros.
    decay
        l.
    """

    characteristic: CharacteristicFunction | CharacteristicSum
    inputs: tuple[tuple[float, Mapping[float, float]], ...]
    zeros: tuple[ZeroCluster, ...]
    decay: float = 0.0

    def __call__(self, time: Array) -> Array:
        """The position at `time`, same shape; not finite where it exceeds the range of doubles."""
        time = np.asarray(time, dtype=float)
        if np.any(time < 0):
            raise ValueError("time: negative times are not allowed")
        total = np.zeros(time.shape)
        for start, numerator in self.inputs:
            chosen = time >= start
            if numerator and np.any(chosen):
                with np.errstate(over="ignore", invalid="ignore"):
                    total[chosen] += contour_response(
                        self.characteristic,
                        self.zeros,
                        numerator,
                        time[chosen] - start,
                        decay=self.decay,
                    )
        return total


def law_response(
    plain: CharacteristicFunction,
    inputs: Inputs,
    laws: Sequence[tuple[RelaxationKernel, float]],
    position: float,
) -> LinearResponse:
    """The response of an equation with relaxation laws.

    Parameters
    ----------
    plain
        The left-hand side without them.
    inputs
        Transforms of the right-hand side without them; the first begins at 0.
    laws
        Kernels with their sizes.
    position
        x(0), at which they have relaxed.

    Raises
    ------
    ValueError
        If the laws are no quotients of powers, or zeros of the sum cannot be separated.
    """
    decay = common_decay([kernel for kernel, _ in laws])
    sizes: dict[RelaxationKernel, float] = {}
    for kernel, size in laws:
        sizes[kernel] = sizes.get(kernel, 0.0) + size
    fractions = {kernel: fraction_of(kernel, decay) for kernel in sizes}
    everything = product(*(one.below for one in fractions.values()))
    rate = shifted({1.0: 1.0}, decay)
    memory: Powers = {}
    for kernel, size in sizes.items():
        others = [one.below for other, one in fractions.items() if other != kernel]
        memory = plus(memory, product(fractions[kernel].above, *others), size)
    total = product(shifted(dict(plain.terms), decay), everything)
    total = plus(total, product(rate, memory))
    if len(total) > MOST_TERMS:
        raise ValueError(f"laws: {len(total)} powers; zeros of up to {MOST_TERMS} are looked for")
    characteristic = CharacteristicSum(
        terms=tuple((power, total[power]) for power in sorted(total, reverse=True) if total[power])
    )
    changed: list[tuple[float, Mapping[float, float]]] = []
    for index, (start, numerator) in enumerate(inputs):
        powers = product(shifted(dict(numerator), decay), everything)
        if index == 0:
            powers = plus(powers, memory, position)
        changed.append((start, {power: c for power, c in powers.items() if c}))
    zeros = characteristic_zeros(characteristic)
    if decay and any(zero.multiplicity > 1 for zero in zeros):
        # seen from -l zeros beside the axis are close together, and their residues cancel
        raise ValueError(f"laws: forgetting at {decay:g} is too far from the zeros")
    return LinearResponse(
        characteristic=characteristic,
        inputs=tuple(changed),
        zeros=zeros,
        decay=decay,
    )
