r"""A relaxation law: a force that remembers the velocity and forgets it again.

.. math:: F(t) = A \Bigl( G_0\, q(t) + g \int_0^t k(t - s)\, \dot q(s)\, ds \Bigr),
          \qquad k(t) = \int_0^\infty e^{-x t} \rho(x)\, dx

with a spectral density :math:`\rho \ge 0` or point masses in its place: k is completely monotone,
the law causal, and what it takes up it stores or dissipates (F. Mainardi, *Fractional Calculus and Waves in
Linear Viscoelasticity*, 2010, chapter 2). Before t = 0 the law has relaxed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import Array, symmetric_matrix

ComplexArray = NDArray[np.complex128]


class RelaxationKernel(Protocol):
    """The kernel k of a law, as a value: equal ones are one kernel to the integrator."""

    @property
    def shift(self) -> float:
        """Rate l >= 0 from which on there is a density, 1/time."""

    @property
    def ends(self) -> tuple[float, float] | None:
        r"""Powers of y in :math:`y \rho(l + y)` for small and for large y; None: no density."""

    @property
    def peak(self) -> tuple[float, float] | None:
        r"""Logarithm of a y, and how far beside it in the imaginary direction the density is
        singular in :math:`\log y`; None where it has the same power everywhere.
        """

    @property
    def masses(self) -> tuple[tuple[float, float], ...]:
        """Pairs (rate, weight) of point masses beside the density."""

    @property
    def start_order(self) -> float | None:
        r"""The :math:`\gamma` for which k is smooth but for :math:`t^{-\gamma}` and higher powers.

        None where k is smooth at 0.
        """

    def log_density(self, log_rate: Array) -> Array:
        r""":math:`\log(y \rho(l + y))` at :math:`\log y`, same shape."""

    def symbol(self, s: ComplexArray) -> ComplexArray:
        r"""Laplace transform :math:`\hat k(s)`, cut along the negative axis, same shape."""

    def on_integration(self, integration: Array, power: Callable[[float], Array]) -> Array:
        r""":math:`\hat k(I^{-1})` of the matrix I by which a method integrates over a step.

        Parameters
        ----------
        integration
            I, shape ``(m, m)``, time.
        power
            Its powers, by exponents in (-1, 1).
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    r"""The force :math:`A\,(G_0 q + g\, k * \dot q)` of a relaxation law.

    Parameters
    ----------
    kernel
        k, of no unit but for powers of the time.
    size
        g >= 0, in the unit of a modulus (times the powers of the time that k lacks).
    coefficient
        The number or symmetric matrix A on which the law acts, shape ``(d, d)``.
    relaxed
        The modulus G0 >= 0 that is left in the end. A scene counts it among its stiffnesses.

    Raises
    ------
    ValueError
        For negative or infinite moduli, or a matrix that is not symmetric.
    """

    kernel: RelaxationKernel
    size: float
    coefficient: Array
    relaxed: float = 0.0

    def __post_init__(self) -> None:
        for name in ("size", "relaxed"):
            value = float(getattr(self, name))
            if not 0 <= value < math.inf:
                raise ValueError(f"{name}: {value!r} is not allowed; it must not be negative")
            object.__setattr__(self, name, value)
        object.__setattr__(self, "coefficient", symmetric_matrix(self.coefficient, "coefficient"))

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.coefficient.shape[0])

    @property
    def stiffness(self) -> Array:
        """G0 A, shape ``(d, d)``."""
        return self.relaxed * self.coefficient

    def modulus(self, s: ComplexArray) -> ComplexArray:
        r"""The complex modulus :math:`G(s) = G_0 + g\,s\,\hat k(s)`, same shape.

        A motion from rest, q(0) = 0, has the force :math:`\hat F = G(s)\,A\,\hat q`; at
        :math:`s = i \omega` its real part stores and its imaginary part dissipates.
        """
        return np.asarray(self.relaxed + self.size * s * self.kernel.symbol(s))


def positive(value: float, name: str) -> float:
    """A number that must be positive and finite.

    Raises
    ------
    ValueError
        ``name: ...`` if it is not.
    """
    if not 0 < value < math.inf:
        raise ValueError(f"{name}: {value!r} is not allowed; it must be positive and finite")
    return float(value)


def fraction(value: float, name: str = "order") -> float:
    """A number that must lie between 0 and 1.

    Raises
    ------
    ValueError
        ``name: ...`` if it does not.
    """
    if not 0 < value < 1:
        raise ValueError(f"{name}: {value!r} is not allowed; it must lie in (0, 1)")
    return float(value)
