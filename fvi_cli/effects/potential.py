"""Potential energies: quadratic, given by formulas, or by functions of the user."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

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
class _StiffenedPotential(ABC):
    """A potential energy to which :math:`q^T K q / 2` may be added for a matrix K."""

    stiffness: Form | None = None  # K

    @abstractmethod
    def _of(self, name: str, position: Array) -> Array:
        """V, its gradient or its Hessian without the matrix."""

    @np.errstate(all="ignore")
    def energy(self, position: Array) -> Array:
        """V at `position`, shape ``(..., d)`` to ``(...)``."""
        found = self._of("energy", position)
        if self.stiffness is None:
            return found
        force = times(position, self.stiffness)
        return np.asarray(found + 0.5 * np.einsum("...i,...i->...", position, force))

    @np.errstate(all="ignore")
    def gradient(self, position: Array) -> Array:
        """The first derivatives of V, shape ``(..., d)`` to ``(..., d)``."""
        found = self._of("gradient", position)
        return found if self.stiffness is None else found + times(position, self.stiffness)

    @np.errstate(all="ignore")
    def hessian(self, position: Array) -> Array:
        """The second derivatives of V, shape ``(..., d)`` to ``(..., d, d)``."""
        found = self._of("hessian", position)
        return found if self.stiffness is None else found + dense(self.stiffness)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExpressionPotential(_StiffenedPotential):
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
        """The formulas of dV/dq, without the stiffness."""
        return slopes_system(self.energy_expression.system, self.coordinates)[1:]

    @cached_property
    def hessian_system(self) -> FormulaSystem:
        """The formulas of the second derivatives row by row, without the stiffness."""
        # derivatives are ordered by direction; the matrix is symmetric
        return self.derivatives_system[self.dimension :]

    @cached_property
    def derivatives_system(self) -> FormulaSystem:
        """The formulas of the gradient, then of the Hessian, without the stiffness."""
        return slopes_system(self.gradient_system, self.coordinates)

    def __getstate__(self) -> dict[str, object]:
        """What is pickled: all but compiled programs."""
        return {name: value for name, value in vars(self).items() if name != "_programs"}

    @cached_property
    def _programs(self) -> Mapping[str, PointFormulas]:
        systems = {
            "energy": self.energy_expression.system,
            "gradient": self.gradient_system,
            "hessian": self.hessian_system,
        }
        return {
            name: PointFormulas(one, self.coordinates, self.parameters)
            for name, one in systems.items()
        }

    def _of(self, name: str, position: Array) -> Array:
        found = self._programs[name](position)
        if name == "hessian":
            return found.reshape(*position.shape, self.dimension)
        return np.asarray(found[..., 0]) if name == "energy" else found

    def evaluate(
        self,
        system: FormulaSystem,
        position: Array,
        parameters: Mapping[str, float | Array] | None = None,
    ) -> list[Array | float]:
        """Values of a program in the coordinates and its own or other parameters."""
        columns = zip(self.coordinates, np.moveaxis(position, -1, 0), strict=True)
        return system.evaluate({**(parameters or self.parameters), **dict(columns)})


@dataclass(frozen=True, kw_only=True, eq=False)
class SuppliedPotential(_StiffenedPotential):
    """Potential energy by functions of an object of the user; checks the shapes they return."""

    functions: Potential  # V, its gradient and its Hessian
    dimension: int  # number d of degrees of freedom

    def _of(self, name: str, position: Array) -> Array:
        """A copy of what a function returns for positions."""
        found = np.array(getattr(self.functions, name)(position), dtype=float)
        axes = ("energy", "gradient", "hessian").index(name)
        expected = (*position.shape[:-1], *(self.dimension,) * axes)
        if found.shape != expected:
            raise ArgumentError(
                "potential",
                f"{type(self.functions).__name__}.{name} returns the shape {found.shape} for "
                f"positions of the shape {position.shape}; return {expected}",
            )
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
    if not isinstance(potential, ExpressionPotential | SuppliedPotential):
        d = stiffness.shape[0]
        return SuppliedPotential(functions=potential, dimension=d, stiffness=stiffness)
    own = potential.stiffness
    return replace(potential, stiffness=stiffness if own is None else own + stiffness)
