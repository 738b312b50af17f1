r"""Blocks of equal steps of nonlinear scenes.

With constant matrices M and K in place of the second derivatives of the Lagrangian the steps of a
block are linear, and what is left of momenta and forces at the quadrature points is found as a
fixed point, for a potential

.. math:: X = X_\text{known} + R\, \rho(X), \qquad \rho(X) = K (X - q) - \nabla V(X).

This is Newton's iteration for the whole block with the Jacobian of the linear scene; it contracts
like :math:`|V'' - K| (B h)^2 / 2`. A block that does not contract is halved, down to single steps
with their own Jacobians.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.potential import Potential
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.steps.block_response import LinearSystems, OwnDamping, block_response
from fvi_cli.integrator.steps.dynamics import General, Separable
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import SMALLEST, UNIT, Mask, judge
from fvi_cli.mathematics.matrices.definite import least_scaled_eigenvalue

ITERATION_LIMIT = 40
SLOW = 0.5
"""From this ratio of successive changes on they are compared with round-off."""


class FrozenLaw(Protocol):
    """A linear scene, and what is left of the momenta and forces of a nonlinear one."""

    @property
    def mass(self) -> Array:
        """Mass matrix of the linear scene, shape ``(d, d)``."""

    @property
    def stiffness(self) -> Array:
        """Stiffness of the linear scene, shape ``(d, d)``."""

    @property
    def has_rates(self) -> bool:
        """Whether what is left depends on velocities and has a part of the momenta as well."""

    def remainder(
        self, origin: Array, way: Array, velocity: Array, time: Array, previous: Array
    ) -> Array:
        """What is left at positions origin + way, ``(n, r, d)``, to ``(n, r, w)``, w = d or 2 d.

        The linear scene pulls with K times the way alone: nothing large cancels.
        """

    def terms(self, origin: Array, way: Array, velocity: Array) -> Array:
        """Sizes of the terms that the linear scene takes off, shape ``(n, r, w)``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PotentialLaw:
    """What is left of the force of a potential, K (X - q) - grad V(X), q the block's beginning."""

    potential: Potential
    mass: Array
    stiffness: Array
    has_rates: bool = False

    def remainder(
        self, origin: Array, way: Array, velocity: Array, time: Array, previous: Array
    ) -> Array:
        """See :class:`FrozenLaw`."""
        return np.asarray(way @ self.stiffness - self.potential.gradient(origin + way))

    def terms(self, origin: Array, way: Array, velocity: Array) -> Array:
        """See :class:`FrozenLaw`."""
        return np.asarray((np.abs(origin) + np.abs(way)) @ np.abs(self.stiffness))


@dataclass(frozen=True, kw_only=True, eq=False)
class LagrangianLaw:
    r"""What is left of a Lagrangian: :math:`\partial_v L - M V` and :math:`\partial_q L + K X`.

    The momentum of the linear scene at a point comes of integrals of forces. The velocity that
    belongs to it, and not the one of the linear scene, makes what is left: so each iteration
    depends on the one before through integrals only and contracts, however M changes in a block.
    """

    lagrangian: Lagrangian
    mass: Array
    stiffness: Array
    has_rates: bool = True

    def remainder(
        self, origin: Array, way: Array, velocity: Array, time: Array, previous: Array
    ) -> Array:
        """See :class:`FrozenLaw`; not finite where a mass matrix is singular."""
        d = self.lagrangian.dimension
        momentum = velocity @ self.mass + previous[..., :d]
        at = self.lagrangian.derivatives(origin + way, velocity, time)
        excess = momentum - at.momentum
        try:
            change = np.linalg.solve(at.mass, excess[..., None])[..., 0]
        except np.linalg.LinAlgError:
            return np.full_like(previous, np.nan)
        force = at.force + np.einsum("...ab,...a->...b", at.mixed, change)
        return np.concatenate(
            [momentum - (velocity + change) @ self.mass, force + way @ self.stiffness], axis=-1
        )

    def terms(self, origin: Array, way: Array, velocity: Array) -> Array:
        """See :class:`FrozenLaw`."""
        forces = (np.abs(origin) + np.abs(way)) @ np.abs(self.stiffness)
        return np.concatenate([np.abs(velocity) @ np.abs(self.mass), forces], axis=-1)


