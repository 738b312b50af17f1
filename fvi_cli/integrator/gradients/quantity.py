r"""Numbers that are computed from a trajectory at any times, and expressions along it with slopes.

A value depends on position and velocity, on the damping force F there (the polynomial through
its values at the stages), and on the numbers of the scene. Through an acceleration

.. math:: M a = f - \nabla V(x) - F, \qquad
          L_{vv} a = L_x - L_{vx} v - L_{vt} + f - F

it depends on all of them; the right-hand sides are differentiated with a held fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun, Tangent, damped
from fvi_cli.integrator.gradients.parameters import (
    Parameter,
    by_initial_loads,
    memory_rates,
    moves_initial_loads,
    rate_of_forcing,
    rate_of_remainder,
)
from fvi_cli.integrator.observe.dampers import (
    TOGETHER,
    DamperForce,
    damper_alone,
    damper_values,
    dampers_of,
    forces_along,
)
from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.observe.observer import Observer
from fvi_cli.integrator.observe.request import Observations, known_names
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression, slopes_of
from fvi_cli.mathematics.lagrange import lobatto_basis


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    """A number computed from an expression at some times.

    Parameters
    ----------
    times
        Shape ``(n,)``, in any order; values inside a step come from its polynomial.
    value
        From the values of the expression there, ``(n,)``, to the number.
    slopes
        From the same values to the derivatives by them, ``(n,)``.
    of
        The expression, in t, coordinates, ``v<name>``, ``a<name>``, ``d<name>``, ``force_1`` and
        ``deformation_1`` of dampers, or the name of a quantity of an experiment; or a function from
        the names of the coordinates to it.

    Raises
    ------
    ValueError
        For times that are not finite numbers in one row.
    """

    times: Array
    value: Callable[[Array], float]
    slopes: Callable[[Array], Array]
    of: str | Callable[[Sequence[str]], str]

    def __post_init__(self) -> None:
        times = np.atleast_1d(np.array(self.times, dtype=float))
        if times.ndim != 1 or not times.size or not np.isfinite(times).all():
            raise ValueError("times: finite numbers are needed, at least one")
        object.__setattr__(self, "times", times)

    def expression(self, request: Observations, scene: Scene) -> Expression:
        """The expression that `of` gives, in the names of a motion.

        Raises
        ------
        ValueError
            For names that are not known, or have no derivative.
        """
        text = self.of if isinstance(self.of, str) else self.of(request.coordinates)
        quantities = request.quantities or {}
        names = known_names(request.coordinates, (*request.parameters, *request.inputs))
        dampers = {name: o for name, o in damper_values(scene).items() if name not in names}
        works = [name for name, one in dampers.items() if one.kind == "work"]
        names = (*names, *(name for name in dampers if name not in works))
        try:
            every = tuple(dict.fromkeys((*names, *works, *request.ready)))
            parsed = quantities.get(text) or Expression.parse(text, variables=every)
            found = parsed.expand(request.ready)
        except ValueError as error:
            others = f"; quantities: {', '.join(quantities)}" if quantities else ""
            raise ValueError(f"quantity: {error}{others}") from None
        for name in sorted(found.names.intersection(works)):
            raise ValueError(
                f"quantity: {name} adds up from the beginning of the run, and has no derivative "
                f"here; differentiable here: {', '.join(names)}"
            )
        return found


def position_at(time: float, component: int = 0) -> Quantity:
    """One coordinate at one time."""
    return quantity_at(_coordinate("", component), time)


def velocity_at(time: float, component: int = 0) -> Quantity:
    """One velocity at one time."""
    return quantity_at(_coordinate("v", component), time)


def acceleration_at(time: float, component: int = 0) -> Quantity:
    """One acceleration at one time, from the equation of motion."""
    return quantity_at(_coordinate("a", component), time)


def quantity_at(of: str | Callable[[Sequence[str]], str], time: float) -> Quantity:
    """The value of an expression at one time, as :class:`Quantity` knows it."""
    return Quantity(
        times=np.array([time]), of=of, value=lambda values: float(values[0]), slopes=np.ones_like
    )


def _coordinate(prefix: str, component: int) -> Callable[[Sequence[str]], str]:
    def name(coordinates: Sequence[str]) -> str:
        if not 0 <= component < len(coordinates):
            raise ValueError(f"component: {component} is not one of 0 to {len(coordinates) - 1}")
        found = prefix + coordinates[component]
        if prefix and found in coordinates:
            raise ValueError(f"quantity: {found} is itself a coordinate")
        return found

    return name


def misfit(
    times: ArrayLike,
    data: ArrayLike,
    *,
    component: int = 0,
    deviation: float = 1.0,
    of: str | None = None,
) -> Quantity:
    r"""Half the sum of squares of :math:`(y(t_k) - d_k) / \sigma`.

    Parameters
    ----------
    times, data
        :math:`t_k` and :math:`d_k`, shape ``(n,)``.
    component
        Number of the coordinate y, from 0.
    deviation
        :math:`\sigma`, in the unit of the data.
    of
        An expression y in place of a coordinate, as :class:`Quantity` knows it.
    """
    measured = np.asarray(data, dtype=float)

    def value(values: Array) -> float:
        left = (values - measured) / deviation
        return float(0.5 * left @ left)

    return Quantity(
        times=np.asarray(times, dtype=float),
        of=of or _coordinate("", component),
        value=value,
        slopes=lambda values: (values - measured) / deviation**2,
    )


class MotionAt:
    """Positions, velocities and damping forces of a run at k places, ``(k,)`` each."""

    def __init__(self, steps: RunSteps, places: tuple[Places, Array]) -> None:
        self._steps, self._places, self._which = steps, places, places[0]
        basis, tables = lobatto_basis(steps.tables.degree), steps.tables
        displacement = steps.step_size[self._which] * basis.values(places[1])[1:]
        # factors of velocities at the stages, and of other values there
        by_unknowns = np.stack([displacement.T, basis.derivatives(places[1])[1:].T])
        self._rows = by_unknowns @ tables.to_unknowns
        self._of_stages = np.ones((self._which.size, 1))
        if tables.points.size > 1:
            self._of_stages = np.ascontiguousarray(tables.stage_basis.values(places[1]).T)

    def motion(self) -> tuple[Array, Array]:
        """Positions and velocities, each ``(k, d)``."""
        return self._steps.position_in(*self._places), self._steps.velocity_in(*self._places)

    def changes(self, tangent: Tangent) -> tuple[Array, Array]:
        """Changes of positions and velocities by disturbances, each ``(p, k, d)``."""
        stages = tangent.velocity[:, self._which]
        displacement, velocity = np.einsum("ikr,pkrd->ipkd", self._rows, stages)
        return tangent.position[:, self._which] + displacement, velocity

    def force_changes(self, force: Array) -> Array:
        """Changes of a force from those at the stages, ``(p, k, d)``."""
        return np.asarray(np.einsum("kr,pkrd->pkd", self._of_stages, force[:, self._which]))

    def spread(self, by_position: Array, by_velocity: Array) -> tuple[Array, Array]:
        """Derivatives by mesh points and velocities at the stages, from those by the motion."""
        by_motion = np.stack([by_position, by_velocity])
        n = len(self._steps.position)
        return (
            self._gathered(by_position, n),
            self._gathered(np.einsum("ikr,ikd->krd", self._rows, by_motion), n - 1),
        )

    def spread_force(self, by_force: Array) -> Array:
        """Derivatives by a force at the stages, ``(n, r, d)``, from those by the force."""
        own = np.einsum("kr,kd->krd", self._of_stages, by_force)
        return self._gathered(own, self._steps.n_steps)

    def _gathered(self, values: Array, count: int) -> Array:
        """Sums over the places of every step."""
        found = np.zeros((count, *values.shape[1:]))
        np.add.at(found, self._which, values)
        return found


class _Slopes(NamedTuple):
    """Derivatives of n values, ``(n, d)`` each, with what is named last held fixed."""

    position: Array
    velocity: Array
    force: Array  # by forces from outside, through accelerations
    damping: Array  # by the force F of all damping, through accelerations as well
    # by the forces of terms and laws without their matrices, by their places
    terms: Mapping[int, Array]


class _Share(NamedTuple):
    """Derivatives ``(n,)`` by one component of the force of a damper."""

    place: int  # among the dampers
    component: int
    values: Array


class Formula:
    """An expression at n times of a run, in the names of its motion: its values, ``(n,)``.

    Raises
    ------
    ValueError
        For times outside of the run.
    """

    def __init__(
        self, run: LinearisedRun, times: Array, expression: Expression, names: Observations
    ) -> None:
        self._run, self._names, scene = run, names, run.scene
        used = expression.names
        kinds = {prefix for name, (prefix, _) in names.derived.items() if name in used}
        force = damped(run.plain_forces, run.coefficients) if kinds & {"a", "d"} else None

        def forces(place: int | None) -> Sequence[Array]:
            if place is None:
                return [np.zeros_like(run.steps.velocity) if force is None else force]
            return forces_along([scene], run.method, [run.steps], place)

        self._motion = Motion([scene], [run.steps], forces)
        self._places = places = self._motion.located(0, times)
        self._at = MotionAt(run.steps, places)
        observer = Observer(self._motion, [names])
        self.values = observer.along(expression)(*places)
        known = {**names.parameters, **observer.variables(expression, *places)}
        dampers, n = damper_values(scene), times.size
        wanted = {*names.derived, *names.inputs, *names.parameters, *dampers}
        found = slopes_of(expression, known, wanted)
        self._by_name = {name: np.broadcast_to(one, n) for name, one in found.items()}
        self._by_damper = [
            (dampers[name].kind, _Share(place, dampers[name].component, one))
            for name, one in self._by_name.items()
            if name in dampers and name not in {*names.derived, *names.parameters}
            for place in self._dampers(dampers[name].place)
        ]

    def _dampers(self, place: int) -> range:
        every = range(len(dampers_of(self._run.scene)))
        return every if place == TOGETHER else range(place, place + 1)

    @cached_property
    def _slopes(self) -> _Slopes:
        scene = self._run.scene
        by = np.zeros((4, self.values.size, scene.dimension))
        position, velocity, acceleration, damping = by
        rows = {"": position, "v": velocity, "a": acceleration, "d": damping}
        for name, rate in self._by_name.items():
            if name in self._names.derived:
                prefix, index = self._names.derived[name]
                rows[prefix][:, index] = rate
        terms = dict[int, Array]()
        for kind, share in self._by_damper:
            parts = _parts(scene, share.place)
            if kind == "deformation":
                position += share.values[:, None] * _row(parts[0][1], np.eye(_size(parts)), share)
                continue
            for place, one in parts:
                row = share.values[:, None] * _row(one, dense(one.inner), share)
                size = 1.0
                if isinstance(one, Law):
                    size = one.size
                    position += one.spring * row
                terms[place] = size * row + terms.get(place, 0.0)
        force = np.zeros_like(position)
        if acceleration.any():
            moved, turned, force = _through_accelerations(self._motion, self._places, acceleration)
            position, velocity = position + moved, velocity + turned
        return _Slopes(position, velocity, force, -damping - force, terms)

    def objection(self, one: Parameter) -> str:
        """Why the values have no derivative by a parameter; empty if they have one."""
        scene, by = self._run.scene, self._slopes
        if scene.derivative == "caputo" or not scene.acts_above_order_1:
            return ""
        if not np.any(one.of("initial_velocity")) or not (by.damping.any() or by.terms):
            return ""
        return (
            f"{one.name}: forces of Riemann-Liouville derivatives above order 1 with a start "
            "velocity keep an error of the first step; use caputo"
        )

    def spread(self, by_value: Array) -> tuple[Array, Array, Array | None, Array | None]:
        """The arguments of :meth:`LinearisedRun.adjoint`, from derivatives by the values."""
        by, weights, terms = self._slopes, by_value[:, None], None
        if by.terms:
            terms = np.zeros((len(self._run.coefficients), *self._run.steps.velocity.shape))
            for place, one in by.terms.items():
                terms[place] = self._at.spread_force(weights * one)
        whole = self._at.spread_force(weights * by.damping) if by.damping.any() else None
        return (*self._at.spread(weights * by.position, weights * by.velocity), whole, terms)

    def changes(self, tangent: Tangent, change: Disturbance) -> Array:
        """Derivatives by parameters through the motion, ``(n, p)``."""
        by = self._slopes
        pairs = list(zip((by.position, by.velocity), self._at.changes(tangent), strict=True))
        if by.damping.any() or by.terms:
            plain = tangent.plain_forces
            whole = np.add(change.damping, damped(plain, self._run.coefficients))
            pairs += [
                (by, self._at.force_changes(one))
                for by, one in [(by.damping, whole), *((by.terms[k], plain[k]) for k in by.terms)]
            ]
        return np.asarray(sum(np.einsum("nd,pnd->np", by, one) for by, one in pairs))

    def rates(self, one: Parameter) -> Array:
        """Derivatives by a parameter with the motion held fixed, ``(n,)``.

        The force of all damping is held fixed as well, the force of a single damper is not.
        """
        total, scene, by = np.zeros(self.values.size), self._run.scene, self._slopes
        time = self._motion.time(*self._places)
        for name, slope in self._by_name.items():
            total += slope * one.of(f"names.{name}")
            given = rate_of_forcing(self._names.inputs.get(name), one, f"inputs.{name}")
            if given is not None:
                total += slope * given(time)[:, 0]
        if by.force.any():
            acted = rate_of_remainder(
                scene,
                one,
                self._motion.position(*self._places),
                self._motion.velocity(*self._places),
                self._motion.acceleration(*self._places),
                time,
            )
            if (forcing := rate_of_forcing(scene.forcing, one, "forcing")) is not None:
                acted = acted + forcing(time)
            total += (by.force * acted).sum(axis=1)
        moves = moves_initial_loads(scene, one)
        if moves and by.damping.any():
            acted = by_initial_loads(scene, one, lambda own: own.initial_force(time))
            total -= (by.damping * acted).sum(axis=1)
        shares = [share for kind, share in self._by_damper if kind == "force"]
        return total + self._rates_of_dampers(one, shares, time, moves) if shares else total

    def _rates_of_dampers(
        self, one: Parameter, shares: Sequence[_Share], time: Array, moves_loads: bool
    ) -> Array:
        """The part of forces of single dampers."""
        scene, rates = self._run.scene, memory_rates(self._run, one)
        position, total = self._motion.position(*self._places), np.zeros(self.values.size)
        for share in shares:
            for place, term in _parts(scene, share.place):
                plain = np.stack([self._run.plain_forces[place], rates.plain[place]])
                own, moved = self._at.force_changes(plain)
                inner, size = dense(term.inner), 1.0
                found = own @ _row(term, rates.matrices[place], share)
                if isinstance(term, Law):
                    key, size = f"laws.{place - len(scene.damping)}", term.size
                    spring = one.of(f"{key}.spring") * inner
                    spring = spring + term.spring * one.of(f"{key}.coefficient")
                    if np.any(spring):
                        found += position @ _row(term, spring, share)
                total += share.values * (found + size * moved @ _row(term, inner, share))
            if moves_loads:
                acted = by_initial_loads(scene, one, partial(_initial_force, share.place, time))
                total -= share.values * acted[:, share.component]
        return total


def _initial_force(place: int, time: Array, scene: Scene) -> Array:
    """What the initial data add to the force of a damper, ``(n, c)``."""
    return damper_alone(scene, place).initial_force(time)


def _parts(scene: Scene, place: int) -> list[tuple[int, DamperForce]]:
    """The terms and laws of a damper, with their places among all of the scene."""
    every = [*scene.damping, *scene.laws]
    return [(every.index(one), one) for one in dampers_of(scene)[place]]


def _size(parts: Sequence[tuple[int, DamperForce]]) -> int:
    """Number of components of a deformation."""
    return int(parts[0][1].inner.shape[0])


def _row(damper: DamperForce, matrix: Array, share: _Share) -> Array:
    """A row of a matrix on the deformation as one on the coordinates, ``(d,)``."""
    row = matrix[share.component]
    return row if damper.factored is None else np.asarray(row @ damper.factored.rows)


def _through_accelerations(motion: Motion, places: tuple[Places, Array], weights: Array) -> Array:
    """Derivatives of ``sum(weights * a)`` by position, velocity and force, ``(3, n, d)``."""
    scene: Scene = motion.scenes[0]
    lagrangian, time = scene.lagrangian, motion.time(*places)
    position, velocity = motion.position(*places), motion.velocity(*places)
    if lagrangian is None:
        share = scene.inertia.velocity(weights)
        by_motion = np.zeros((2, *weights.shape))
        if scene.potential is not None:
            hessian = scene.potential.hessian(position)
            by_motion[0] = -np.einsum("nab,nb->na", hessian, share)
        return np.stack([*by_motion, share])
    acceleration = motion.acceleration(*places)
    mass = lagrangian.derivatives(position, velocity, time).mass
    share = np.asarray(np.linalg.solve(mass, weights[..., None])[..., 0], dtype=float)
    slopes = lagrangian.remainder_slopes(position, velocity, acceleration, time)
    return np.stack([*np.einsum("nd,nkbd->knb", share, slopes), share])
