r"""The conservative part of scenes: what the equations of a step ask of it.

With the momentum :math:`P = \partial L / \partial v` and the force
:math:`Q = \partial L / \partial q`, every kind gives a linearisation (M, C, K), with which
:math:`P \approx M v + C \Delta` and :math:`Q \approx Q_0 + C^T v - K \Delta` at a displacement
:math:`\Delta` from the beginning of the steps, and the *remainder*, which is what P and Q have
beside these. A linear scene has no remainder. Shapes: q members, n points, e components.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import (
    ExpressionPotential,
    QuadraticPotential,
    SuppliedPotential,
)
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.engine.tables import apply
from fvi_cli.mathematics.algebra.formulas import PointFormulas
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.convergence import find_roots


class Linearisation(NamedTuple):
    """Second derivatives, for all points ``(q, e, e)`` or at each of them ``(q, n, e, e)``.

    M is that by v and v, C by v and q (None: zero), K minus that by q and q.
    """

    mass: Array
    mixed: Array | None
    stiffness: Array

    def of(self, places: Places) -> "Linearisation":
        """Those of some members, copied."""
        return Linearisation(*(None if one is None else one[places] for one in self))  # type: ignore[arg-type]

    def copy(self) -> "Linearisation":
        """Arrays of its own."""
        return Linearisation(*(None if one is None else one.copy() for one in self))  # type: ignore[arg-type]

    def differing(self, other: "Linearisation") -> Places:
        """Members whose second derivatives are others."""
        found = np.zeros(len(self.mass), dtype=bool)
        for own, new in zip(self, other, strict=True):
            # most blocks have those of the one before
            if own is not None and new is not None and own.tobytes() != new.tobytes():
                found |= (own != new).reshape(len(own), -1).any(axis=1)
        return np.flatnonzero(found)

    def terms_of(self, origin: Array, points: Array) -> Array:
        r"""Sizes of what cancels in remainders at points, ``(q, n, e)`` or ``(q, n, 2 e)``.

        They are :math:`|M||v| + |C|(|x| + |\Delta|)` and :math:`|K|(|x| + |\Delta|) + |C|^T|v|`:
        positions are rounded before any formula sees them.
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

    def put(self, places: Places, other: "Linearisation") -> None:
        """Take those of `other` for some members."""
        for own, new in zip(self, other, strict=True):
            if own is not None and new is not None:
                own[places] = new


class StepLaw(Protocol):
    """The conservative part of q scenes of one kind.

    Attributes
    ----------
    is_linear
        Whether there is never a remainder.
    has_rates
        Whether remainders depend on the velocities, and momenta have some of their own: points
        are then ``(displacement, velocity)`` and remainders ``(of momenta, of forces)`` in the
        last axis.
    """

    is_linear: bool
    has_rates: bool

    def of(self, places: Places) -> "StepLaw":
        """That of some members."""

    def momentum(self, x: Array, v: Array, t: float) -> Array:
        """P, all ``(q, e)``."""

    def velocity(self, x: Array, p: Array, t: float) -> Array:
        """The v with P = p, all ``(q, e)``; nan where there is none."""

    def linearise(
        self, x: Array, v: Array | None, t: Array | float, *, per_point: bool = False
    ) -> Linearisation:
        """Second derivatives at ``(q, n, e)``, of the first point alone or at each."""

    def remainder(
        self, at: Linearisation, origin: Array, points: Array, t: Array, before: Array
    ) -> Array:
        """Remainders ``(q, n, e)`` or ``(q, n, 2 e)`` of points that belong to those `before`.

        `origin` is the position at the beginning of the steps, ``(q, e)``.
        """


def force_of(stiffness: Array, displacement: Array) -> Array:
    """K Delta of stiffnesses ``(q, e, e)`` or ``(q, n, e, e)`` and ``(q, n, e)``."""
    if displacement.shape[-1] == 1:
        return displacement * (stiffness if stiffness.ndim == 3 else stiffness[..., 0])
    if stiffness.ndim == 3:
        return np.asarray(np.matmul(displacement, stiffness))
    return np.asarray(np.matmul(stiffness, displacement[..., None])[..., 0])


def _velocity(mass: Array, p: Array) -> Array:
    """Inverse of M times p."""
    if p.shape[-1] == 1:
        return p / mass[..., 0]
    return np.asarray(np.linalg.solve(mass, p[..., None])[..., 0])


@dataclass(eq=False, kw_only=True)
class Linear:
    """Constant mass and stiffness, each ``(q, e, e)``."""

    mass: Array
    stiffness: Array
    is_linear: bool = field(default=True, init=False)
    has_rates: bool = field(default=False, init=False)

    def of(self, places: Places) -> "Linear":
        """That of some members."""
        return Linear(mass=self.mass[places], stiffness=self.stiffness[places])

    def momentum(self, x: Array, v: Array, t: float) -> Array:
        """M v."""
        return apply(self.mass, v)

    def velocity(self, x: Array, p: Array, t: float) -> Array:
        """Inverse of M times p."""
        return _velocity(self.mass, p)

    def linearise(
        self, x: Array, v: Array | None, t: Array | float, *, per_point: bool = False
    ) -> Linearisation:
        """M and K themselves."""
        return Linearisation(self.mass, None, self.stiffness)

    def remainder(
        self, at: Linearisation, origin: Array, points: Array, t: Array, before: Array
    ) -> Array:
        """Zero."""
        return np.zeros_like(points)


