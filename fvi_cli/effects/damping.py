"""Fractional damping, one term of the right-hand side."""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.effects.matrices import Array, symmetric_matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class FractionalDamping:
    r"""The force :math:`-\mu D^{\gamma} q`.

    Parameters
    ----------
    order
        The order :math:`\gamma` in (0, 2) **as it stands in the equation of motion**; the paper
        writes it :math:`\alpha + \beta = 2\alpha`.
    coefficient
        The number or symmetric matrix :math:`\mu`, shape ``(d, d)``. It may be indefinite: negative
        damping is a legitimate scene.

    Raises
    ------
    ValueError
        If the order lies outside (0, 2) or the matrix is not symmetric.
    """

    order: float
    coefficient: Array

    def __post_init__(self) -> None:
        if not 0.0 < self.order < 2.0:
            raise ValueError(f"order: {self.order!r} is not allowed; it must lie in (0, 2)")
        object.__setattr__(self, "order", float(self.order))
        object.__setattr__(self, "coefficient", symmetric_matrix(self.coefficient, "coefficient"))

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.coefficient.shape[0])

    @property
    def is_integer_order(self) -> bool:
        """Whether the derivative is the classical one, which has no memory."""
        return self.order == 1.0
