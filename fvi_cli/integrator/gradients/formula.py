r"""Expressions along a run, including accelerations and damping forces, and their derivatives.

A value depends on position and velocity, on the damping force F there (the polynomial through
its values at the stages), and on the scene itself. Through an acceleration

.. math:: M a = f - \nabla V(x) - F, \qquad
          L_{vv} a = L_x - L_{vx} v - L_{vt} + f - F

it depends on all of them; the right-hand sides are differentiated with a held fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.linearised import (
    Disturbance,
    LinearisedRun,
    Tangent,
    damped,
)
from fvi_cli.integrator.gradients.variation import Variation, differentiate
from fvi_cli.integrator.observations.dampers import (
    DamperForce,
    damper_values,
    dampers_of,
    forces_along,
)
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.observer import Observer
from fvi_cli.integrator.observations.request import Observations
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression, slopes_of
from fvi_cli.mathematics.lagrange import lobatto_basis


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


NameResolver = Callable[[int, float], Observations]
"""From the index and a value of a parameter to the names in an expression; index -1: unchanged."""


class Formula:
    """An expression at n times of a run, in the names of `resolve_names`: its values, ``(n,)``.

    Raises
    ------
    ValueError
        For times outside of the run.
    """

    def __init__(
        self, run: LinearisedRun, times: Array, expression: Expression, resolve_names: NameResolver
    ) -> None:
        self._run, self._expression, self._resolve_names = run, expression, resolve_names
        self._own = own = resolve_names(-1, 0.0)
        kinds = {own.derived.get(name, (name, 0))[0] for name in expression.names}
        self._is_of_motion = kinds <= {"", "v", "t"}
        self._dampers = {
            name: one for name, one in damper_values(run.scene).items() if name in kinds
        }
        force = damped(run.plain_forces, run.coefficients) if kinds & {"a", "d"} else None

        def forces(place: int | None, scene: Scene = run.scene) -> Sequence[Array | None]:
            if place is None:
                return (None if force is None else force[None],)
            return forces_along([scene], run.method, [run.steps], place)

        self._forces = forces
        self._motion = DenseMotion(scenes=(run.scene,), steps=(run.steps,), find_forces=forces)
        self._places = self._motion.located(0, times)
        self._at = MotionAt(run.steps, self._places)
        self.values = self._evaluate(self._motion, own)

    def _evaluate(self, motion: DenseMotion, names: Observations) -> Array:
        return Observer(motion, [names]).along(self._expression)(*self._places)

    @cached_property
    def _slopes(self) -> tuple[Array, Array, Array, Mapping[int, Array]]:
        """Derivatives by the position, the velocity and the damping force F, each ``(n, d)``.

        The mapping has the derivatives by forces of single terms without their matrices; its keys
        are the places of the terms among the damping terms and laws of the scene.
        """
        scene, places, derived = self._run.scene, self._places, self._own.derived
        observer = Observer(self._motion, [self._own])
        values = {**self._own.parameters, **observer.variables(self._expression, *places)}
        by = np.zeros((4, places[0].size, scene.dimension))
        position, velocity, acceleration, damping = by
        rows = {"": position, "v": velocity, "a": acceleration, "d": damping}
        found = slopes_of(self._expression, values, {**derived, **self._dampers})
        terms = dict[int, Array]()
        for name, rate in found.items():
            if name in derived:
                prefix, index = derived[name]
                rows[prefix][:, index] = rate
                continue
            value = self._dampers[name]
            parts = dampers_of(scene)[value.place]
            share = np.broadcast_to(rate, places[0].shape)[:, None]
            unit = np.eye(1, parts[0].inner.shape[0], value.component)
            if value.kind == "deformation":
                position += share * _on_coordinates(parts[0], unit)
                continue
            for one in parts:
                row = _on_coordinates(one, np.asarray(times(unit, one.inner)))
                size = 1.0
                if isinstance(one, Law):
                    size = one.size
                    position += one.spring * share * row
                place = [*scene.damping, *scene.laws].index(one)
                terms[place] = terms.get(place, 0.0) + size * share * row
        if acceleration.any():
            by[[0, 1, 3]] += _through_accelerations(self._motion, places, acceleration)
        return position, velocity, -damping, terms

    def spread(self, by_value: Array) -> tuple[Array, Array, Array | None, Array | None]:
        """The arguments of :meth:`LinearisedRun.adjoint`, from derivatives by the values."""
        *motion, force, by_terms = self._slopes
        weights, terms = by_value[:, None], None
        if by_terms:
            terms = np.zeros((len(self._run.coefficients), *self._run.steps.velocity.shape))
            for place, one in by_terms.items():
                terms[place] = self._at.spread_force(weights * one)
        whole = self._at.spread_force(weights * force) if force.any() else None
        return (*self._at.spread(*(weights * one for one in motion)), whole, terms)

    def changes(self, tangent: Tangent, change: Disturbance) -> Array:
        """Derivatives by parameters through the motion, ``(n, p)``."""
        *motion, force, by_terms = self._slopes
        pairs = list(zip(motion, self._at.changes(tangent), strict=True))
        if force.any() or by_terms:
            plain = tangent.plain_forces
            whole = np.add(change.damping, damped(plain, self._run.coefficients))
            pairs += [
                (by, self._at.force_changes(one))
                for by, one in [(force, whole), *((by_terms[k], plain[k]) for k in by_terms)]
            ]
        return np.asarray(sum(np.einsum("nd,pnd->np", by, one) for by, one in pairs))

    def rates(self, variations: Sequence[Variation]) -> Array:
        """Derivatives by parameters with the motion held fixed, ``(n, p)``.

        The force of all damping is held fixed as well, the force of a single damper is not.
        """
        found = np.zeros((self.values.size, len(variations)))
        for index, one in enumerate(variations):
            found[:, index] = self.rate(index, one)
        return found

    def rate(self, index: int, one: Variation) -> Array:
        """One column of :meth:`rates`, ``(n,)``; `index` is the parameter's for `resolve_names`."""
        if self._is_of_motion:
            return np.zeros(self.values.size)
        (found,) = differentiate(one, self._run.scene, partial(self._vary, index))
        return np.asarray(found)

    def _vary(self, index: int, scene: Scene, number: float) -> list[Array]:
        forces = partial(self._forces, scene=scene)
        motion = replace(self._motion, scenes=(scene,), find_forces=forces)
        return [self._evaluate(motion, self._resolve_names(index, number))]


def _on_coordinates(damper: DamperForce, row: Array) -> Array:
    """A row ``(1, c)`` on the deformation as one on the coordinates, ``(1, d)``."""
    return row if damper.factored is None else np.asarray(row @ damper.factored.rows)


def _through_accelerations(
    motion: DenseMotion, places: tuple[NDArray[np.intp], Array], weights: Array
) -> Array:
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
