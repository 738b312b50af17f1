"""Fractional damping, one term of the right-hand side."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import Factored, Form, SparseMatrix
from fvi_cli.effects.matrix_force import MatrixForce
from fvi_cli.errors import ArgumentError


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
