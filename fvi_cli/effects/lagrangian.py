r"""A Lagrangian whose mass matrix is not constant, or whose energies do not separate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from fvi_cli.effects.matrices import Form
from fvi_cli.effects.potential import with_quadratic
from fvi_cli.mathematics.algebra.builder import derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, PointFormulas
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import find_roots
from fvi_cli.mathematics.expressions import slopes_system

T = TypeVar("T")

TIME = "t"


def velocity_name(coordinate: str) -> str:
    """Name of the velocity of a coordinate."""
    return f"v{coordinate}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Derivatives:
    r"""First and second derivatives of L at points."""

    momentum: Array  # dL/dv, (..., d)
    force: Array  # dL/dq, (..., d)
    mass: Array  # by v twice, (..., d, d)
    mixed: Array  # by v (rows) and q (columns), (..., d, d)
    stiffness: Array  # by q twice, (..., d, d)


@dataclass(frozen=True, kw_only=True, eq=False)
class Lagrangian:
    r"""L(q, v, t), whose derivatives are programs over q, v<q>, t and parameters."""

    coordinates: tuple[str, ...]  # names of the d coordinates
    value: FormulaSystem
    parameters: Mapping[str, float] = field(default_factory=dict)  # values of the other names in it

    @cached_property
    def velocities(self) -> tuple[str, ...]:
        """Names of the velocities."""
        return tuple(map(velocity_name, self.coordinates))

    @property
    def accelerations(self) -> tuple[str, ...]:
        """Names of the accelerations; users cannot write such names."""
        return tuple(f"{name}''" for name in self.coordinates)

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """Coordinates, velocities, the time and accelerations: the components of points."""
        return (*self.coordinates, *self.velocities, TIME, *self.accelerations)

    @cached_property
    def first(self) -> FormulaSystem:
        r""":math:`\partial L/\partial v`, d values, and :math:`\partial L/\partial q`, d values."""
        return slopes_system(self.value, (*self.velocities, *self.coordinates))[1:]

    @cached_property
    def second(self) -> FormulaSystem:
        """The values of `first`, then the matrices of :class:`Derivatives` row by row."""
        d = self.dimension
        found = slopes_system(self.first, (*self.velocities, *self.coordinates))
        # by direction, then momenta and forces
        place = np.arange(4 * d * d).reshape(2, d, 2, d) + 2 * d
        matrices = (place[0, :, 0].T, place[1, :, 0].T, place[1, :, 1].T)
        chosen = [*range(2 * d), *(int(k) for one in matrices for k in one.ravel())]
        return FormulaSystem(found.instructions, tuple(found.outputs[k] for k in chosen))

    @cached_property
    def imbalance(self) -> FormulaSystem:
        r""":math:`\partial_q L` and :math:`\frac{d}{dt} \partial_v L`, d values each.

        The program has :attr:`accelerations` as further variables.
        """
        d = self.dimension
        moving = dict(zip(self.coordinates, self.velocities, strict=True))
        moving |= zip(self.velocities, self.accelerations, strict=True)
        return derivatives(self.first, [{**moving, TIME: 1.0}])[d : 3 * d]

    def stiffened(self, stiffness: Form) -> Lagrangian:
        """L less :math:`q^T K q / 2` for a matrix K."""
        value, parameters = with_quadratic(
            self.value, self.coordinates, self.parameters, stiffness, -0.5
        )
        return replace(self, value=value, parameters=parameters)

    @property
    def depends_on_time(self) -> bool:
        """Whether t occurs in L."""
        return TIME in self.value.names

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return len(self.coordinates)

    def evaluate(
        self,
        system: FormulaSystem,
        position: Array,
        velocity: Array,
        time: Array | float,
        parameters: Mapping[str, float] | None = None,
        acceleration: Array | None = None,
    ) -> Array:
        """Values of a program in q, v<q>, t and parameters, ``(..., number of outputs)``."""
        program = PointFormulas(system, self.variables, parameters or self.parameters)
        points = [position, velocity, np.asarray(time, dtype=float)[..., None]]
        with np.errstate(all="ignore"):
            return program(*points, *([] if acceleration is None else [acceleration]))

    def lagrangian(self, position: Array, velocity: Array, time: Array | float) -> Array:
        """L, shapes ``(..., d)``, ``(..., d)`` and ``(...)`` to ``(...)``."""
        return np.asarray(self.evaluate(self.value, position, velocity, time)[..., 0])

    def forces(self, position: Array, velocity: Array, time: Array | float) -> tuple[Array, Array]:
        """dL/dv and dL/dq, both of shape ``(..., d)``."""
        found = self.evaluate(self.first, position, velocity, time)
        return found[..., : self.dimension], found[..., self.dimension :]

    def derivatives(self, position: Array, velocity: Array, time: Array | float) -> Derivatives:
        """All first and second derivatives in q and v."""
        d = self.dimension
        values = self.evaluate(self.second, position, velocity, time)
        matrices = values[..., 2 * d :].reshape(*values.shape[:-1], 3, d, d)
        return Derivatives(
            momentum=values[..., :d],
            force=values[..., d : 2 * d],
            mass=matrices[..., 0, :, :],
            mixed=matrices[..., 1, :, :],
            stiffness=matrices[..., 2, :, :],
        )

    def time_derivative(self, position: Array, velocity: Array, time: Array | float) -> Array:
        """The partial derivative of L by t, shape ``(...)``."""
        rate = slopes_system(self.value, (TIME,))[1:]
        return np.asarray(self.evaluate(rate, position, velocity, time)[..., 0])

    def remainder(
        self, position: Array, velocity: Array, acceleration: Array, time: Array | float
    ) -> Array:
        r"""The unbalanced force of a motion, :math:`\partial_q L - \frac{d}{dt} \partial_v L`."""
        found = self.evaluate(self.imbalance, position, velocity, time, acceleration=acceleration)
        return np.asarray(found[..., : self.dimension] - found[..., self.dimension :])

    def remainder_slopes(
        self, position: Array, velocity: Array, acceleration: Array, time: Array | float
    ) -> Array:
        """Derivatives of :meth:`remainder` by positions and velocities, ``(..., 2, d, d)``."""
        d = self.dimension
        system = slopes_system(self.imbalance, (*self.coordinates, *self.velocities))[2 * d :]
        found = self.evaluate(system, position, velocity, time, acceleration=acceleration)
        by_motion = found.reshape(*found.shape[:-1], 2, d, 2, d)
        return np.asarray(by_motion[..., 0, :] - by_motion[..., 1, :])

    def velocity(self, position: Array, momentum: Array, time: Array | float) -> Array:
        """The velocity that belongs to a momentum, by Newton's iteration; shape ``(..., d)``.

        One step suffices where L is quadratic in v. Every point is iterated for itself; it is nan
        where no velocity was found.
        """
        shape, d = momentum.shape, self.dimension
        sought = momentum.reshape(-1, d)
        places = np.broadcast_to(position, shape).reshape(-1, d)
        times = np.broadcast_to(time, shape[:-1]).ravel()

        def mismatch(velocity: Array) -> tuple[Array, Array, Array]:
            at = self.derivatives(places, velocity, times)
            moved = np.einsum("nab,nb->na", np.abs(at.mass), np.abs(velocity))
            return at.momentum - sought, at.mass, moved + np.abs(sought) + np.abs(at.momentum)

        velocity, found, _ = find_roots(mismatch, np.zeros_like(sought))
        return np.where(found[:, None], velocity, np.nan).reshape(shape)

    def energy(self, position: Array, velocity: Array, time: Array | float) -> Array:
        r""":math:`v \cdot \partial L/\partial v - L`, shape ``(...)``."""
        momentum, _ = self.forces(position, velocity, time)
        kinetic = np.einsum("...a,...a->...", momentum, velocity)
        return np.asarray(kinetic - self.lagrangian(position, velocity, time))