@dataclass(eq=False, kw_only=True)
class Separable:
    r""":math:`L = v^T M v / 2 - V(q)` with the same formulas or functions for all members.

    The remainder is :math:`K \Delta - \nabla V(q)`.
    """

    mass: Array  # M, (q, e, e)
    # a potential, for its programs; functions of the user bring their stiffness with them
    formulas: ExpressionPotential | SuppliedPotential
    parameters: Mapping[str, Array]  # values of the names in them, (q, 1) each
    # matrices whose quadratic forms V has besides, (q, e, e); None: there are none
    stiffness: Array | None = None
    is_linear: bool = field(default=False, init=False)
    has_rates: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        own = self.formulas
        self._gradient: Callable[[Array], Array] = own.gradient
        self._hessian: Callable[[Array], Array] = own.hessian
        if isinstance(own, SuppliedPotential):
            return
        self._gradient = PointFormulas(own.gradient_system, own.coordinates, self.parameters)
        self._hessian = PointFormulas(own.hessian_system, own.coordinates, self.parameters)

    def of(self, places: Places) -> "Separable":
        """That of some members."""
        return Separable(
            mass=self.mass[places],
            formulas=self.formulas,
            parameters={name: one[places] for name, one in self.parameters.items()},
            stiffness=None if self.stiffness is None else self.stiffness[places],
        )

    def momentum(self, x: Array, v: Array, t: float) -> Array:
        """M v."""
        return apply(self.mass, v)

    def velocity(self, x: Array, p: Array, t: float) -> Array:
        """Inverse of M times p."""
        return _velocity(self.mass, p)

    def gradient(self, x: Array) -> Array:
        """The gradient of V at ``(q, n, e)``."""
        found = self._gradient(x)
        return found if self.stiffness is None else found + force_of(self.stiffness, x)

    def linearise(
        self, x: Array, v: Array | None, t: Array | float, *, per_point: bool = False
    ) -> Linearisation:
        """M and second derivatives of V; zero for members where these are not finite."""
        e = x.shape[-1]
        second = self._hessian(x).reshape(*x.shape, e)
        if self.stiffness is not None:
            second += self.stiffness[:, None]
        if not math.isfinite(np.add.reduce(second, axis=None)):
            finite = np.isfinite(second).all(axis=(1, 2, 3), keepdims=True)
            second = np.where(finite, second, 0.0)
        if e > 1:
            second = 0.5 * (second + second.swapaxes(-1, -2))
        return Linearisation(self.mass, None, second if per_point else second[:, 0])

    def remainder(
        self, at: Linearisation, origin: Array, points: Array, t: Array, before: Array
    ) -> Array:
        """K Delta less the gradient."""
        return force_of(at.stiffness, points) - self.gradient(origin[:, None] + points)


