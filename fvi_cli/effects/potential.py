"""Potential energies: quadratic, or given by expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import (
    Form,
    MatrixEffect,
    SparseMatrix,
    added,
    dense,
    is_diagonal,
    symmetric_form,
    times,
)
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.algebra.at_points import PointFormulas
from fvi_cli.mathematics.algebra.builder import join
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression, slopes_system

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class QuadraticPotential(MatrixEffect):
    r"""Potential energy :math:`V(q) = q^T K q / 2` with a symmetric, possibly indefinite K.

    Parameters
    ----------
    stiffness
        The matrix K, shape ``(d, d)``, dense or sparse; a number is a 1 x 1 matrix.
    """

    def __init__(self, *, stiffness: ArrayLike | SparseMatrix) -> None:
        object.__setattr__(self, "form", symmetric_form(stiffness, "stiffness"))

    @property
    def stiffness(self) -> Array:
        """K with all its zeros, shape ``(d, d)``."""
        return dense(self.form)

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
    r"""Potential energy V(q) by formulas for V, its gradient and its Hessian.

    The formulas work on arrays and, through `gradient_components`, on any algebra that brings its
    own elementary functions (truncated power series, intervals).

    Parameters
    ----------
    coordinates
        Names of the d coordinates, in the order of the components of q.
    parameters
        Values of the other names in the expressions: numbers, or arrays that broadcast with the
        components of positions.
    energy_expression, gradient_expressions, hessian_expressions
        V, its d first derivatives, and its d x d second derivatives; None: differentiated here.
    stiffness
        A matrix K whose :math:`q^T K q / 2` is added to V.

    Raises
    ------
    ValueError
        If the numbers of expressions and coordinates do not match.
    """

    coordinates: tuple[str, ...]
    energy_expression: Expression
    gradient_expressions: tuple[Expression, ...] | None = None
    hessian_expressions: tuple[tuple[Expression, ...], ...] | None = None
    parameters: Mapping[str, float | Array] = field(default_factory=dict)
    stiffness: Form | None = None

    def __post_init__(self) -> None:
        d = len(self.coordinates)
        first, second = self.gradient_expressions, self.hessian_expressions
        if first is not None and len(first) != d:
            raise ArgumentError("gradient", f"{len(first)} entries, expected {d}")
        if second is not None and [len(row) for row in second] != [d] * d:
            raise ArgumentError("hessian", f"must be {d} rows of {d} expressions")

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return len(self.coordinates)

    @cached_property
    def gradient_system(self) -> FormulaSystem:
        """The formulas of dV/dq, without the stiffness."""
        if self.gradient_expressions is not None:
            return join(*(one.system for one in self.gradient_expressions))
        return slopes_system(self.energy_expression.system, self.coordinates)[1:]

    @cached_property
    def hessian_system(self) -> FormulaSystem:
        """The formulas of the second derivatives row by row, without the stiffness."""
        if self.hessian_expressions is not None:
            return join(*(one.system for row in self.hessian_expressions for one in row))
        # they stand direction by direction, and are symmetric
        return slopes_system(self.gradient_system, self.coordinates)[self.dimension :]

    def __getstate__(self) -> dict[str, object]:
        """What is pickled: all but compiled programs."""
        return {name: value for name, value in vars(self).items() if name != "_programs"}

    @cached_property
    def _programs(self) -> tuple[PointFormulas, ...]:
        """V, its gradient and its Hessian at points."""
        systems = (self.energy_expression.system, self.gradient_system, self.hessian_system)
        return tuple(PointFormulas(one, self.coordinates, self.parameters) for one in systems)

    @cached_property
    def _stiffness(self) -> Array | None:
        return None if self.stiffness is None else dense(self.stiffness)

    def evaluate(
        self,
        system: FormulaSystem,
        position: Array,
        parameters: Mapping[str, float | Array] | None = None,
    ) -> list[Array | float]:
        """Values of a program in the coordinates and, if not these, other parameters."""
        names: dict[str, Array | float] = {**(parameters or self.parameters)}
        for index, coordinate in enumerate(self.coordinates):
            names[coordinate] = position[..., index]
        return system.evaluate(names, NUMPY_FUNCTIONS)

    @np.errstate(all="ignore")
    def energy(self, position: Array) -> Array:
        """V at `position`, shape ``(..., d)`` to ``(...)``."""
        found = self._programs[0](position)[..., 0]
        if self.stiffness is None:
            return found
        force = times(position, self.stiffness)
        return np.asarray(found + 0.5 * np.einsum("...i,...i->...", position, force))

    @np.errstate(all="ignore")
    def gradient(self, position: Array) -> Array:
        """dV/dq, shape ``(..., d)`` to ``(..., d)``."""
        return self.slopes(position)

    def slopes(self, position: Array) -> Array:
        """The gradient; floating-point errors are treated as the caller's ``np.errstate`` says."""
        found = self._programs[1](position)
        return found if self.stiffness is None else found + times(position, self.stiffness)

    @np.errstate(all="ignore")
    def hessian(self, position: Array) -> Array:
        """Second derivatives, shape ``(..., d)`` to ``(..., d, d)``."""
        found = self._programs[2](position).reshape(*position.shape, self.dimension)
        return found if self._stiffness is None else found + self._stiffness

    def gradient_components(
        self, position: Sequence[T], functions: Mapping[str, Callable[..., T]]
    ) -> list[T | float]:
        """dV/dq on any algebra: d values to d values (numbers where an entry is constant)."""
        names: dict[str, Any] = {**self.parameters}
        names.update(zip(self.coordinates, position, strict=True))
        found = self.gradient_system.evaluate(names, functions)
        return found if self._stiffness is None else plus_linear(found, self._stiffness, position)


Potential = QuadraticPotential | ExpressionPotential


def plus_linear(values: Sequence[Any], matrix: Array, position: Sequence[Any]) -> list[Any]:
    """The values plus K q, on any algebra."""
    return [
        sum((float(a) * x for a, x in zip(row, position, strict=True) if a), value)
        for value, row in zip(values, matrix, strict=True)
    ]


def with_stiffness(potential: Potential | None, stiffness: Form) -> Potential:
    r"""The potential with :math:`q^T K q / 2` added for a matrix K."""
    if potential is None:
        return QuadraticPotential(stiffness=stiffness)
    if isinstance(potential, QuadraticPotential):
        return QuadraticPotential(stiffness=added(potential.form, stiffness))
    own = potential.stiffness
    return replace(potential, stiffness=stiffness if own is None else added(own, stiffness))
