"""Potentials of the same formulas with parameters of their own, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.integrator.domain import is_unbounded
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array


def formulas_of(potential: ExpressionPotential) -> tuple[object, ...]:
    """What potentials must have in common to be taken side by side."""
    stiffness = potential.stiffness
    return (
        potential.coordinates,
        tuple(sorted(potential.parameters)),
        potential.gradient_system,
        potential.hessian_system,
        None if stiffness is None else dense(stiffness).tobytes(),
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
        result = np.empty(position.shape)
        found = self.first.gradient_system.evaluate(self._names(position), NUMPY_FUNCTIONS)
        for index, value in enumerate(found):
            result[:, index] = value
        if self.first.stiffness is not None:
            result += np.einsum("ab,nbq->naq", dense(self.first.stiffness), position)
        return result

    def hessian(self, position: Array) -> Array:
        """Second derivatives, shape ``(n, e, q)`` to ``(n, e, e, q)``."""
        n, e, q = position.shape
        result = np.empty((n, e, e, q))
        found = self.first.hessian_system.evaluate(self._names(position), NUMPY_FUNCTIONS)
        for index, value in enumerate(found):
            result[:, index // e, index % e] = value
        if self.first.stiffness is not None:
            result += dense(self.first.stiffness)[:, :, None]
        return result

    def may_be_undefined(self, position: Array) -> NDArray[np.bool_]:
        """Whether V may be infinite or undefined on the way, ``(n, e, q)`` to ``(q,)``."""
        system = self.first.energy_expression.system
        value = np.asarray(system.evaluate(self._names(position), NUMPY_FUNCTIONS)[0])
        places = np.moveaxis(position, 1, -1)
        low, high = np.minimum(places[:-1], places[1:]), np.maximum(places[:-1], places[1:])
        lost = np.broadcast_to(~np.isfinite(value), position[:, 0].shape).any(axis=0)
        found = lost | is_unbounded(self.first, low, high, self.parameters).any(axis=0)
        return np.asarray(found)

    def _names(self, position: Array) -> dict[str, Array]:
        names = dict(self.parameters)
        for index, coordinate in enumerate(self.first.coordinates):
            # contiguous: vector instructions do the same to every system, wherever it stands
            names[coordinate] = np.ascontiguousarray(position[:, index])
        return names