@dataclass(eq=False, kw_only=True)
class General:
    """Any L(q, v, t) with the same formulas for all members."""

    lagrangian: Lagrangian  # one of the members, for its programs
    parameters: Mapping[str, Array]  # values of the names in them, (q, 1) each
    # matrices whose quadratic forms are taken from L, (q, e, e); None: there are none
    stiffness: Array | None = None
    is_linear: bool = field(default=False, init=False)
    has_rates: bool = field(default=True, init=False)

    def __post_init__(self) -> None:
        own = self.lagrangian
        self._first = PointFormulas(own.first, own.variables, self.parameters)
        self._second = PointFormulas(own.second, own.variables, self.parameters)

    def of(self, places: Places) -> "General":
        """That of some members."""
        return General(
            lagrangian=self.lagrangian,
            parameters={name: one[places] for name, one in self.parameters.items()},
            stiffness=None if self.stiffness is None else self.stiffness[places],
        )

    def momentum(self, x: Array, v: Array, t: float) -> Array:
        """dL/dv."""
        return self._first(x[:, None], v[:, None], np.full((1, 1), t))[:, 0, : x.shape[1]]

    def velocity(self, x: Array, p: Array, t: float) -> Array:
        """By Newton's iteration, for every member by itself."""
        e = x.shape[-1]

        def mismatch(v: Array) -> tuple[Array, Array, Array]:
            values = self._second(x[:, None], v[:, None], np.full((1, 1), t))[:, 0]
            mass = values[:, 2 * e : 2 * e + e * e].reshape(-1, e, e)
            own = values[:, :e]
            terms = apply(np.abs(mass), np.abs(v)) + np.abs(p) + np.abs(own)
            return own - p, mass, terms

        v, found, _ = find_roots(mismatch, np.zeros_like(p))
        return np.where(found[:, None], v, np.nan)

    def _first_at(self, x: Array, v: Array, t: Array | float) -> Array:
        """P and Q in one array, ``(q, n, 2 e)``."""
        found, e = self._first(x, v, np.asarray(t)[..., None]), x.shape[-1]
        if self.stiffness is not None:
            found[..., e:] -= force_of(self.stiffness, x)
        return found

    def _second_at(self, x: Array, v: Array, t: Array | float) -> tuple[Array, Array]:
        """P and Q in one array, and the second derivatives ``(q, n, 3, e, e)``."""
        found, e = self._second(x, v, np.asarray(t)[..., None]), x.shape[-1]
        first, second = found[..., : 2 * e], found[..., 2 * e :].reshape(*x.shape[:-1], 3, e, e)
        if self.stiffness is not None:
            first[..., e:] -= force_of(self.stiffness, x)
            second[..., 2, :, :] -= self.stiffness[:, None]
        return first, second

    def linearise(
        self, x: Array, v: Array | None, t: Array | float, *, per_point: bool = False
    ) -> Linearisation:
        """The second derivatives of L; without the mixed ones where they are for all points."""
        if v is None:
            raise ValueError("velocities: they are needed for a general Lagrangian")
        _, second = self._second_at(x, v, t)
        mass, mixed, curvature = (second[..., index, :, :] for index in range(3))
        if per_point:
            return Linearisation(mass, mixed, -curvature)
        stiffness = -0.5 * (curvature + curvature.swapaxes(-1, -2))
        return Linearisation(mass[:, 0], None, stiffness[:, 0])

    def remainder(
        self, at: Linearisation, origin: Array, points: Array, t: Array, before: Array
    ) -> Array:
        """Remainders of momenta and of forces in one array.

        With second derivatives at every point this is Newton's iteration. With those for all
        points the velocities are corrected to the momenta first, since a mass that is not constant
        would be iterated slowly otherwise.
        """
        mass, mixed, stiffness = at
        e = origin.shape[-1]
        displacement, v = points[..., :e], points[..., e:]
        if mixed is not None:
            first = self._first_at(origin[:, None] + displacement, v, t)
            momentum = np.matmul(mass, v[..., None]) + np.matmul(mixed, displacement[..., None])
            force = np.matmul(stiffness, displacement[..., None])
            force -= np.matmul(mixed.swapaxes(2, 3), v[..., None])
            own = np.concatenate([-momentum[..., 0], force[..., 0]], axis=-1)
            return np.asarray(first + own)
        first, second = self._second_at(origin[:, None] + displacement, v, t)
        known = np.matmul(v, mass) + before[..., :e]
        own, cross = second[..., 0, :, :], second[..., 1, :, :]
        change = np.linalg.solve(own, (known - first[..., :e])[..., None])[..., 0]
        force = first[..., e:] + np.matmul(change[..., None, :], cross)[..., 0, :]
        return np.concatenate(
            [
                known - np.matmul(v + change, mass),
                force + np.matmul(displacement, stiffness),
            ],
            axis=-1,
        )


def modes_of(scenes: Sequence[Scene]) -> list[Decoupling] | None:
    """Coordinates in which linear scenes fall apart."""
    found = [linear_decoupling(one) for one in scenes]
    known = [one for one in found if one is not None]
    return known if len(known) == len(found) else None


def law_of(scenes: Sequence[Scene], modes: Sequence[Decoupling] | None) -> StepLaw:
    """The conservative part of scenes of one kind, in these coordinates."""
    if modes is not None:
        mass, stiffness = [], []
        for mode, one in zip(modes, scenes, strict=True):
            mass.append(mode.matrices(one.inertia.mass))
            k = np.zeros((one.dimension,) * 2)
            if isinstance(one.potential, QuadraticPotential):
                k = one.potential.stiffness
            stiffness.append(mode.matrices(k))
        return Linear(mass=np.concatenate(mass), stiffness=np.concatenate(stiffness))
    first = scenes[0]
    if first.lagrangian is not None:
        lagrangians = [one.lagrangian for one in scenes if one.lagrangian is not None]
        stiffness = [one.stiffness for one in lagrangians if one.stiffness is not None]
        return General(
            lagrangian=first.lagrangian,
            parameters=_columns([one.parameters for one in lagrangians]),
            stiffness=np.array(stiffness) if stiffness else None,
        )
    potentials = [one.potential for one in scenes]
    masses = np.array([one.inertia.mass for one in scenes])
    if isinstance(own := potentials[0], SuppliedPotential):
        return Separable(mass=masses, formulas=own, parameters={})
    known = [one for one in potentials if isinstance(one, ExpressionPotential)]
    if len(known) != len(potentials):
        raise ValueError("scenes: all must be of one kind")
    forms = [dense(one.stiffness) for one in known if one.stiffness is not None]
    return Separable(
        mass=masses,
        formulas=known[0],
        parameters=_columns([one.parameters for one in known]),
        stiffness=np.array(forms) if forms else None,
    )


def _columns(parameters: Sequence[Mapping[str, float | Array]]) -> dict[str, Array]:
    """Values of every name, ``(q, 1)``."""
    return {name: np.array([[float(one[name])] for one in parameters]) for name in parameters[0]}
