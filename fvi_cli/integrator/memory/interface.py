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
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fvi_cli.effects.matrices import Form, times
from fvi_cli.integrator.memory.kernel import Term
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


class Memory(Protocol):
    """The part of a memory that combinations of terms need."""

    terms: tuple[Term, ...]  # its terms, each once
    weights: Array  # factors of states in the force of each term, (K, J); (K, 0) for Lags


@dataclass(frozen=True, kw_only=True, eq=False)
class Combination:
    """A sum of terms that act along one matrix of every member."""

    places: Integers  # numbers of its terms in the memory, (q or 1, n)
    factors: Array  # their coefficients, relative to that of the first one, (q or 1, n)
    # D with the coefficient of the first term, symmetric, (q, e, e); (e, e) of one large structure
    matrix: Form
    # factors of exponentials in the force, (q or 1, J); (q or 1, 0) where the memory has none
    weights: Array
    is_relative: bool  # whether the start velocity is subtracted

    @classmethod
    def of_terms(
        cls,
        memory: Memory,
        terms: Sequence[Sequence[Term]],
        factors: Array,
        matrix: Form,
        *,
        is_relative: bool = False,
    ) -> Combination:
        """The combination of terms of the memory, a row for every member or one for all."""
        index = {term: place for place, term in enumerate(memory.terms)}
        places = np.array([[index[term] for term in row] for row in terms])
        combination = cls(
            places=places[:1] if (places == places[0]).all() else places,
            factors=factors[:1] if (factors == factors[0]).all() else factors,
            matrix=matrix,
            weights=np.zeros((1, 0)),
            is_relative=is_relative,
        )
        return replace(combination, weights=combination.combine(memory.weights))

    def combine(self, by_term: Array) -> Array:
        """Combine values that are given for every term, ``(K, ...)`` to ``(q or 1, ...)``."""
        if self.places.size == 1 and self.factors.item() == 1.0:
            return np.asarray(by_term[self.places[0]])
        factors = self.factors.reshape(*self.factors.shape, *(1,) * (by_term.ndim - 1))
        return np.asarray((factors * by_term[self.places]).sum(axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Kernels(ABC):
    r"""Tables of the memory for B equal steps.

    The force of the past, a sum over combinations c with the states :math:`z_c` on which each acts,
    and the states after the steps are linear in states z and inputs U,

    .. math:: F = \sum_c R_c\, z_c D_c, \qquad z' = P z + Q U.

    The same tables serve any leading part of the steps.
    """

    count: int  # number B of steps
    sequence: Array  # from inputs to the force of every term, lag sequences (K, B, m, i)

    @property
    def n_samples(self) -> int:
        """Number m of samples of the force in a step."""
        return int(self.sequence.shape[2])

    @property
    def n_inputs(self) -> int:
        """Number i of inputs of a step."""
        return int(self.sequence.shape[3])

    @abstractmethod
    def past(
        self, states: Sequence[Array], combinations: Sequence[Combination], count: int
    ) -> Array:
        """Force of the past on the first `count` steps, ``(q, count m, e)``.

        At least one combination, and the states on which each acts, ``(q, J, e)``; at most B steps.
        """

    @abstractmethod
    def push(self, states: Array, inputs: Array, count: int) -> Array:
        """States ``(q, J, e)`` after the first `count` steps, with inputs ``(q, count i, e)``."""

    @abstractmethod
    def change_of_all(self, count: int) -> Array:
        """The matrix P - 1 by which undriven states change over `count` steps, ``(J, J)``."""
