"""What forces along a matrix have in common: fractional damping and relaxation laws."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import Factored, Form, SparseMatrix, dense, is_zero, symmetric_form
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class MatrixForce:
    """A force that is a symmetric matrix times something made of every coordinate's motion.

    Parameters
    ----------
    coefficient
        The number or matrix, shape ``(d, d)``, dense, sparse or in factors.
    form, factored
        In place of it, as another force keeps it: for :func:`dataclasses.replace`.

    Attributes
    ----------
    form
        The matrix as it is kept.
    factored
        Its factors where it acts along a few directions only; None: along all coordinates.

    Raises
    ------
    ValueError
        If the matrix is not symmetric and finite.
    TypeError
        If there is none.
    """

    form: Form
    factored: Factored | None = None

    def __init__(
        self,
        *,
        coefficient: ArrayLike | SparseMatrix | Factored | None = None,
        form: Form | None = None,
        factored: Factored | None = None,
    ) -> None:
        if coefficient is not None:
            factored = coefficient if isinstance(coefficient, Factored) else None
            whole = coefficient.form if isinstance(coefficient, Factored) else coefficient
            form = symmetric_form(whole, "coefficient")
        if form is None:
            raise TypeError("coefficient: it is missing")
        object.__setattr__(self, "form", form)
        object.__setattr__(self, "factored", factored)

    @property
    def coefficient(self) -> Array:
        """The matrix with all its zeros, shape ``(d, d)``."""
        return dense(self.form)

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.form.shape[0])

    @property
    def is_active(self) -> bool:
        """Whether the force does anything: its matrix is not zero."""
        return not is_zero(self.form)
