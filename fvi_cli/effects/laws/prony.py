"""Prony series: springs and dashpots, a generalised Maxwell model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.laws.law import Coefficient, Law, positive
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True)
class PronyKernel:
    r"""The kernel :math:`k(t) = \sum_i g_i e^{-x_i t}`: point masses; it needs no quadrature.

    .. math:: \hat k(s) = \sum_i \frac{g_i}{s + x_i}

    Raises
    ------
    ValueError
        If there are no pairs, or a rate or weight is not positive.
    """

    masses: tuple[tuple[float, float], ...]  # pairs of a rate x_i > 0 (1/time) and a weight g_i > 0
    peak = None
    start_order = None

    def __post_init__(self) -> None:
        if not self.masses:
            raise ArgumentError("moduli", "at least one is needed")
        for rate, weight in self.masses:
            positive(rate, "rate")
            positive(weight, "weight")

    def log_density(self, log_rate: Array) -> Array:
        """Minus infinity: there is no density."""
        return np.full(np.shape(log_rate), -np.inf)

    def transform(self, s: complex) -> complex:
        """The Laplace transform of the kernel."""
        return sum((weight / (s + rate) for rate, weight in self.masses), 0j)

    def on_integration(self, integration: Array, power: Callable[[float], Array]) -> Array:
        r""":math:`\sum_i g_i I (1 + x_i I)^{-1}`."""
        unit = np.eye(integration.shape[-1])
        total = np.zeros_like(integration)
        for rate, weight in self.masses:
            total += weight * (integration @ np.linalg.inv(unit + rate * integration))
        return total


def prony(
    *,
    moduli: Sequence[float],
    times: Sequence[float],
    coefficient: Coefficient = 1.0,
    relaxed: float = 0.0,
) -> Law:
    r"""The law :math:`G(t) = G_0 + \sum_i g_i e^{-t/\tau_i}`, on a number or symmetric matrix.

    There are as many moduli :math:`g_i > 0` as times :math:`\tau_i > 0`; relaxed is
    :math:`G_0 \ge 0`.

    Raises
    ------
    ValueError
        For numbers out of range, at ``moduli`` or ``times``.
    """
    if len(moduli) != len(times):
        raise ArgumentError(
            "times", f"{len(times)} of them are not allowed beside {len(moduli)} moduli"
        )
    for name, values in (("moduli", moduli), ("times", times)):
        for index, value in enumerate(values):
            positive(value, f"{name}.{index}")
    masses = tuple((1.0 / time, float(g)) for g, time in zip(moduli, times, strict=True))
    kernel = PronyKernel(masses=masses)
    return Law(kernel=kernel, size=1.0, relaxed=relaxed, coefficient=coefficient)
