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
    SparseMatrix,
    added,
    dense,
    is_diagonal,
    symmetric_form,
    times,
)
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.algebra.builder import joined
from fvi_cli.mathematics.algebra.derivatives import derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
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
            return joined(*(one.system for one in self.gradient_expressions))
        along = [{name: 1.0} for name in self.coordinates]
        return derivatives(self.energy_expression.system, along)[1:]

    @cached_property
    def hessian_system(self) -> FormulaSystem:
        """The formulas of the second derivatives row by row, without the stiffness."""
        if self.hessian_expressions is not None:
            return joined(*(one.system for row in self.hessian_expressions for one in row))
        along = [{name: 1.0} for name in self.coordinates]
        # they stand direction by direction, and are symmetric
        return derivatives(self.gradient_system, along)[self.dimension :]

    @cached_property
    def _every(self) -> FormulaSystem:
        return joined(self.energy_expression.system, self.gradient_system, self.hessian_system)

    @cached_property
    def _stiffness(self) -> Array | None:
        return None if self.stiffness is None else dense(self.stiffness)

    @cached_property
    def _numbers(self) -> dict[str, Array]:
        return {name: np.asarray(value, dtype=float) for name, value in self.parameters.items()}

    def evaluate(
        self,
        system: FormulaSystem,
        position: Array,
        parameters: Mapping[str, float | Array] | None = None,
    ) -> list[Array | float]:
        """Values of a program in the coordinates and, if not these, other parameters."""
        return system.evaluate(
            {**(parameters or self.parameters), **self._components(position)}, NUMPY_FUNCTIONS
        )

    def _components(self, position: Array) -> dict[str, Array]:
        # contiguous: vector instructions do the same to every member, wherever it stands
        return {
            name: np.ascontiguousarray(position[..., index])
            for index, name in enumerate(self.coordinates)
        }

    def _run(
        self, system: FormulaSystem, position: Array, parameters: Mapping[str, Array] | None = None
    ) -> list[Array | float]:
        given = self._components(position)
        given.update(self._numbers if parameters is None else parameters)
        return system.run(given)

    @np.errstate(all="ignore")
    def energy(self, position: Array) -> Array:
        """V at `position`, shape ``(..., d)`` to ``(...)``."""
        return self._energy(self._run(self.energy_expression.system, position), position)

    @np.errstate(all="ignore")
    def gradient(self, position: Array) -> Array:
        """dV/dq, shape ``(..., d)`` to ``(..., d)``."""
        return self.slopes(position)

    @np.errstate(all="ignore")
    def hessian(self, position: Array) -> Array:
        """Second derivatives, shape ``(..., d)`` to ``(..., d, d)``."""
        return self._hessian(self._run(self.hessian_system, position), position)

    def slopes(self, position: Array, parameters: Mapping[str, Array] | None = None) -> Array:
        """The gradient, quickly, with arguments and rules of :meth:`derivatives`."""
        return self._gradient(self._run(self.gradient_system, position, parameters), position)

    def derivatives(
        self, position: Array, parameters: Mapping[str, Array] | None = None
    ) -> tuple[Array, Array, Array]:
        """V, its gradient and its Hessian by one program.

        Positions ``(q, n, d)`` of q members go with parameters ``(q, 1)``; without any, the own
        ones are taken. Values of a member are the same to the last bit whatever others stand
        beside it. Floating-point errors are treated as the caller's ``np.errstate`` says.
        """
        values, d = self._run(self._every, position, parameters), self.dimension
        return (
            self._energy(values[:1], position),
            self._gradient(values[1 : d + 1], position),
            self._hessian(values[d + 1 :], position),
        )

    def _energy(self, values: Sequence[Array | float], position: Array) -> Array:
        found = _filled(values, position)
        if self.stiffness is None:
            return found
        pull = times(position, self.stiffness)
        return np.asarray(found + 0.5 * np.einsum("...i,...i->...", position, pull))

    def _gradient(self, values: Sequence[Array | float], position: Array) -> Array:
        result = _filled(values, position, self.dimension)
        return result if self.stiffness is None else result + times(position, self.stiffness)

    def _hessian(self, values: Sequence[Array | float], position: Array) -> Array:
        result = _filled(values, position, self.dimension, self.dimension)
        return result if self._stiffness is None else result + self._stiffness

    def gradient_components(
        self, position: Sequence[T], functions: Mapping[str, Callable[..., T]]
    ) -> list[T | float]:
        """dV/dq on any algebra: d values to d values (numbers where an entry is constant)."""
        names: dict[str, Any] = {**self.parameters}
        names.update(zip(self.coordinates, position, strict=True))
        found = self.gradient_system.evaluate(names, functions)
        return found if self._stiffness is None else plus_linear(found, self._stiffness, position)


Potential = QuadraticPotential | ExpressionPotential


def _filled(values: Sequence[Array | float], position: Array, *shape: int) -> Array:
    """Values at positions ``(..., d)`` as one array ``(..., *shape)``."""
    points = position.shape[:-1]
    only = values[0]
    is_whole = len(values) == 1 and isinstance(only, np.ndarray) and only.shape == points
    # an array with a base is the position itself
    if is_whole and only.base is None:  # type: ignore[union-attr]
        return np.asarray(only).reshape(points + shape)
    result = np.zeros((*points, len(values)))
    for index, value in enumerate(values):
        if not isinstance(value, float) or value:
            result[..., index] = value
    return result.reshape(points + shape)


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
