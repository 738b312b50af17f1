"""Potential energies: quadratic, or given by expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import (
    Form,
    SparseMatrix,
    added,
    dense,
    is_diagonal,
    symmetric_form,
    times,
)
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class QuadraticPotential:
    r"""Potential energy :math:`V(q) = q^T K q / 2` with a symmetric, possibly indefinite K.

    Parameters
    ----------
    stiffness
        The matrix K, shape ``(d, d)``, dense or sparse; a number is a 1 x 1 matrix.

    Attributes
    ----------
    form
        K as it is kept.
    """

    form: Form

    def __init__(self, *, stiffness: ArrayLike | SparseMatrix) -> None:
        object.__setattr__(self, "form", symmetric_form(stiffness, "stiffness"))

    @property
    def stiffness(self) -> Array:
        """K with all its zeros, shape ``(d, d)``."""
        return dense(self.form)

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.form.shape[0])

    def energy(self, position: Array) -> Array:
        """V at `position`, shape ``(..., d)`` to ``(...)``."""
        return np.asarray(0.5 * np.einsum("...i,...i->...", position, self.gradient(position)))

    def gradient(self, position: Array) -> Array:
        """K q, shape ``(..., d)`` to ``(..., d)``."""
        if isinstance(self.form, np.ndarray) and is_diagonal(self.form):
            return position * np.diagonal(self.form)
        return times(position, self.form)

    def hessian(self, position: Array) -> Array:
        """K at every position, shape ``(..., d)`` to ``(..., d, d)``."""
        return np.broadcast_to(self.stiffness, (*position.shape[:-1], *self.stiffness.shape))


@dataclass(frozen=True, kw_only=True, eq=False)
class ExpressionPotential:
    """Potential energy V(q) given by expressions for V, its gradient and its Hessian.

    The expressions work on arrays and, through `gradient_components`, on any algebra that brings
    its own elementary functions (truncated power series, extended precision).

    Parameters
    ----------
    coordinates
        Names of the d coordinates, in the order of the components of q.
    parameters
        Values of the other names in the expressions.
    energy_expression, gradient_expressions, hessian_expressions
        V, its d first derivatives, and its d x d second derivatives.

    Raises
    ------
    ValueError
        If the numbers of expressions and coordinates do not match.
    """

    coordinates: tuple[str, ...]
    energy_expression: Expression
    gradient_expressions: tuple[Expression, ...]
    hessian_expressions: tuple[tuple[Expression, ...], ...]
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        d = len(self.coordinates)
        if len(self.gradient_expressions) != d:
            raise ValueError(f"gradient: {len(self.gradient_expressions)} entries, expected {d}")
        if [len(row) for row in self.hessian_expressions] != [d] * d:
            raise ValueError(f"hessian: must be {d} rows of {d} expressions")

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return len(self.coordinates)

    def _names(self, position: Array) -> dict[str, Array]:
        names: dict[str, Array] = {k: np.asarray(v) for k, v in self.parameters.items()}
        for index, coordinate in enumerate(self.coordinates):
            names[coordinate] = position[..., index]
        return names

    def energy(self, position: Array) -> Array:
        """V at `position`, shape ``(..., d)`` to ``(...)``."""
        value = self.energy_expression.evaluate(self._names(position), NUMPY_FUNCTIONS)
        return np.broadcast_to(value, position.shape[:-1])

    def gradient(self, position: Array) -> Array:
        """dV/dq, shape ``(..., d)`` to ``(..., d)``."""
        names = self._names(position)
        result = np.empty(position.shape)
        for index, expression in enumerate(self.gradient_expressions):
            result[..., index] = expression.evaluate(names, NUMPY_FUNCTIONS)
        return result

    def hessian(self, position: Array) -> Array:
        """Second derivatives, shape ``(..., d)`` to ``(..., d, d)``."""
        names = self._names(position)
        result = np.empty((*position.shape, self.dimension))
        for i, row in enumerate(self.hessian_expressions):
            for j, expression in enumerate(row):
                result[..., i, j] = expression.evaluate(names, NUMPY_FUNCTIONS)
        return result

    def gradient_components(
        self, position: Sequence[T], functions: Mapping[str, Callable[[T], T]]
    ) -> list[T | float]:
        """dV/dq on any algebra: d values to d values (numbers where an entry is constant)."""
        names: dict[str, T | float] = {**self.parameters}
        names.update(zip(self.coordinates, position, strict=True))
        return [e.evaluate(names, functions) for e in self.gradient_expressions]


Potential = QuadraticPotential | ExpressionPotential


def with_stiffness(potential: Potential | None, stiffness: Form) -> Potential:
    r"""The potential with :math:`q^T K q / 2` added for a matrix K."""
    if potential is None:
        return QuadraticPotential(stiffness=stiffness)
    if isinstance(potential, QuadraticPotential):
        return QuadraticPotential(stiffness=added(potential.form, stiffness))
    names, matrix = potential.coordinates, dense(stiffness)

    def plus(expression: Expression, *terms: str) -> Expression:
        text = " + ".join([f"({expression.text})", *(one for one in terms if one)])
        return Expression.parse(text, variables=(*names, *potential.parameters))

    pulls = [linear_text(row, names) for row in matrix]
    return replace(
        potential,
        energy_expression=plus(potential.energy_expression, quadratic_text(matrix, names)),
        gradient_expressions=tuple(map(plus, potential.gradient_expressions, pulls)),
        hessian_expressions=tuple(
            tuple(
                plus(entry, repr(float(value)) if value else "")
                for entry, value in zip(entries, row, strict=True)
            )
            for entries, row in zip(potential.hessian_expressions, matrix, strict=True)
        ),
    )


def linear_text(row: Array, names: Sequence[str]) -> str:
    """The sum of numbers times names as a formula; empty for zeros."""
    return " + ".join(f"({float(a)!r})*{x}" for a, x in zip(row, names, strict=True) if a)


def quadratic_text(matrix: Array, names: Sequence[str]) -> str:
    r"""The formula :math:`q^T K q / 2`; empty for zeros."""
    pulls = [(x, linear_text(row, names)) for x, row in zip(names, matrix, strict=True)]
    return " + ".join(f"0.5*{x}*({pull})" for x, pull in pulls if pull)