def frozen_law(
    dynamics: Separable | General, position: Array, momentum: Array, time: float, mass: Array
) -> FrozenLaw:
    """The linear scene that stands for a nonlinear one near a state.

    Parameters
    ----------
    dynamics
        The nonlinear scene.
    position, momentum, time
        The state, shape ``(d,)``.
    mass
        Mass matrix to take where that of the scene is no positive matrix.

    Raises
    ------
    ValueError
        If the scene has no potential.
    """
    if isinstance(dynamics, General):
        stiffness = np.zeros_like(mass)
        with np.errstate(all="ignore"):
            velocity = dynamics.velocity(position, momentum, time)
            at = dynamics.lagrangian.derivatives(position, velocity, time)
        if np.isfinite(at.mass).all() and least_scaled_eigenvalue(at.mass) > 0:
            mass, found = 0.5 * (at.mass + at.mass.T), at.stiffness
            stiffness = -0.5 * (found + found.T) if np.isfinite(found).all() else stiffness
        return LagrangianLaw(lagrangian=dynamics.lagrangian, mass=mass, stiffness=stiffness)
    if dynamics.potential is None:
        raise ValueError("potential: a linear scene needs no iteration")
    hessian = dynamics.potential.hessian(position)
    if not np.isfinite(hessian).all():
        hessian = np.zeros_like(hessian)
    return PotentialLaw(
        potential=dynamics.potential, mass=dynamics.mass, stiffness=0.5 * (hessian + hessian.T)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class NewtonSteps:
    """What a block of n steps gave.

    Parameters
    ----------
    way, momentum_change
        Position and momentum after every step relative to the beginning, shape ``(n, d)``.
    samples
        What drove the damping force, shape ``(n, inputs, d)``.
    remainder
        What was left at the last point of all, shape ``(w,)``.
    changes
        How the points changed in each iteration, a length.
    """

    way: Array
    momentum_change: Array
    samples: Array
    remainder: Array
    changes: tuple[float, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sized:
    """Matrices for blocks of one number of steps."""

    points: Array
    response: Array
    samples: Array
    ends: Array


class FrozenBlocks:
    """Blocks of equal steps by the response of a frozen linear scene.

    Parameters
    ----------
    law
        The linear scene, and what the other is beyond it.
    directions, damping
        Directions of the damping, each of shape ``(d, d)``, and that of a block's steps by
        themselves.
    tables, step_size, block
        Numbers of the method, h, and the most steps of a block.
    to_velocity
        From what drives the damping to velocities at the quadrature points; None: it is these.
    """

    def __init__(
        self,
        law: FrozenLaw,
        directions: tuple[Array, ...],
        damping: OwnDamping,
        tables: StepTables,
        step_size: float,
        block: int,
        to_velocity: Array | None = None,
    ) -> None:
        self._law, self._tables, self._to_velocity = law, tables, to_velocity
        self._h, self._block = step_size, block
        self._d, self._r = law.mass.shape[0], tables.points.size
        self._rows = tables.degree + 1
        d = self._d
        systems = LinearSystems(
            mass=law.mass[None],
            stiffness=law.stiffness[None],
            directions=tuple(one[None] for one in directions),
        )
        self._response = block_response(systems, damping, tables, step_size, block)
        self._m = damping.sampling.driving.shape[0]
        by_value = step_size * tables.test_weights
        parts = [by_value]
        if law.has_rates:
            by_rate = tables.weights * tables.slopes
            # the slopes of the basis sum to zero: what is left of momenta makes no momentum
            by_rate[-1] = -by_rate[:-1].sum(axis=0)
            parts = [by_rate, by_value]
        unit = np.eye(d)
        stacked = np.stack([np.kron(part, unit) for part in parts])
        self._to_loads = (
            stacked.reshape(len(parts), self._rows * d, self._r, d)
            .transpose(1, 2, 0, 3)
            .reshape(self._rows * d, -1)
        )
        self._made: dict[int, _Sized] = {}

    def _sized(self, count: int) -> _Sized:
        if count in self._made:
            return self._made[count]
        d, r, rows = self._d, self._r, self._rows
        width, every = count * rows * d, self._block * rows * d
        columns = np.r_[0:width, every : every + 2 * d]

        def part(matrix: Array, per_step: int) -> Array:
            return np.ascontiguousarray(matrix[0][: count * per_step][:, columns])

        way = part(self._response.way, r * d)
        samples = part(self._response.samples, self._m * d)
        points = way
        if self._law.has_rates:
            velocity = samples
            if self._to_velocity is not None:
                steps = samples.reshape(count, self._m, -1)
                velocity = (self._to_velocity @ steps).reshape(way.shape)
            pairs = np.stack([way, velocity]).reshape(2, count * r, d, -1)
            points = pairs.transpose(1, 0, 2, 3).reshape(2 * count * r * d, -1)
        driven = points[:, :width].reshape(points.shape[0], count, rows * d)
        self._made[count] = _Sized(
            points=points,
            response=np.ascontiguousarray(
                (driven @ self._to_loads).reshape(points.shape[0], points.shape[0])
            ),
            samples=samples,
            ends=part(self._response.ends, 2 * d),
        )
        return self._made[count]

    def attempt(
        self,
        time: float,
        position: Array,
        momentum: Array,
        loads: Array | None,
        remainder: Array,
        count: int,
    ) -> NewtonSteps | None:
        """Solve the equations of a block of `count` steps; None where it does not contract.

        Parameters
        ----------
        time, position, momentum
            Where it begins.
        loads
            Load vectors of known forces and of the past, shape ``(count, s + 1, d)``.
        remainder
            Guess of what is left, the same at all points, shape ``(w,)``.
        """
        d, r, sized = self._d, self._r, self._sized(count)
        inputs = np.zeros(count * self._rows * d + 2 * d)
        if loads is not None:
            inputs[: -2 * d] = loads.ravel()
        # the way begins at zero
        inputs[-d:] = momentum
        fixed = (sized.points @ inputs).reshape(count, r, -1)
        times = time + self._h * (np.arange(count)[:, None] + self._tables.points)
        guess = np.broadcast_to(remainder, fixed.shape)
        found = fixed_point(
            self._law,
            sized.response,
            fixed,
            position,
            times,
            guess,
            lambda: (np.abs(sized.points) @ np.abs(inputs)).reshape(fixed.shape),
        )
        if found is None:
            return None
        left, changes = found
        added = left.reshape(count, -1) @ self._to_loads.T
        inputs[: -2 * d] += added.ravel()
        ends = (sized.ends @ inputs).reshape(count, 2, d)
        if not np.isfinite(ends).all():
            return None
        return NewtonSteps(
            way=ends[:, 0],
            momentum_change=ends[:, 1],
            samples=(sized.samples @ inputs).reshape(count, -1, d),
            remainder=left[-1, -1],
            changes=tuple(changes),
        )


def fixed_point(
    law: FrozenLaw,
    matrix: Array,
    fixed: Array,
    origin: Array,
    times: Array,
    remainder: Array,
    terms_of_fixed: Callable[[], Array],
) -> tuple[Array, list[float]] | None:
    """What is left of the forces of a block, and how its points changed in each iteration.

    Parameters
    ----------
    law
        The linear scene, and what the other is beyond it.
    matrix
        From what is left at the points to ways (and velocities, where it depends on these).
    fixed
        The points without it, shape ``(n, r, w)``.
    origin
        Position at the beginning, shape ``(d,)``.
    times
        Of the points, shape ``(n, r)``.
    remainder
        Guess of what is left, as `fixed`.
    terms_of_fixed
        Sums of the absolute values of the terms of `fixed`.

    Returns
    -------
    tuple, or None
        None where the iteration does not contract.
    """
    d, w = origin.size, fixed.shape[-1]
    size = np.abs(origin)
    if law.has_rates:
        # over the whole block a velocity counts as the way that it makes
        size = np.concatenate([size, size / float(times[-1, -1] - times[0, 0])])
    points = fixed + (matrix @ remainder.ravel()).reshape(fixed.shape)
    scale = weight = size
    previous, before = np.full(w, np.nan), math.inf

    def floor(_: Mask) -> Array:
        """Rounded terms, through the matrices: what is not coupled does not meet."""
        way, velocity = points[..., :d], points[..., d:]
        terms = np.abs(remainder) + law.terms(origin, way, velocity)
        noise = (np.abs(matrix) @ terms.ravel()).reshape(fixed.shape) + terms_of_fixed()
        return np.asarray(UNIT * ((noise + np.abs(points)).reshape(-1, w).max(axis=0) + size))

    changes: list[float] = []
    for _ in range(ITERATION_LIMIT):
        remainder = law.remainder(origin, points[..., :d], points[..., d:], times, remainder)
        moved = fixed + (matrix @ remainder.ravel()).reshape(fixed.shape)
        change = np.abs(moved - points).reshape(-1, w).max(axis=0)
        if not changes:
            scale = size + np.abs(moved).reshape(-1, w).max(axis=0)
            weight = 1.0 / np.maximum(scale, SMALLEST)
        points = moved
        changes.append(float(change[:d].max()))
        worst = float(change @ weight)
        if not math.isfinite(worst):
            return None
        if judge(change, previous, scale, floor, slow=SLOW)[0].all():
            return remainder, changes
        # a Volterra equation contracts the better the longer it is iterated
        if worst > before:
            return None
        previous, before = change, worst
    return None
