"""Forces along a matrix: what they have in common, and fractional damping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import (
    Factored,
    Form,
    MatrixEffect,
    SparseMatrix,
    as_csr,
    dense,
    entries,
    is_sparse,
    is_zero,
    scaled,
    symmetric_form,
)
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array

SAME = 1e-14
"""Entries of matrices of the same direction differ by no more than this part."""


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class MatrixForce(MatrixEffect):
    """A force that is a symmetric matrix times something made of every coordinate's motion.

    The matrix is given as coefficient, or as another force keeps it: its form, with the factors of
    one that acts along a few directions only.

    Raises
    ------
    ValueError
        If the matrix is not symmetric and finite.
    TypeError
        If there is none.
    """

    factored: Factored | None = None
    name: str = ""  # a word that formulas know it by
    number: int = 0  # place among the dampers of a scene, from 1; 0: behind those that have one

    def __init__(
        self,
        *,
        coefficient: ArrayLike | SparseMatrix | Factored | None = None,
        form: Form | None = None,
        factored: Factored | None = None,
        name: str = "",
        number: int = 0,
    ) -> None:
        if coefficient is not None:
            factored = coefficient if isinstance(coefficient, Factored) else None
            whole = coefficient.form if isinstance(coefficient, Factored) else coefficient
            form = symmetric_form(whole, "coefficient")
        if form is None:
            raise TypeError("coefficient: it is missing")
        object.__setattr__(self, "form", form)
        object.__setattr__(self, "factored", factored)
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "number", number)

    @property
    def coefficient(self) -> Array:
        """The matrix with all its zeros, shape ``(d, d)``."""
        return dense(self.form)

    @property
    def inner(self) -> Form:
        """The matrix that acts on the deformation, shape ``(c, c)``."""
        return self.form if self.factored is None else self.factored.inner

    def deformation(self, motion: Array) -> Array:
        """What the force acts on, y = B q, from ``(..., d)`` to ``(..., c)``."""
        return motion if self.factored is None else np.asarray(motion @ self.factored.rows.T)

    @cached_property
    def is_active(self) -> bool:
        """Whether the force does anything: its matrix is not zero."""
        return not is_zero(self.form)

    @cached_property
    def scale_and_direction(self) -> tuple[float, Form]:
        """The coefficient matrix as a number times a matrix whose largest entry is 1."""
        kept = entries(self.form)
        scale = float(kept[np.abs(kept).argmax()])
        return scale, scaled(self.form, 1.0 / scale)


def is_same_direction(a: Form, b: Form) -> bool:
    """Whether two matrices from `MatrixForce.scale_and_direction` are one."""
    if a.shape != b.shape or is_sparse(a) != is_sparse(b):
        return False
    if not isinstance(a, np.ndarray):
        one, other = as_csr(a), as_csr(b)
        if not (
            np.array_equal(one.indptr, other.indptr) and np.array_equal(one.indices, other.indices)
        ):
            return False
    return bool(np.allclose(entries(a), entries(b), rtol=SAME, atol=0))


def distinct_directions(forces: Sequence[MatrixForce]) -> list[Form]:
    """The matrices of forces without their scales, each once."""
    found: list[Form] = []
    for force in forces:
        _, direction = force.scale_and_direction
        if not any(is_same_direction(other, direction) for other in found):
            found.append(direction)
    return found


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class FractionalDamping(MatrixForce):
    r"""The force :math:`-\mu D^{\gamma} q`.

    Parameters
    ----------
    order
        The order :math:`\gamma` in (0, 2) **as it stands in the equation of motion**; the paper
        writes it :math:`\alpha + \beta = 2\alpha`.
    coefficient
        The number or symmetric matrix :math:`\mu`, shape ``(d, d)``, dense, sparse or in factors.
        It may be indefinite: negative damping is a legitimate scene.
    form, factored
        In place of it, as another term keeps it: for :func:`dataclasses.replace`.

    Raises
    ------
    ValueError
        If the order lies outside (0, 2) or the matrix is not symmetric.
    """

    order: float

    def __init__(
        self,
        *,
        order: float,
        coefficient: ArrayLike | SparseMatrix | Factored | None = None,
        form: Form | None = None,
        factored: Factored | None = None,
        name: str = "",
        number: int = 0,
    ) -> None:
        if not 0.0 < order < 2.0:
            raise ArgumentError("order", f"{order!r} is not allowed; it must lie in (0, 2)")
        super().__init__(
            coefficient=coefficient, form=form, factored=factored, name=name, number=number
        )
        object.__setattr__(self, "order", float(order))

    @property
    def is_integer_order(self) -> bool:
        """Whether the derivative is the classical one, which has no memory."""
        return self.order == 1.0

    def symbol(self, s: complex) -> complex:
        r"""What the derivative is on :math:`e^{st}`, :math:`s^\gamma` on the principal branch.

        The force of a scene on :math:`q = v e^{st}` is minus the sum over its damping terms of
        symbol times matrix times v.
        """
        return s**self.order
