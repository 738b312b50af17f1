r"""A relaxation law: a force that remembers the velocity and forgets it again.

.. math:: F(t) = A \Bigl( G_0\, q(t) + g \int_0^t k(t - s)\, \dot q(s)\, ds \Bigr),
          \qquad k(t) = \int_0^\infty e^{-x t} \rho(x)\, dx

with a spectral density :math:`\rho \ge 0` or point masses in its place: k is completely monotone,
the law is causal, and it stores or dissipates all work done on it (F. Mainardi, *Fractional
Calculus and Waves in Linear Viscoelasticity*, 2010, chapter 2). Before t = 0 the law has relaxed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from fvi_cli.effects.damping import Coefficient as Coefficient
from fvi_cli.effects.damping import MatrixForce
from fvi_cli.effects.matrices import Form
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array


class RelaxationKernel(Protocol):
    """The kernel k of a law; the integrator treats equal values as one kernel."""

    @property
    def peak(self) -> tuple[float, float] | None:
        r"""Bend of the density in :math:`\log y` and distance of its poles; None: no density."""

    @property
    def masses(self) -> tuple[tuple[float, float], ...]:
        """Pairs (rate, weight) of point masses, in addition to the density."""

    @property
    def start_order(self) -> float | None:
        r"""The :math:`\gamma` for which k is smooth but for :math:`t^{-\gamma}` and higher powers.

        None where k is smooth at 0.
        """

    def log_density(self, log_rate: Array) -> Array:
        r""":math:`\log(y \rho(y))` at :math:`\log y`, same shape."""

    def transform(self, s: complex) -> complex:
        r"""Laplace transform :math:`\hat k(s)`, cut along the negative axis."""

    def on_integration(self, integration: Array, power: Callable[[float], Array]) -> Array:
        r""":math:`\hat k(I^{-1})` of the matrices I by which a method integrates over steps.

        I is ``(u, m, m)``; `power` gives its powers by exponents in (-1, 1).
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class Law(MatrixForce):
    r"""The force :math:`A\,(G_0 q + g\, k * \dot q)` of a relaxation law; A is its coefficient.

    Raises
    ------
    ValueError
        For negative or infinite moduli, or a matrix that is not symmetric.
    """

    kernel: RelaxationKernel  # k, without a unit except powers of the time
    size: float  # g >= 0, a modulus (times the powers of the time that k lacks)
    # G0 >= 0, the modulus after complete relaxation; a scene moves it into its stiffness
    relaxed: float = 0.0
    spring: float = 0.0  # relaxed modulus that a scene has moved into its stiffness

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("size", "relaxed", "spring"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise ArgumentError(name, f"{value!r} is not allowed; it must not be negative")
            object.__setattr__(self, name, float(value))

    @property
    def stiffness(self) -> Form:
        """G0 A, shape ``(d, d)``."""
        return self.relaxed * self.form

    @property
    def is_active(self) -> bool:
        """Whether the law remembers anything: neither its matrix nor its size is zero."""
        return self.size > 0 and super().is_active

    def symbol(self, s: complex) -> complex:
        r"""Factor of the law on :math:`e^{st}`, the complex modulus :math:`G_0 + g\,s\,\hat k(s)`.

        The force on :math:`q = v e^{st}` is minus symbol times matrix times v; at
        :math:`s = i \omega` its real part stores and its imaginary part dissipates.
        """
        return self.relaxed + self.size * s * self.kernel.transform(s)

    def without_stiffness(self) -> Law:
        """The law without its relaxed modulus, which is added to `spring`."""
        return replace(self, relaxed=0.0, spring=self.spring + self.relaxed)


def positive(value: float, name: str, *, below: float = math.inf) -> float:
    """A number that must be positive and below a bound; a complaint gives its name."""
    if not 0 < value < below:
        limit = "positive and finite" if below == math.inf else f"in (0, {below:g})"
        raise ArgumentError(name, f"{value!r} is not allowed; it must be {limit}")
    return float(value)
