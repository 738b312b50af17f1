r"""The conservative part of scenes, as the equations of a step need it.

With the momentum :math:`P = \partial L / \partial v` and the force
:math:`Q = \partial L / \partial q`, every kind gives a linearisation (M, C, K), with which
:math:`P \approx M v + C \Delta` and :math:`Q \approx Q_0 + C^T v - K \Delta` at a displacement
:math:`\Delta` from the beginning of the steps, and the *remainder*, the difference of P and Q
from these. A linear scene has no remainder. Shapes: q members, n points, e components.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.potential import (
    ExpressionPotential,
    SuppliedPotential,
)
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.engine.products import apply
from fvi_cli.mathematics.algebra.formulas import PointFormulas
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import find_roots


class Linearisation(NamedTuple):
    """Second derivatives, one for all points ``(q, e, e)`` or one at each point ``(q, n, e, e)``.

    M is the derivative by v and v, C by v and q (None: zero), K minus that by q and q.
    """

    mass: Array
    mixed: Array | None
    stiffness: Array

    def terms_of(self, origin: Array, points: Array) -> Array:
        r"""Sizes of terms that cancel in remainders at points, ``(q, n, e)`` or ``(q, n, 2 e)``.

        They are :math:`|M||v| + |C|(|x| + |\Delta|)` and :math:`|K|(|x| + |\Delta|) + |C|^T|v|`,
        with x the `origin`: formulas are evaluated at the rounded position :math:`x + \Delta`.
        """
        e = origin.shape[-1]
        sizes = np.abs(points)
        reach = np.abs(origin)[:, None] + sizes[..., :e]
        forces = force_of(np.abs(self.stiffness), reach)
        if sizes.shape[-1] == e:
            return forces
        momenta = force_of(np.abs(self.mass), sizes[..., e:])
        if self.mixed is not None:
            mixed = np.abs(self.mixed)
            momenta += force_of(mixed, reach)
            forces += force_of(mixed.swapaxes(-1, -2), sizes[..., e:])
        return np.concatenate([momenta, forces], axis=-1)


class StepLaw(Protocol):
    """The conservative part of q nonlinear scenes of one kind.

    Attributes
    ----------
    has_rates
        Whether remainders depend on the velocities, and momenta have remainders too: points
        are then ``(displacement, velocity)`` and remainders ``(of momenta, of forces)`` in the
        last axis.
    """

    is_linear: bool
    has_rates: bool

    def velocity(self, x: Array, p: Array, t: float) -> Array:
        """The v with P = p, all ``(q, e)``; nan where there is none."""

    def expand(self, origin: Array, points: Array, t: Array) -> tuple[Linearisation, Array]:
        """Second derivatives at each of the points, and the remainders there."""

    def remainder(self, at: Linearisation, origin: Array, points: Array, t: Array) -> Array:
        """Remainders ``(q, n, e)`` or ``(q, n, 2 e)`` at points.

        `origin`, ``(q, e)``, is the position at the beginning of the steps.
        """


def force_of(stiffness: Array, displacement: Array) -> Array:
    """K Delta of stiffnesses ``(q, e, e)`` or ``(q, n, e, e)`` and ``(q, n, e)``."""
    if displacement.shape[-1] == 1:
        return displacement * (stiffness if stiffness.ndim == 3 else stiffness[..., 0])
    if stiffness.ndim == 3:
        return np.asarray(np.matmul(displacement, stiffness))
    return np.asarray(np.matmul(stiffness, displacement[..., None])[..., 0])


@dataclass(frozen=True, eq=False, kw_only=True)
class Linear:
    """Linear scenes: constant mass and stiffness, each ``(q, e, e)``."""

    mass: Array
    stiffness: Array
    is_linear, has_rates = True, False

    @property
    def at(self) -> Linearisation:
        """M and K."""
        return Linearisation(self.mass, None, self.stiffness)


@dataclass(eq=False, kw_only=True)
class Separable:
    r""":math:`L = v^T M v / 2 - V(q)` with the same formulas or functions for all members.

    The remainder is :math:`K \Delta - \nabla V(q)`.
    """

    mass: Array  # (q, e, e)
    # potential of one member, for its formulas
    formulas: ExpressionPotential | SuppliedPotential
    parameters: Mapping[str, Array]  # values of the names in them, (q, 1) each
    is_linear, has_rates = False, False

    def __post_init__(self) -> None:
        one, values = self.formulas, self.parameters
        if isinstance(one, SuppliedPotential):
            self._gradient: Callable[[Array], Array] = one.gradient
            return
        self._gradient = PointFormulas(one.gradient_system, one.coordinates, values)
        self._both = PointFormulas(one.derivatives_system, one.coordinates, values)

    def _derivatives(self, x: Array) -> tuple[Array, Array]:
        """Gradient and second derivatives at ``(q, n, e)``.

        Members whose second derivatives are not all finite have zeros for them.
        """
        e, potential = x.shape[-1], self.formulas
        if isinstance(potential, SuppliedPotential):
            first, second = potential.gradient(x), potential.hessian(x)
        else:
            values = self._both(x)
            first, second = values[..., :e], values[..., e:].reshape(*x.shape, e)
        if not math.isfinite(np.add.reduce(second, axis=None)):
            finite = np.isfinite(second).all(axis=(1, 2, 3), keepdims=True)
            second = np.where(finite, second, 0.0)
        return first, second if e == 1 else 0.5 * (second + second.swapaxes(-1, -2))

    def velocity(self, x: Array, p: Array, t: float) -> Array:
        """Inverse of M times p."""
        if p.shape[-1] == 1:
            return p / self.mass[..., 0]
        return np.asarray(np.linalg.solve(self.mass, p[..., None])[..., 0])

    def expand(self, origin: Array, points: Array, t: Array) -> tuple[Linearisation, Array]:
        """M and second derivatives of V at every point, and K Delta less the gradient."""
        first, second = self._derivatives(origin[:, None] + points)
        return Linearisation(self.mass, None, second), force_of(second, points) - first

    def remainder(self, at: Linearisation, origin: Array, points: Array, t: Array) -> Array:
        """K Delta less the gradient."""
        return force_of(at.stiffness, points) - self._gradient(origin[:, None] + points)


@dataclass(eq=False, kw_only=True)
class General:
    """Any L(q, v, t) with the same formulas for all members."""

    lagrangian: Lagrangian  # that of one member, for its formulas
    parameters: Mapping[str, Array]  # values of the names in them, (q, 1) each
    is_linear, has_rates = False, True

    def __post_init__(self) -> None:
        one, values = self.lagrangian, self.parameters
        self._first = PointFormulas(one.first, one.variables, values)
        self._second = PointFormulas(one.second, one.variables, values)

    def velocity(self, x: Array, p: Array, t: float) -> Array:
        """The velocity by Newton's iteration, for every member by itself."""
        e = x.shape[-1]

        def mismatch(v: Array) -> tuple[Array, Array, Array]:
            values = self._second(x[:, None], v[:, None], np.full((1, 1), t))[:, 0]
            mass = values[:, 2 * e : 2 * e + e * e].reshape(-1, e, e)
            momentum = values[:, :e]
            terms = apply(np.abs(mass), np.abs(v)) + np.abs(p) + np.abs(momentum)
            return momentum - p, mass, terms

        v, found, _ = find_roots(mismatch, np.zeros_like(p))
        return np.where(found[:, None], v, np.nan)

    def _derivatives(self, x: Array, v: Array, t: Array | float) -> tuple[Array, Array]:
        """P and Q in one array, and the second derivatives ``(q, n, 3, e, e)``."""
        found, e = self._second(x, v, np.asarray(t)[..., None]), x.shape[-1]
        return found[..., : 2 * e], found[..., 2 * e :].reshape(*x.shape[:-1], 3, e, e)

    def expand(self, origin: Array, points: Array, t: Array) -> tuple[Linearisation, Array]:
        """The second derivatives of L, and the remainders of P and Q."""
        e = origin.shape[-1]
        first, second = self._derivatives(origin[:, None] + points[..., :e], points[..., e:], t)
        at = Linearisation(second[..., 0, :, :], second[..., 1, :, :], -second[..., 2, :, :])
        return at, self._rest_of(at, points, first)

    def _rest_of(self, at: Linearisation, points: Array, first: Array) -> Array:
        """Remainders of P and Q, which are in `first`."""
        mass, mixed, stiffness = at
        e = points.shape[-1] // 2
        displacement, v = points[..., :e], points[..., e:]
        momentum = force_of(mass, v)
        force = -force_of(stiffness, displacement)
        if mixed is not None:
            momentum += force_of(mixed, displacement)
            force += force_of(mixed.swapaxes(-1, -2), v)
        return np.asarray(first - np.concatenate([momentum, force], axis=-1))

    def remainder(self, at: Linearisation, origin: Array, points: Array, t: Array) -> Array:
        """Remainders of momenta and of forces in one array."""
        e = origin.shape[-1]
        x = origin[:, None] + points[..., :e]
        return self._rest_of(at, points, self._first(x, points[..., e:], t[..., None]))


