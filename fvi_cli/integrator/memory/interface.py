"""The interface of a memory, for all methods: tables of equal steps, force and new states.

Shapes: q members, e components, m samples of the force and i inputs of a step, J states, B steps,
K terms. Inputs drive the memory: velocities at the stages of Runge-Kutta methods, the unknowns of
a step for backward differences. A *lag sequence* ``(..., B, a, b)`` is the first block column of a
lower block-triangular Toeplitz matrix ``(..., B a, B b)``; the lag sequence of fewer steps
is a leading slice of it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fvi_cli.effects.matrices import Form, times
from fvi_cli.mathematics.arrays import Array, Integers


def toeplitz_matrix(lags: Array) -> Array:
    """The whole matrix ``(..., B a, B b)`` of a lag sequence ``(..., B, a, b)``."""
    *lead, n, a, b = lags.shape
    if n == 1:
        return np.asarray(lags[..., 0, :, :])
    padded = np.zeros((*lead, 2 * n - 1, a, b))
    padded[..., n - 1 :, :, :] = lags
    window = sliding_window_view(padded, n, axis=-3)[..., ::-1]
    whole = np.ascontiguousarray(np.moveaxis(window, -1, -2))
    return np.asarray(whole.reshape(*lead, n * a, n * b))


def along(values: Array, matrix: Form) -> Array:
    """Values ``(q, n, e)`` times the matrix of every member."""
    if not isinstance(matrix, np.ndarray) or matrix.ndim == 2:
        return times(values, matrix)
    if matrix.shape[-1] == 1:
        return values * matrix
    return np.asarray(np.matmul(values, matrix))


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    """A matrix of every member, and the sum of the terms that act along it."""

    places: Integers  # numbers of its terms in the memory, (q or 1, n)
    factors: Array  # their coefficients, relative to that of the first one, (q or 1, n)
    # D with the coefficient of the first term, symmetric, (q, e, e); (e, e) of one large structure
    matrix: Form
    is_relative: bool = False  # whether the start velocity is subtracted

    def combine(self, by_term: Array) -> Array:
        """Combine values that are given for every term, ``(K, ...)`` to ``(q or 1, ...)``."""
        if self.places.size == 1 and self.factors.item() == 1.0:
            return np.asarray(by_term[self.places[0]])
        factors = self.factors.reshape(*self.factors.shape, *(1,) * (by_term.ndim - 1))
        return np.asarray((factors * by_term[self.places]).sum(axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Kernels(ABC):
    r"""Tables of the memory for B equal steps.

    The force of the past, a sum over directions c with the states :math:`z_c` on which each acts,
    and the states after the steps are linear in states z and inputs U,

    .. math:: F = \sum_c R_c\, z_c D_c, \qquad z' = P z + Q U.

    The same tables serve any leading part of the steps.
    """

    count: int  # number B of steps
    directions: tuple[Direction, ...]
    # for every direction, from inputs to forces: lag sequences (q or 1, B, m, i)
    sequences: tuple[Array, ...]
    column: Array  # inputs of a start velocity of -1 in every step, (i,)

    @property
    def n_samples(self) -> int:
        """Number m of samples of the force in a step."""
        return int(self.sequences[0].shape[2])

    @property
    def n_inputs(self) -> int:
        """Number i of inputs of a step."""
        return int(self.column.size)

    @cached_property
    def offsets(self) -> tuple[Array, ...]:
        """For every direction the force of a velocity of -1 in these steps, ``(q or 1, B m)``."""
        return tuple(
            np.cumsum(one @ self.column, axis=1).reshape(len(one), -1) for one in self.sequences
        )

    @cached_property
    def local(self) -> tuple[Array, ...]:
        """For every direction, from inputs of the block to its forces, ``(q or 1, B m, B i)``."""
        return tuple(toeplitz_matrix(one) for one in self.sequences)

    @abstractmethod
    def past(self, states: Sequence[Array], count: int) -> Array:
        """Force of the past on the first `count` steps, ``(q, count m, e)``.

        For every direction the states on which it acts, ``(q, J, e)``; at most B steps.
        """

    def present(self, inputs: Array, count: int) -> Array:
        """Force of the inputs ``(q, count i, e)`` of the first steps on these steps."""
        size = count * self.n_samples
        return sum(
            (
                along(np.matmul(local[:, :size, : inputs.shape[-2]], inputs), one.matrix)
                for local, one in zip(self.local, self.directions, strict=True)
            ),
            start=np.zeros(()),
        )

    @abstractmethod
    def push(self, states: Array, inputs: Array, count: int) -> Array:
        """States ``(q, J, e)`` after the first `count` steps, with inputs ``(q, count i, e)``."""

    @abstractmethod
    def change_of_all(self, count: int) -> Array:
        """The matrix P - 1 by which undriven states change over `count` steps, ``(J, J)``."""
