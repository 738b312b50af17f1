"""Kinetic energy with a constant mass matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.matrices import Array, is_diagonal, symmetric_matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class Inertia:
    r"""Kinetic energy :math:`T(v) = v^T M v / 2`.

    Parameters
    ----------
    mass
        Symmetric positive definite matrix M, shape ``(d, d)``; a number is a 1 x 1 matrix.

    Raises
    ------
    ValueError
        If the matrix is not symmetric positive definite.
    """

    mass: Array

    def __post_init__(self) -> None:
        mass = symmetric_matrix(self.mass, "mass")
        smallest = float(np.linalg.eigvalsh(mass)[0])
        if not smallest > 0:
            raise ValueError(
                f"mass: smallest eigenvalue is {smallest:g}; a mass must be positive definite"
            )
        object.__setattr__(self, "mass", mass)

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.mass.shape[0])

    def velocity(self, momentum: Array) -> Array:
        """M^-1 p, shape ``(..., d)`` to the same."""
        if is_diagonal(self.mass):
            return np.asarray(momentum / np.diagonal(self.mass))
        columns = momentum.reshape(-1, self.dimension).T
        return np.asarray(np.linalg.solve(self.mass, columns).T.reshape(momentum.shape))
