"""The forces of a scene at any points of a step."""

from __future__ import annotations

import bisect
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from fvi_cli.effects.forcing import ForcingPiece, formula_of
from fvi_cli.effects.potential import ExpressionPotential, SuppliedPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.samples import may_hide
from fvi_cli.mathematics.algebra.arithmetic import KINKED
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array

STEEP_FUNCTIONS: Final = frozenset({"exp", "expm1", "tanh", "arctan", "cosh", "sinh", "gamma"})
"""Functions of which walls and pulses are made."""
LARGEST_INVERTED: Final = 200
"""Most degrees of freedom for which the mass matrix is inverted for an estimate."""
MOST_FORMULAS: Final = 8
"""Most formulas of a large structure that are followed one by one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointForces:
    """Forces at n points of a step."""

    momentum: Array | None  # P, shape (n, d); None where it is linear in the velocity
    # conservative force and forcing, shape (n, d); for a linear scene the forcing only
    force: Array


class SceneForces:
    """Forces of one scene, from its formulas.

    The stiffness of a linear scene hides no peaks and is left out. Where it `may_hide`, a formula
    may be large between samples: it has functions that rise and fall steeply, quotients or high
    powers. Where it `is_steep`, a formula has functions with kinks or such of which walls and
    pulses are made.
    """

    def __init__(self, scene: Scene) -> None:
        self._forcing = scene.forcing
        self._lagrangian = scene.lagrangian
        potential = scene.potential
        self._potential = potential if isinstance(potential, ExpressionPotential) else None
        self._supplied = potential if isinstance(potential, SuppliedPotential) else None
        self._dimension = scene.dimension
        self._inertia = scene.inertia
        self.needs_velocity = self._lagrangian is not None
        moving = (self._lagrangian, self._potential, self._supplied)
        self.depend_on_time_only = all(one is None for one in moving)
        systems = list(_systems(scene))
        called = frozenset[str]().union(*(one.called for one in systems))
        self.may_hide = any(map(may_hide, systems))
        # a Python function is unknown
        is_program = scene.forcing is not None and scene.forcing.has_functions
        self.has_kinks = bool(called & set(KINKED))
        self.is_steep = is_program or self.has_kinks or bool(called & STEEP_FUNCTIONS)
        self._breaks = () if scene.forcing is None else scene.forcing.break_points

    def are_zero_at(self, time: float) -> bool:
        """Whether a step around this time has no forces to examine."""
        piece = self._piece(time)
        return self.depend_on_time_only and (piece is None or piece.is_zero)

    def accelerations(self, force: Array, position: Array, velocity: Array, time: float) -> Array:
        """Accelerations by forces, with the mass matrix at one point, shape ``(n, d)``."""
        inverse = self._inverse_mass(position, velocity, time)
        if inverse is None:
            return self._inertia.velocity(force)
        return np.asarray(force * inverse[0, 0] if len(inverse) == 1 else force @ inverse)

    def mobility(self, position: Array, velocity: Array, time: float) -> float:
        """Largest acceleration by forces that are 1 at most."""
        inverse = self._inverse_mass(position, velocity, time)
        if inverse is None:
            return 1.0 / float(self._inertia.form.diagonal().min())
        return float(np.abs(inverse).sum(axis=1).max())

    def _inverse_mass(self, position: Array, velocity: Array, time: float) -> Array | None:
        """The inverse of the mass matrix at one point, ``(d, d)``; None: it is large."""
        if self._lagrangian is None:
            return self._inverse
        mass = self._lagrangian.derivatives(position, velocity, time).mass
        try:
            return np.asarray(np.linalg.inv(mass))
        except np.linalg.LinAlgError:
            return np.full_like(mass, np.inf)

    @cached_property
    def _inverse(self) -> Array | None:
        if self._dimension > LARGEST_INVERTED:
            return None
        return self._inertia.velocity(np.eye(self._dimension))

    def at(self, position: Array, velocity: Array, time: Array, middle: float) -> PointForces:
        """Forces at points of a step with this `middle`, shapes ``(n, d)`` and ``(n,)``.

        The velocity counts for a general Lagrangian only, see :attr:`needs_velocity`.
        """
        momentum, force = None, np.zeros((time.size, self._dimension))
        if self._potential is not None:
            force = -self._potential.gradient(position)
        elif self._supplied is not None:
            force = -self._supplied.gradient(position)
        elif self._lagrangian is not None:
            momentum, force = self._lagrangian.forces(position, velocity, time)
        piece = self._piece(middle)
        if piece is not None:
            for component, own in piece.distinct:
                found = component.evaluate({"t": time})
                if isinstance(found, np.ndarray) or found:
                    force[:, own] += np.asarray(found)[..., None]
        return PointForces(momentum=momentum, force=force)

    def units_at(self, middle: float) -> Array | None:
        """Forces of 1 where each formula of the time acts, ``(k, d)``; None if too many."""
        piece = self._piece(middle)
        formulas = [] if piece is None else piece.distinct
        moving = [places for component, places in formulas if not component.is_constant]
        if not 0 < len(moving) <= MOST_FORMULAS:
            return None
        units = np.zeros((len(moving), self._dimension))
        for row, places in zip(units, moving, strict=True):
            row[places] = 1.0
        return units

    def _piece(self, middle: float) -> ForcingPiece | None:
        if self._forcing is None:
            return None
        return self._forcing.pieces[bisect.bisect_left(self._breaks, middle)]


def _systems(scene: Scene) -> Iterator[FormulaSystem]:
    """The formulas of the forces of a scene."""
    if isinstance(scene.potential, ExpressionPotential):
        yield scene.potential.gradient_system
    if scene.lagrangian is not None:
        yield scene.lagrangian.first
    for component in () if scene.forcing is None else scene.forcing.components:
        if (formula := formula_of(component)) is not None:
            yield formula.bound
