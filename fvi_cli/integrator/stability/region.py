r"""Stability of many scalar scenes at once: of the modes of a large scene, and of a plane.

A step of :math:`m x'' + \mu D^\gamma x + k x` knows the scene by :math:`\kappa = h^2 k / m` and
:math:`\delta = h^{2 - \gamma} \mu / m` only, so that a method has one stability region for each
order :math:`\gamma`, in the plane of these two, as a method for :math:`x' = \lambda x` has one in
the plane of :math:`h \lambda`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.determinant import (
    MatrixPencil,
    dimensionless_forms,
    log_determinants,
)
from fvi_cli.integrator.stability.patterns import DAMPING, Patterns, pattern_size, step_patterns
from fvi_cli.mathematics.arrays import Array, ComplexArray, Integers
from fvi_cli.mathematics.transforms.many_discs import UNDECIDED, count_zeros_of_many

GROWTH_LEVELS = (1e-3, 1e-2, 1e-1, 1.0)
"""Growth per step, as logarithms, between which a map tells the points of the plane apart."""

_AT_ONCE = 200_000
_NEGLIGIBLE = 1e-11


@dataclass(frozen=True, kw_only=True, eq=False)
class ModalFamily:
    """Step determinants of scalar systems with the same orders of damping.

    Parameters
    ----------
    patterns
        Of the method for these orders.
    forms
        Factors of the patterns, one row for each system.
    """

    patterns: Patterns
    forms: Array

    def part(self, functions: Integers) -> ModalFamily:
        """These systems only."""
        return ModalFamily(patterns=self.patterns, forms=self.forms[functions])

    def tabulate(self, z: ComplexArray) -> ComplexArray:
        """The patterns at each z."""
        return self.patterns(z)

    def all_logarithms(self, table: ComplexArray, functions: Integers) -> ComplexArray:
        """Logarithms of the determinants of these systems at every row."""
        rows = np.arange(table.shape[0])
        pairs = np.repeat(functions, rows.size), np.tile(rows, functions.size)
        parts = [
            self.logarithms(table[row], function)
            for function, row in zip(
                *(np.array_split(one, 1 + one.size // _AT_ONCE) for one in pairs), strict=True
            )
        ]
        return np.concatenate(parts).reshape(functions.size, rows.size)

    def logarithms(self, table: ComplexArray, functions: Integers) -> ComplexArray:
        """Logarithms of the determinants, one system for each row."""
        return log_determinants(np.einsum("ki...,ki->k...", table, self.forms[functions]))


def modal_family(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_size: float
) -> ModalFamily:
    """Scalar systems whose damping has the same orders, in a step of `method`.

    Raises
    ------
    ValueError
        If the orders differ.
    """
    orders = tuple(order for order, _ in systems[0].damping)
    if any(tuple(order for order, _ in system.damping) != orders for system in systems):
        raise ValueError("systems: their damping differs in its orders")
    forms = np.array([dimensionless_forms(system, step_size)[:, 0, 0] for system in systems])
    return ModalFamily(patterns=step_patterns(method, orders), forms=forms)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneFamily:
    r"""Step determinants as polynomials in :math:`\kappa` and :math:`\delta`.

    Parameters
    ----------
    patterns
        Of the method for the order of damping.
    powers
        Exponents (i, j) of the terms that occur.
    products
        :math:`\kappa^i \delta^j` of every point of the plane, shape ``(points, terms)``.
    """

    patterns: Patterns
    powers: tuple[tuple[int, int], ...]
    products: Array

    def tabulate(self, z: ComplexArray) -> ComplexArray:
        """The coefficients at each z."""
        coefficients = _plane_coefficients(self.patterns(z))
        return np.stack([coefficients[:, i, j] for i, j in self.powers], axis=1)

    def all_logarithms(self, table: ComplexArray, functions: Integers) -> ComplexArray:
        """Logarithms of the polynomials at these points for every row."""
        return np.asarray(np.log(self.products[functions] @ table.T))

    def logarithms(self, table: ComplexArray, functions: Integers) -> ComplexArray:
        """Logarithms of the polynomials, one point for each row."""
        return np.asarray(np.log(np.einsum("kt,kt->k", table, self.products[functions])))


def _plane_coefficients(patterns: ComplexArray) -> ComplexArray:
    """Coefficients of the determinant by its values on circles, shape ``(k, n + 1, n + 1)``."""
    n = patterns.shape[-1] + 1
    roots = np.exp(2j * np.pi * np.arange(n) / n)
    fixed = patterns[:, 0] + patterns[:, 1]
    matrices = (
        fixed[:, None, None]
        + roots[:, None, None, None] * patterns[:, None, None, 2]
        + roots[:, None, None] * patterns[:, None, None, DAMPING]
    )
    return np.asarray(np.fft.fft2(np.linalg.det(matrices), axes=(1, 2)) / n**2)


def plane_family(method: AnyMethod, order: float, stiffness: Array, damping: Array) -> PlaneFamily:
    """The family of the points (stiffness, damping) of the plane, one-dimensional arrays."""
    patterns = step_patterns(method, (order,))
    sample = np.asarray(0.9 * np.exp(1j * np.array([0.3, 1.1, 2.0, 2.9])), dtype=np.complex128)
    sizes = np.abs(_plane_coefficients(patterns(sample))).max(axis=0)
    powers = tuple((int(i), int(j)) for i, j in np.argwhere(sizes > _NEGLIGIBLE * sizes.max()))
    products = np.stack([stiffness**i * damping**j for i, j in powers], axis=1)
    return PlaneFamily(patterns=patterns, powers=powers, products=products)


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityMap:
    r"""Which points of the plane a method is stable at.

    Parameters
    ----------
    method, order
        The method, and the order of the damping.
    stiffness, damping
        The values of :math:`h^2 k / m` and :math:`\mu h^{2 - \gamma} / m`, increasing.
    level
        Number of the growths of :data:`GROWTH_LEVELS` that the worst mode exceeds, 0 where the
        method is stable, shape ``(damping, stiffness)``; -1 where that is not decided.
    """

    method: AnyMethod
    order: float
    stiffness: Array
    damping: Array
    level: Integers

    @property
    def share_stable(self) -> float:
        """Share of the points that are stable."""
        return float((self.level == 0).mean())


def stability_map(
    method: AnyMethod, order: float, stiffness: Array, damping: Array
) -> StabilityMap:
    r"""Growth of the worst mode over the plane of :math:`h^2 k / m` and :math:`\mu h^{2-\gamma}/m`.

    Parameters
    ----------
    method
        Any method with a determinant.
    order
        Order of the damping, in (0, 2).
    stiffness, damping
        Values to look at, not negative, increasing.

    Raises
    ------
    ValueError
        For values that do not increase or are negative.
    """
    for name, values in (("stiffness", stiffness), ("damping", damping)):
        if values.ndim != 1 or values.size == 0 or values[0] < 0 or np.any(np.diff(values) <= 0):
            raise ValueError(f"{name}: values must increase and not be negative")
    across, up = np.meshgrid(stiffness, damping)
    family = plane_family(method, order, across.ravel(), up.ravel())
    degree = pattern_size(method)
    level = np.zeros(across.size, dtype=np.int64)
    left = np.arange(across.size)
    for number, growth in enumerate(GROWTH_LEVELS):
        part = PlaneFamily(
            patterns=family.patterns, powers=family.powers, products=family.products[left]
        )
        counts = count_zeros_of_many(part, left.size, math.exp(-growth), degree)
        level[left[counts == UNDECIDED]] = UNDECIDED if number == 0 else number
        left = left[counts > 0]
        level[left] = number + 1
        if not left.size:
            break
    return StabilityMap(
        method=method,
        order=order,
        stiffness=stiffness,
        damping=damping,
        level=level.reshape(across.shape),
    )
