r"""What the equations of a step ask of a scene, for each of the three kinds of mechanics.

With generalised momentum :math:`P = \partial L/\partial v` and force
:math:`Q = \partial L/\partial q` the discrete equations of a step are the same for all kinds
(Hariz Belgacem, Jimenez, Ober-Bloebaum, arXiv 2403.18362, section "Higher order approximations of
the action"); only P, Q and their derivatives differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.lagrangian import Derivatives, Lagrangian
from fvi_cli.effects.matrices import times
from fvi_cli.effects.potential import Potential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Separable:
    r""":math:`L = v^T M v / 2 - V(q)` with a constant mass matrix M; V may be absent.

    Parameters
    ----------
    inertia
        M, symmetric and positive definite.
    potential
        V; quadratic ones make the equations linear.
    """

    inertia: Inertia
    potential: Potential | None

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return self.inertia.dimension

    @property
    def mass(self) -> Array:
        """M, shape ``(d, d)``."""
        return self.inertia.mass

    @property
    def is_linear(self) -> bool:
        """Whether V is quadratic or absent."""
        return self.potential is None or isinstance(self.potential, QuadraticPotential)

    @property
    def stiffness(self) -> Array | None:
        """K of a quadratic potential; None without one."""
        potential = self.potential
        return potential.stiffness if isinstance(potential, QuadraticPotential) else None

    def momentum(self, position: Array, velocity: Array, time: Array | float) -> Array:
        """M v."""
        return np.asarray(times(velocity, self.inertia.form))

    def velocity(self, position: Array, momentum: Array, time: Array | float) -> Array:
        """Inverse of M times p."""
        return self.inertia.velocity(momentum)

    def energy(self, position: Array, momentum: Array, time: Array | float) -> Array:
        """Kinetic energy p M^-1 p / 2 plus V(q)."""
        kinetic = 0.5 * np.einsum(
            "...i,...i->...", momentum, self.velocity(position, momentum, time)
        )
        return np.asarray(
            kinetic if self.potential is None else kinetic + self.potential.energy(position)
        )

    def forces(self, position: Array, velocity: Array, time: Array) -> tuple[Array, Array]:
        """M v and minus the gradient of V."""
        if self.potential is None:
            return np.asarray(times(velocity, self.inertia.form)), np.zeros_like(position)
        return np.asarray(times(velocity, self.inertia.form)), -self.potential.gradient(position)

    def derivatives(self, position: Array, velocity: Array, time: Array) -> Derivatives:
        """P and Q, the mass matrix, and minus the Hessian of V."""
        momentum, force = self.forces(position, velocity, time)
        shape = (*position.shape, self.dimension)
        curvature = np.zeros(shape) if self.potential is None else -self.potential.hessian(position)
        return Derivatives(
            momentum=momentum,
            force=force,
            mass=np.broadcast_to(self.mass, shape),
            mixed=np.zeros(shape),
            stiffness=curvature,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class General:
    """Any L(q, v, t), its mass matrix may depend on the position."""

    lagrangian: Lagrangian

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return self.lagrangian.dimension

    @property
    def is_linear(self) -> bool:
        """Never taken for linear."""
        return False

    def momentum(self, position: Array, velocity: Array, time: Array | float) -> Array:
        """The derivative of L by v."""
        return self.lagrangian.momentum(position, velocity, time)

    def velocity(self, position: Array, momentum: Array, time: Array | float) -> Array:
        """The velocity to a momentum, by Newton's iteration."""
        return self.lagrangian.velocity(position, momentum, time)

    def energy(self, position: Array, momentum: Array, time: Array | float) -> Array:
        """The Hamiltonian v . dL/dv - L."""
        return self.lagrangian.energy(position, self.velocity(position, momentum, time), time)

    def forces(self, position: Array, velocity: Array, time: Array) -> tuple[Array, Array]:
        """The derivatives of L by v and q."""
        at = self.lagrangian.derivatives(position, velocity, time)
        return at.momentum, at.force

    def derivatives(self, position: Array, velocity: Array, time: Array) -> Derivatives:
        """All first and second derivatives in q and v."""
        return self.lagrangian.derivatives(position, velocity, time)


def dynamics_of(scene: Scene) -> Separable | General:
    """The conservative part of `scene`."""
    if scene.lagrangian is not None:
        return General(lagrangian=scene.lagrangian)
    return Separable(inertia=scene.inertia, potential=scene.potential)
