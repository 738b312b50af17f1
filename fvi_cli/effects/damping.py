"""Forces with a coefficient matrix: their common base class, and fractional damping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import (
    Factored,
    Form,
    MatrixEffect,
    SparseMatrix,
    dense,
    entries,
    is_sparse,
    symmetric_form,
)
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array

Coefficient = ArrayLike | SparseMatrix | Factored
"""A number or a symmetric matrix, dense, sparse or in factors."""

SAME = 1e-14
"""Matrices have the same direction if their entries differ by no more than this, relatively."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MatrixForce(MatrixEffect):
    """A force that is a symmetric matrix times one functional of each coordinate's motion.

    Raises
    ------
    ValueError
        If the matrix is not symmetric and finite.
    """

    # a number, a matrix (d, d), dense or sparse, or its factors; a number is kept as a matrix
    coefficient: Coefficient
    name: str = ""  # name of the force in formulas
    number: int = 0  # place among the dampers of a scene, from 1; forces with 0 come last
    storeys: tuple[int, ...] = ()  # parts between which a damper stands, from 1; empty: all
    form: Form = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.factored is None:
            form = symmetric_form(cast(ArrayLike, self.coefficient), "coefficient")
            object.__setattr__(self, "coefficient", form)
        object.__setattr__(self, "form", self.factored.form if self.factored else form)

    @property
    def factored(self) -> Factored | None:
        """The factors, if the matrix was given by them."""
        return self.coefficient if isinstance(self.coefficient, Factored) else None

    @property
    def matrix(self) -> Array:
        """The matrix with all its zeros, shape ``(d, d)``."""
        return dense(self.form)

    @property
    def inner(self) -> Form:
        """The matrix that acts on the deformation, shape ``(c, c)``."""
        return self.form if self.factored is None else self.factored.inner

    def deformation(self, motion: Array) -> Array:
        """The deformation y = B q that the force acts on, from ``(..., d)`` to ``(..., c)``."""
        return motion if self.factored is None else np.asarray(motion @ self.factored.rows.T)

    @cached_property
    def is_active(self) -> bool:
        """Whether the force does anything: its matrix is not zero."""
        return bool(entries(self.form).any())

    @cached_property
    def scale_and_direction(self) -> tuple[float, Form]:
        """The coefficient matrix as a number times a matrix whose largest entry is 1."""
        kept = entries(self.form)
        scale = float(kept[np.abs(kept).argmax()])
        return scale, (1.0 / scale) * self.form


def is_same_direction(a: Form, b: Form) -> bool:
    """Whether two matrices from `MatrixForce.scale_and_direction` are equal up to round-off."""
    if a.shape != b.shape or is_sparse(a) != is_sparse(b):
        return False
    if is_sparse(a) and not all(map(np.array_equal, a.nonzero(), b.nonzero())):
        return False
    return bool(np.allclose(entries(a), entries(b), rtol=SAME, atol=0))


def distinct_directions(forces: Sequence[MatrixForce]) -> list[Form]:
    """The matrices of forces without their scales, each different one once."""
    found: list[Form] = []
    for _, direction in (force.scale_and_direction for force in forces):
        if not any(is_same_direction(other, direction) for other in found):
            found.append(direction)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class FractionalDamping(MatrixForce):
    r"""The force :math:`-\mu D^{\gamma} q`.

    The order is the one **that stands in the equation of motion**; the paper writes it
    :math:`\alpha + \beta = 2\alpha`. The coefficient :math:`\mu` may be indefinite: negative
    damping is a legitimate scene.

    Raises
    ------
    ValueError
        If the order lies outside (0, 2) or the matrix is not symmetric.
    """

    order: float

    def __post_init__(self) -> None:
        if not 0.0 < self.order < 2.0:
            raise ArgumentError("order", f"{self.order!r} is not allowed; it must lie in (0, 2)")
        super().__post_init__()
        object.__setattr__(self, "order", float(self.order))

    @property
    def is_integer_order(self) -> bool:
        """Whether the derivative is the classical one, which has no memory."""
        return self.order == 1.0

    def symbol(self, s: complex) -> complex:
        r"""Factor of the derivative on :math:`e^{st}`: :math:`s^\gamma`, on the principal branch.

        The force of a scene on :math:`q = v e^{st}` is minus the sum over its damping terms of
        symbol times matrix times v.
        """
        return s**self.order
