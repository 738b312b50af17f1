"""The fractional Zener law (Cole and Cole), and the fractional Maxwell law as its special case."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.laws.law import Coefficient, Law, positive
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array

# so far from its peak the density is zero to every accuracy; its logarithm is finite
_FAR = 600.0


@dataclass(frozen=True, kw_only=True)
class ColeCole:
    r"""The kernel :math:`k(t) = E_a(-(t/\tau)^a)`, a Mittag-Leffler function, k(0) = 1.

    .. math:: \hat k(s) = \frac{\tau^a s^{a-1}}{1 + (s\tau)^a}, \qquad
              x \rho(x) = \frac{\sin \pi a}{\pi}
              \frac{1}{(x\tau)^a + 2 \cos \pi a + (x\tau)^{-a}}

    (K.S. Cole, R.H. Cole, *Dispersion and absorption in dielectrics I*, J. Chem. Phys. 9, 1941).
    """

    order: float  # a in (0, 1)
    time: float  # tau > 0
    masses = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", positive(self.order, "order", below=1.0))
        object.__setattr__(self, "time", positive(self.time, "time"))

    @property
    def peak(self) -> tuple[float, float]:
        r"""The peak is at :math:`1/\tau`, singularities at :math:`(x\tau)^a = -e^{\pm i \pi a}`."""
        return -math.log(self.time), math.pi * (1 - self.order) / self.order

    @property
    def start_order(self) -> float:
        """The kernel begins with 1 minus a multiple of t^a."""
        return -self.order

    def log_density(self, log_rate: Array) -> Array:
        """Logarithm of the rate times the density, at logarithms of rates."""
        a = self.order
        near = np.clip(a * (log_rate + math.log(self.time)), -_FAR, _FAR)
        # 2 cosh + 2 cos without cancellation, where the peak is narrow as well
        width = 4 * math.sin(0.5 * math.pi * (1 - a)) ** 2
        sine = math.sin(math.pi * min(a, 1 - a))
        return np.asarray(math.log(sine / math.pi) - np.log(4 * np.sinh(0.5 * near) ** 2 + width))

    def transform(self, s: complex) -> complex:
        """The Laplace transform of the kernel."""
        power = (s * self.time) ** self.order
        return power / (s * (1 + power))

    def on_integration(self, integration: Array, power: Callable[[float], Array]) -> Array:
        r""":math:`I (1 + (I/\tau)^a)^{-1}`."""
        lasting = np.eye(integration.shape[-1]) + self.time**-self.order * power(self.order)
        return np.asarray(integration @ np.linalg.inv(lasting))


def fractional_zener(
    *, order: float, time: float, relaxed: float, unrelaxed: float, coefficient: Coefficient = 1.0
) -> Law:
    r"""The law of four parameters, on a number or symmetric matrix.

    .. math:: G(s) = G_0 + (G_\infty - G_0) \frac{(s\tau)^a}{1 + (s\tau)^a}

    with the order a in (0, 1), the time :math:`\tau > 0`, and the moduli of very slow (relaxed) and
    of very fast motions (unrelaxed), :math:`0 \le G_0 \le G_\infty`.

    Raises
    ------
    ValueError
        For parameters out of range; a law with :math:`G_\infty < G_0` would create energy.
    """
    if not relaxed <= unrelaxed < math.inf:
        raise ArgumentError(
            "unrelaxed",
            f"{unrelaxed!r} is not allowed; it must be at least the relaxed modulus "
            f"{relaxed!r}, or the law would create energy",
        )
    kernel, size = ColeCole(order=order, time=time), unrelaxed - relaxed
    return Law(kernel=kernel, size=size, relaxed=relaxed, coefficient=coefficient)


def fractional_maxwell(
    *, order: float, time: float, modulus: float, coefficient: Coefficient = 1.0
) -> Law:
    r"""A spring and a springpot in series: :math:`G(s) = G \frac{(s\tau)^a}{1 + (s\tau)^a}`.

    The order is a in (0, 1), the time :math:`\tau > 0`, and the modulus G > 0 that of the spring.

    Raises
    ------
    ValueError
        For parameters out of range.
    """
    kernel = ColeCole(order=order, time=time)
    return Law(kernel=kernel, size=positive(modulus, "modulus"), coefficient=coefficient)
