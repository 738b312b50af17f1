r"""A relaxation law: a force that remembers the velocity and forgets it again.

.. math:: F(t) = A \Bigl( G_0\, q(t) + g \int_0^t k(t - s)\, \dot q(s)\, ds \Bigr),
          \qquad k(t) = \int_0^\infty e^{-x t} \rho(x)\, dx

with a spectral density :math:`\rho \ge 0` or point masses in its place: k is completely monotone,
the law is causal, and it stores or dissipates all work done on it (F. Mainardi, *Fractional
Calculus and Waves in Linear Viscoelasticity*, 2010, chapter 2). Before t = 0 the law has relaxed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.damping import Coefficient, MatrixForce
from fvi_cli.effects.matrices import Form
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
    masses = ()  # pairs (rate, weight) of point masses, in addition to the density

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", positive(self.order, "order", below=1.0))
        object.__setattr__(self, "time", positive(self.time, "time"))

    @property
    def peak(self) -> tuple[float, float]:
        r"""Bend of the density in :math:`\log y`, and distance of its poles.

        The peak is at :math:`1/\tau`, singularities are at :math:`(x\tau)^a = -e^{\pm i \pi a}`.
        """
        return -math.log(self.time), math.pi * (1 - self.order) / self.order

    @property
    def start_order(self) -> float:
        r"""The :math:`\gamma` for which k is smooth but for :math:`t^{-\gamma}` and higher powers.

        The kernel begins with 1 minus a multiple of t^a.
        """
        return -self.order

    def log_density(self, log_rate: Array) -> Array:
        r""":math:`\log(y \rho(y))` at :math:`\log y`, same shape."""
        a = self.order
        near = np.clip(a * (log_rate + math.log(self.time)), -_FAR, _FAR)
        # 2 cosh + 2 cos without cancellation, where the peak is narrow as well
        width = 4 * math.sin(0.5 * math.pi * (1 - a)) ** 2
        sine = math.sin(math.pi * min(a, 1 - a))
        return np.asarray(math.log(sine / math.pi) - np.log(4 * np.sinh(0.5 * near) ** 2 + width))

    def transform(self, s: complex) -> complex:
        r"""Laplace transform :math:`\hat k(s)`, cut along the negative axis."""
        power = (s * self.time) ** self.order
        return power / (s * (1 + power))

    def on_integration(self, integration: Array, power: Callable[[float], Array]) -> Array:
        r""":math:`\hat k(I^{-1}) = I (1 + (I/\tau)^a)^{-1}`.

        I, ``(u, m, m)``, are the matrices by which a method integrates over steps; `power` gives
        their powers by exponents in (-1, 1).
        """
        lasting = np.eye(integration.shape[-1]) + self.time**-self.order * power(self.order)
        return np.asarray(integration @ np.linalg.inv(lasting))


@dataclass(frozen=True, kw_only=True)
class PronyKernel:
    r"""The kernel :math:`k(t) = \sum_i g_i e^{-x_i t}`: point masses; it needs no quadrature.

    .. math:: \hat k(s) = \sum_i \frac{g_i}{s + x_i}

    Raises
    ------
    ValueError
        If there are no pairs.
    """

    masses: tuple[tuple[float, float], ...]  # pairs of a rate x_i > 0 (1/time) and a weight g_i > 0
    peak = None  # there is no density
    start_order = None  # the kernel is smooth at 0

    def __post_init__(self) -> None:
        if not self.masses:
            raise ArgumentError("moduli", "at least one is needed")

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


RelaxationKernel = ColeCole | PronyKernel
"""The kernel k of a law; the integrator treats equal values as one kernel."""


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


def positive(value: float, name: str, *, below: float = math.inf) -> float:
    """A number that must be positive and below a bound; a complaint gives its name."""
    if not 0 < value < below:
        limit = "positive and finite" if below == math.inf else f"in (0, {below:g})"
        raise ArgumentError(name, f"{value!r} is not allowed; it must be {limit}")
    return float(value)
