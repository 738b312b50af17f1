"""Potential energies: quadratic, given by formulas, or by functions of the user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import (
    Form,
    MatrixEffect,
    SparseMatrix,
    dense,
    symmetric_form,
    times,
)
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.builder import Builder
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, PointFormulas
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression, slopes_system


class Potential(Protocol):
    """A potential energy V(q) of d coordinates: any object with these three functions.

    Positions have the shape ``(..., d)``: one, or many at once. Functions of a user's object may
    return nan where V is not defined, and must return the same for the same position.
    """

    def energy(self, position: Array) -> Array:
        """V at `position`, shape ``(..., d)`` to ``(...)``."""

    def gradient(self, position: Array) -> Array:
        """The first derivatives of V, shape ``(..., d)`` to ``(..., d)``."""

    def hessian(self, position: Array) -> Array:
        """The second derivatives of V, shape ``(..., d)`` to ``(..., d, d)``."""


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class QuadraticPotential(MatrixEffect):
    r"""Potential energy :math:`V(q) = q^T K q / 2` with a symmetric, possibly indefinite K.

    The stiffness is K, ``(d, d)``, dense or sparse; a number is a 1 x 1 matrix.
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
        return times(position, self.form)

    def hessian(self, position: Array) -> Array:
        """K at every position, shape ``(..., d)`` to ``(..., d, d)``."""
        return np.broadcast_to(self.stiffness, (*position.shape[:-1], *self.stiffness.shape))


@dataclass(frozen=True, kw_only=True, eq=False)
class ExpressionPotential:
    """Potential energy V(q) by a formula, which is differentiated."""

    coordinates: tuple[str, ...]  # names of the d coordinates
    energy_expression: Expression
    # the other names: numbers, or arrays that broadcast with the components of positions
    parameters: Mapping[str, float | Array] = field(default_factory=dict)

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return len(self.coordinates)

    @cached_property
    def gradient_system(self) -> FormulaSystem:
        """The formulas of dV/dq."""
        return slopes_system(self.energy_expression.system, self.coordinates)[1:]

    @cached_property
    def derivatives_system(self) -> FormulaSystem:
        """The formulas of the gradient, then of the Hessian."""
        return slopes_system(self.gradient_system, self.coordinates)

    def energy(self, position: Array) -> Array:
        """V at `position`, shape ``(..., d)`` to ``(...)``."""
        return np.asarray(self.evaluate(self.energy_expression.system, position)[..., 0])

    def gradient(self, position: Array) -> Array:
        """The first derivatives of V, shape ``(..., d)`` to ``(..., d)``."""
        return self.evaluate(self.gradient_system, position)

    def hessian(self, position: Array) -> Array:
        """The second derivatives of V, shape ``(..., d)`` to ``(..., d, d)``."""
        found = self.evaluate(self.derivatives_system, position)[..., self.dimension :]
        # derivatives are ordered by direction; the matrix is symmetric
        return found.reshape(*position.shape, self.dimension)

    @np.errstate(all="ignore")
    def evaluate(
        self,
        system: FormulaSystem,
        position: Array,
        parameters: Mapping[str, float | Array] | None = None,
    ) -> Array:
        """Values of a program in the coordinates and its own or other parameters, ``(..., n)``."""
        return PointFormulas(system, self.coordinates, parameters or self.parameters)(position)


@dataclass(frozen=True, kw_only=True, eq=False)
class SuppliedPotential:
    """Potential energy by functions of an object of the user; checks the shapes they return."""

    functions: Potential  # V, its gradient and its Hessian
    dimension: int  # number d of degrees of freedom
    stiffness: Form | None = None  # K: q^T K q / 2 is added

    def energy(self, position: Array) -> Array:
        """V at `position`, shape ``(..., d)`` to ``(...)``."""
        return self._of("energy", position, position.shape[:-1])

    def gradient(self, position: Array) -> Array:
        """The first derivatives of V, shape ``(..., d)`` to ``(..., d)``."""
        return self._of("gradient", position, position.shape)

    def hessian(self, position: Array) -> Array:
        """The second derivatives of V, shape ``(..., d)`` to ``(..., d, d)``."""
        return self._of("hessian", position, (*position.shape, self.dimension))

    @np.errstate(all="ignore")
    def _of(self, name: str, position: Array, expected: tuple[int, ...]) -> Array:
        found = np.array(getattr(self.functions, name)(position), dtype=float)
        if found.shape != expected:
            raise ArgumentError(
                "potential",
                f"{type(self.functions).__name__}.{name} returns the shape {found.shape} for "
                f"positions of the shape {position.shape}; return {expected}",
            )
        if self.stiffness is not None:
            found += getattr(QuadraticPotential(stiffness=self.stiffness), name)(position)
        return found


def checked_potential(
    functions: Potential, position: Array
) -> QuadraticPotential | ExpressionPotential | SuppliedPotential:
    """A potential for a scene; shapes that a user's object returns are tried at a position."""
    if isinstance(functions, QuadraticPotential | ExpressionPotential | SuppliedPotential):
        return functions
    found = SuppliedPotential(functions=functions, dimension=position.size)
    for of in (found.energy, found.gradient, found.hessian):
        of(np.stack([position] * (position.size + 1)))
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPotential:
    r"""The potential :math:`c - f \cdot q` of a constant force that is part of a forcing."""

    offset: float
    force: Array  # (d,)

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return self.force.size

    def energy(self, position: Array) -> Array:
        """Its energy, shapes ``(..., d)`` to ``(...)``."""
        return np.asarray(self.offset - position @ self.force)


def with_stiffness(potential: Potential | None, stiffness: Form) -> Potential:
    r"""The potential with :math:`q^T K q / 2` added for a matrix K."""
    if potential is None:
        return QuadraticPotential(stiffness=stiffness)
    if isinstance(potential, QuadraticPotential):
        return QuadraticPotential(stiffness=potential.form + stiffness)
    if isinstance(potential, ExpressionPotential):
        names, own = potential.coordinates, potential.parameters
        system, parameters = with_quadratic(
            potential.energy_expression.system, names, own, stiffness, 0.5
        )
        energy = Expression("the potential energy", (*names, *parameters), system=system)
        return replace(potential, energy_expression=energy, parameters=parameters)
    if not isinstance(potential, SuppliedPotential):
        d = stiffness.shape[0]
        return SuppliedPotential(functions=potential, dimension=d, stiffness=stiffness)
    before = potential.stiffness
    return replace(potential, stiffness=stiffness if before is None else before + stiffness)


def with_quadratic(
    system: FormulaSystem,
    names: Sequence[str],
    parameters: Mapping[str, Any],
    matrix: Form,
    factor: float,
) -> tuple[FormulaSystem, dict[str, Any]]:
    """The program with factor times q^T A q added; entries of A are further parameters."""
    builder, values = Builder(), dict(parameters)
    (total,), whole = builder.include(system), dense(matrix)
    for i, j in np.argwhere(np.triu(whole)).tolist():
        name = f"stiffness_{i}_{j}'"
        if name not in values:
            share = builder.number(factor if i == j else 2.0 * factor) * builder.variable(name)
            total = total + share * builder.variable(names[i]) * builder.variable(names[j])
        values[name] = values.get(name, 0.0) + float(whole[i, j])
    return builder.system([total]), values
