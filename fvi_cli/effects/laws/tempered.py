"""The tempered springpot: a fractional derivative that forgets exponentially."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.laws.law import Coefficient, Law, check_fraction, positive
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.runge_kutta import matrix_power


@dataclass(frozen=True, kw_only=True)
class TemperedPower:
    r"""The kernel :math:`k(t) = e^{-l t} t^{-\gamma} / \Gamma(1 - \gamma)`.

    .. math:: \hat k(s) = (s + l)^{\gamma - 1}, \qquad
              \rho(x) = \frac{\sin \pi\gamma}{\pi} (x - l)^{\gamma - 1}, \quad x > l

    (F. Sabzikar, M.M. Meerschaert, J. Chen, *Tempered fractional calculus*, J. Comput. Phys. 293,
    2015).
    """

    order: float  # gamma in (0, 1)
    rate: float  # l > 0, 1/time
    masses = ()
    peak = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", check_fraction(self.order))
        object.__setattr__(self, "rate", positive(self.rate, "rate"))

    @property
    def label(self) -> str:
        """The order and the rate in words."""
        return f"damping of order {self.order:g} that forgets at {self.rate:g}"

    @property
    def shift(self) -> float:
        """The rate l."""
        return self.rate

    @property
    def ends(self) -> tuple[float, float]:
        """The power of y = x - l in y rho(x): gamma everywhere."""
        return self.order, self.order

    @property
    def start_order(self) -> float:
        """The kernel begins with t^-gamma."""
        return self.order

    def log_density(self, log_rate: Array) -> Array:
        """Logarithm of y = x - l times the density, at logarithms of y."""
        sine = math.sin(math.pi * min(self.order, 1 - self.order))
        return np.asarray(math.log(sine / math.pi) + self.order * log_rate)

    def transform(self, s: complex) -> complex:
        """The Laplace transform of the kernel."""
        return (s + self.rate) ** (self.order - 1)

    def on_integration(self, integration: Array, power: Callable[[float], Array]) -> Array:
        r""":math:`(I (1 + l I)^{-1})^{1 - \gamma}`."""
        # scaled to the size of the method's matrix, whatever l times the step is
        step = np.abs(integration).sum(axis=-1).max(axis=-1)
        scales = step / (1 + self.rate * step)
        unit = np.eye(integration.shape[-1])
        damped = integration @ np.linalg.inv(unit + self.rate * integration)
        exponent = 1 - self.order
        found = [
            scale**exponent * matrix_power(one / scale, exponent)
            for scale, one in zip(scales.tolist(), damped, strict=True)
        ]
        return np.array(found).reshape(integration.shape)


def tempered(*, order: float, rate: float, coefficient: Coefficient) -> Law:
    r"""The law :math:`G(s) = s (s + l)^{\gamma - 1}`, a springpot that forgets in times of 1/l.

    The order is :math:`\gamma` in (0, 1), the rate l > 0.

    Raises
    ------
    ValueError
        For parameters out of range.
    """
    kernel = TemperedPower(order=order, rate=rate)
    return Law(kernel=kernel, size=1.0, coefficient=coefficient)