def modes_of(scenes: Sequence[Scene]) -> list[Decoupling] | None:
    """Coordinates in which scenes are decoupled; None if one of them has none."""
    by_scene = [linear_decoupling(one) for one in scenes]
    known = [one for one in by_scene if one is not None]
    return known if len(known) == len(by_scene) else None


def law_of(scenes: Sequence[Scene], modes: Sequence[Decoupling] | None) -> StepLaw | Linear:
    """The conservative part of scenes of one kind, in these coordinates."""
    first = scenes[0]
    if modes is not None:
        pairs = list(zip(modes, scenes, strict=True))
        return Linear(
            mass=np.concatenate([mode.matrices(one.inertia.mass) for mode, one in pairs]),
            stiffness=np.concatenate([mode.matrices(one.stiffness) for mode, one in pairs]),
        )
    if first.is_linear:
        return Linear(
            mass=np.array([one.inertia.mass for one in scenes]),
            stiffness=np.array([one.stiffness for one in scenes]),
        )
    if first.lagrangian is not None:
        lagrangians = [one.lagrangian for one in scenes if one.lagrangian is not None]
        return General(
            lagrangian=first.lagrangian,
            parameters=_columns([one.parameters for one in lagrangians]),
        )
    potentials = [one.potential for one in scenes]
    masses = np.array([one.inertia.mass for one in scenes])
    if isinstance(supplied := potentials[0], SuppliedPotential):
        return Separable(mass=masses, formulas=supplied, parameters={})
    known = [one for one in potentials if isinstance(one, ExpressionPotential)]
    if len(known) != len(potentials):
        raise ValueError("scenes: all must be of one kind")
    return Separable(
        mass=masses, formulas=known[0], parameters=_columns([one.parameters for one in known])
    )


def _columns(parameters: Sequence[Mapping[str, float | Array]]) -> dict[str, Array]:
    """Values of every name, ``(q, 1)``."""
    return {name: np.array([[float(one[name])] for one in parameters]) for name in parameters[0]}
