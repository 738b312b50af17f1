r"""Expressions along a run, and their derivatives by its motion and by parameters.

A value depends on position and velocity, on the forces of the damping terms at the stages (the
polynomials through them), and on the numbers of the scene. Through an acceleration

.. math:: M a = f - \nabla V(x) - F, \qquad
          L_{vv} a = L_x - L_{vx} v - L_{vt} + f - F

it depends on all of them; the right-hand sides are differentiated with a held fixed.

Shapes: n times, d components, p parameters, f damping terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from fvi_cli.effects.damping import MatrixForce
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.linearised import LinearisedRun, Tangent
from fvi_cli.integrator.gradients.parameters import (
    MEMORY,
    Parameter,
    by_rule,
    rate_of_forcing,
    rate_of_remainder,
    rule_of,
)
from fvi_cli.integrator.observe.dampers import (
    TOGETHER,
    DamperValue,
    damper_alone,
    damper_values,
    dampers_of,
    deformation_of,
)
from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.observe.observer import Observer
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.mathematics.arrays import Array, Mask
from fvi_cli.mathematics.expressions import Expression, slopes_of
from fvi_cli.mathematics.lagrange import lobatto_basis

ON_FORCES = (*MEMORY, "mass", "stiffness", "initial_position")
"""Kinds of numbers on which forces and accelerations depend at fixed motion."""


class Along:
    """An expression at n times of a run, in the names of its motion: its values, ``(n,)``.

    `parameters` are those of :meth:`rates`: where they are known, forces are computed only once.

    Raises
    ------
    ValueError
        For times outside of the run.
    """

    def __init__(
        self,
        run: LinearisedRun,
        times: Array,
        expression: Expression,
        names: Observations,
        parameters: Sequence[Parameter] | None = None,
    ) -> None:
        self._run, self._names, self._expression = run, names, expression
        dampers, used = damper_values(run.scene), expression.names
        given = {*names.derived, *names.parameters, *names.inputs}
        moving = {name: dampers[name] for name in dampers.keys() & used - given}
        kinds = {names.derived[name][0] for name in used & names.derived.keys()}
        self.has_forces = bool(
            kinds & {"a", "d"} or any(one.kind == "force" for one in moving.values())
        )
        scenes, weights = [run.scene], np.zeros((0, 1))
        if self.has_forces and parameters is not None:
            scenes, weights = rule_of(run.scene, parameters, ON_FORCES)
        self._motion = self._motion_of(scenes)
        self._places = self._motion.located(0, times)
        observer = Observer(self._motion, [names] * len(scenes))
        values = self._values_along(observer)
        self.values = values[0]
        self._by_forces = None if parameters is None else weights @ values
        known = {**names.parameters, **observer.variables(expression, *self._places)}
        found = slopes_of(expression, known, {*given, *dampers})
        self._by_name = {name: np.broadcast_to(one, times.size) for name, one in found.items()}
        self._dampers = [
            (one, self._by_name[name]) for name, one in moving.items() if name in found
        ]

    def _motion_of(self, scenes: Sequence[Scene]) -> Motion:
        """The same motion under the forces of scenes, one member for each."""
        run = self._run

        def forces(place: int | None) -> list[Array]:
            velocity, acting = run.steps.velocity, list(scenes)
            if place is not None:
                velocity = deformation_of(run.scene, place, velocity)
                acting = [damper_alone(one, place) for one in scenes]
            return run.forces_of(acting, velocity)

        return Motion(scenes, [run.steps] * len(scenes), forces)

    def rates(self, parameters: Sequence[Parameter]) -> Array:
        """Derivatives by p parameters with the motion held fixed, ``(p, n)``."""
        total, time = np.zeros((len(parameters), self.values.size)), self._points[3]
        by_force, scene = self._through_accelerations[2], self._run.scene
        for own, one in zip(total, parameters, strict=True):
            for name, slope in self._by_name.items():
                own += slope * one.of(f"names.{name}")
                given = rate_of_forcing(self._names.inputs.get(name), one, f"inputs.{name}")
                if given is not None:
                    own += slope * given(time)[:, 0]
            if by_force.any():
                acted = rate_of_remainder(scene, one, *self._points)
                if (forcing := rate_of_forcing(scene.forcing, one, "forcing")) is not None:
                    acted = acted + forcing(time)
                own += (by_force * acted).sum(axis=1)
            if not self.has_forces:
                # where there are forces, the rule below knows the given velocity
                begun = np.zeros(self._run.d) + one.of("initial_velocity")
                own[self._starts] += self._slopes[1][self._starts] @ begun
        if self.has_forces:
            found = self._by_forces
            if found is None:
                found = by_rule(scene, parameters, ON_FORCES, self._values_of)
            total += found
        return total

    def _values_of(self, scenes: list[Scene]) -> Array:
        """Values of the expression with the forces of other scenes, ``(k, n)``."""
        return self._values_along(Observer(self._motion_of(scenes), [self._names] * len(scenes)))

    def _values_along(self, observer: Observer) -> Array:
        """Values of the expression along the motions of an observer, ``(k, n)``."""
        (step, tau), firsts = self._places, observer.motion.firsts[:-1]
        steps = np.concatenate([step + first for first in firsts])
        found = observer.along(self._expression)(steps, np.tile(tau, len(firsts)))
        return found.reshape(len(firsts), -1)

    def changes(self, tangent: Tangent) -> Array:
        """Derivatives by p parameters through the motion, ``(n, p)``."""
        position, velocity, terms = self._slopes
        which, rows = self._places[0], self._rows
        moved, turned = np.einsum("ikr,pkrd->ipkd", rows, tangent.velocity[:, which])
        moved += tangent.position[:, which]
        found = np.einsum("kd,pkd->kp", position, moved)
        found += np.einsum("kd,pkd->kp", velocity, turned)
        for by, force in zip(terms, tangent.forces, strict=True):
            if by.any():
                found += np.einsum("kd,kr,pkrd->kp", by, self._of_stages, force[:, which])
        return np.asarray(found)

    def spread(self, by_value: Array) -> tuple[Array, Array, Array]:
        """The arguments of :meth:`LinearisedRun.adjoint`, from derivatives by the values."""
        position, velocity, terms = (by_value[:, None] * one for one in self._slopes)
        n, which = self._run.steps.n_steps, self._places[0]
        by_motion = np.stack([position, velocity])
        at_points = np.zeros((n + 1, position.shape[1]))
        at_stages = np.zeros_like(self._run.steps.velocity)
        forces = np.zeros((len(terms), *at_stages.shape))
        np.add.at(at_points, which, position)
        np.add.at(at_stages, which, np.einsum("ikr,ikd->krd", self._rows, by_motion))
        for force, by in zip(forces, terms, strict=True):
            np.add.at(force, which, np.einsum("kr,kd->krd", self._of_stages, by))
        return at_points, at_stages, forces

    @cached_property
    def _rows(self) -> Array:
        """From velocities at the stages to displacements in the step and velocities, (2, n, r)."""
        steps, (which, tau) = self._run.steps, self._places
        basis = lobatto_basis(steps.tables.degree)
        moved = steps.step_size[which] * basis.values(tau)[1:]
        rows = np.stack([moved.T, basis.derivatives(tau)[1:].T])
        # at the start the velocity is the one that is given
        rows[1, self._starts] = 0.0
        return np.asarray(rows @ steps.tables.to_unknowns)

    @cached_property
    def _starts(self) -> Mask:
        return np.asarray((self._places[0] == 0) & (self._places[1] == 0.0))

    @cached_property
    def _of_stages(self) -> Array:
        """From values at the stages to those of their polynomial, ``(n, r)``."""
        tables, (which, tau) = self._run.steps.tables, self._places
        if tables.points.size == 1:
            return np.ones((which.size, 1))
        return np.asarray(tables.stage_basis.values(tau).T)

    @cached_property
    def _rates(self) -> dict[str, Array]:
        """Derivatives by positions, velocities, accelerations and damping forces, (n, d) each."""
        rows = {kind: np.zeros((self.values.size, self._run.d)) for kind in ("", "v", "a", "d")}
        for name, (prefix, index) in self._names.derived.items():
            if name in self._by_name:
                rows[prefix][:, index] = self._by_name[name]
        return rows

    @cached_property
    def _points(self) -> list[Array]:
        """Positions, velocities, accelerations where they matter, and times of the values."""
        motion, places = self._motion, self._places
        position, velocity = motion.position(*places), motion.velocity(*places)
        acted = motion.acceleration(*places) if self._rates["a"].any() else 0.0 * velocity
        return [position, velocity, acted, motion.time(*places)]

    @cached_property
    def _through_accelerations(self) -> Array:
        """Derivatives by position, velocity and force through accelerations, ``(3, n, d)``."""
        weights, scene = self._rates["a"], self._run.scene
        if not weights.any():
            return np.zeros((3, *weights.shape))
        position, velocity, acceleration, time = self._points
        at = scene.derivatives(position, velocity, time)
        share = np.linalg.solve(at.mass, weights[..., None])[..., 0]
        if scene.lagrangian is None:
            return np.stack([(at.stiffness @ share[..., None])[..., 0], 0.0 * share, share])
        slopes = scene.lagrangian.remainder_slopes(position, velocity, acceleration, time)
        return np.stack([*np.einsum("nd,nkbd->knb", share, slopes), share])

    @cached_property
    def _slopes(self) -> tuple[Array, Array, Array]:
        """Derivatives by positions and velocities, ``(n, d)``, and forces of terms ``(f, n, d)``.

        Forces of terms are those without their matrices.
        """
        scene, rows = self._run.scene, self._rates
        position, velocity, force = self._through_accelerations
        position, velocity = position + rows[""], velocity + rows["v"]
        terms = -np.matmul(rows["d"] + force, self._run.coefficients)
        every = [*scene.damping, *scene.laws]
        for value, slope in self._dampers:
            dampers = dampers_of(scene)
            for parts in dampers if value.place == TOGETHER else [dampers[value.place]]:
                rates = slope[:, None]
                if value.kind == "deformation":
                    unit = np.eye(parts[0].inner.shape[0])
                    position = position + rates * _row(parts[0], unit, value)
                    continue
                for one in parts:
                    row, size = rates * _row(one, dense(one.inner), value), 1.0
                    if isinstance(one, Law):
                        size = one.size
                        position = position + one.spring * row
                    terms[every.index(one)] += size * row
        return position, velocity, terms


def _row(one: MatrixForce, matrix: Array, value: DamperValue) -> Array:
    """A row of a matrix on the deformation of a damper as one on the coordinates, ``(d,)``."""
    row = matrix[value.component]
    return row if one.factored is None else np.asarray(row @ one.factored.rows)
