"""Potentials of the same formulas with parameters of their own, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression, Instruction


def formulas_of(potential: ExpressionPotential) -> tuple[object, ...]:
    """What potentials must have in common to be taken side by side."""

    def program(expression: Expression) -> tuple[Instruction, ...]:
        return expression.program

    return (
        potential.coordinates,
        tuple(sorted(potential.parameters)),
        tuple(map(program, potential.gradient_expressions)),
        tuple(tuple(map(program, row)) for row in potential.hessian_expressions),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SidePotentials:
    """Potentials of the same formulas.

    Parameters
    ----------
    first
        One of them, for the formulas.
    parameters
        Values of the parameters, each of shape ``(q,)``.
    """

    first: ExpressionPotential
    parameters: dict[str, Array]

    @classmethod
    def of(cls, potentials: Sequence[ExpressionPotential]) -> SidePotentials:
        """Side by side."""
        first = potentials[0]
        parameters = {
            name: np.array([float(one.parameters[name]) for one in potentials])
            for name in first.parameters
        }
        return cls(first=first, parameters=parameters)

    def of_some(self, systems: NDArray[np.intp]) -> SidePotentials:
        """Those of some systems."""
        return SidePotentials(
            first=self.first,
            parameters={name: values[systems] for name, values in self.parameters.items()},
        )

    def gradient(self, position: Array) -> Array:
        """dV/dq, shape ``(n, e, q)`` to the same."""
        names = self._names(position)
        result = np.empty(position.shape)
        for index, expression in enumerate(self.first.gradient_expressions):
            result[:, index] = expression.evaluate(names, NUMPY_FUNCTIONS)
        return result

    def hessian(self, position: Array) -> Array:
        """Second derivatives, shape ``(n, e, q)`` to ``(n, e, e, q)``."""
        names = self._names(position)
        n, e, q = position.shape
        result = np.empty((n, e, e, q))
        for i, row in enumerate(self.first.hessian_expressions):
            for j, expression in enumerate(row):
                result[:, i, j] = expression.evaluate(names, NUMPY_FUNCTIONS)
        return result

    def _names(self, position: Array) -> dict[str, Array]:
        names = dict(self.parameters)
        for index, coordinate in enumerate(self.first.coordinates):
            # contiguous: vector instructions do the same to every system, wherever it stands
            names[coordinate] = np.ascontiguousarray(position[:, index])
        return names
