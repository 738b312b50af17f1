"""Kinetic energy with a constant mass matrix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import (
    MatrixEffect,
    Solve,
    SparseMatrix,
    dense,
    indefinite_words,
    solver,
    symmetric_form,
)
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class Inertia(MatrixEffect):
    r"""Kinetic energy :math:`T(v) = v^T M v / 2`.

    The mass is M, ``(d, d)``, dense or sparse; a number is a 1 x 1 matrix.

    Raises
    ------
    ValueError
        If the matrix is not symmetric positive definite beyond round-off.
    """

    def __init__(self, *, mass: ArrayLike | SparseMatrix) -> None:
        form = symmetric_form(mass, "mass")
        if wrong := indefinite_words(form):
            raise ArgumentError("mass", wrong)
        object.__setattr__(self, "form", form)

    @property
    def mass(self) -> Array:
        """M with all its zeros, shape ``(d, d)``."""
        return dense(self.form)

    @cached_property
    def _solve(self) -> Solve:
        return solver(self.form)

    def __getstate__(self) -> dict[str, object]:
        """What is pickled: not the factors of M, which cannot be sent to other processes."""
        return {"form": self.form}

    def velocity(self, momentum: Array) -> Array:
        """M^-1 p, shape ``(..., d)`` to the same."""
        if isinstance(self.form, np.ndarray) and np.equal(*self.form.nonzero()).all():
            return np.asarray(momentum / np.diagonal(self.form))
        columns = momentum.reshape(-1, self.dimension).T
        return np.asarray(self._solve(columns).T.reshape(momentum.shape))
