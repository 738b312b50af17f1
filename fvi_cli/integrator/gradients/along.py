r"""Expressions along a run, and their derivatives by parameters.

A value depends on the motion, on the forces of the damping at the stages (the polynomials through
them), and on the numbers of the scene. What a disturbance does to the motion is observed as the
motion itself is, since positions, velocities, damping forces and deformations are linear in it; an
acceleration is so by

.. math:: M a = f - \nabla V(x) - F, \qquad
          L_{vv} a = L_x - L_{vx} v - L_{vt} + f - F

with the right-hand sides differentiated at fixed a. Shapes: n times, d components, p parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.disturbance import MEMORY, rate_of_forcing, rate_of_remainder
from fvi_cli.integrator.gradients.linearised import LinearisedRun, Tangent
from fvi_cli.integrator.gradients.parameters import Parameter, rule_of
from fvi_cli.integrator.observe.dampers import (
    damper_alone,
    damper_along,
    damper_values,
    deformation_of,
)
from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.observe.observer import Observer
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression, slopes_of

ON_FORCES = (*MEMORY, "mass", "stiffness", "initial_position")
"""Kinds of numbers on which forces and accelerations depend at fixed motion."""


class Along:
    """An expression at n times of a run, in the names of its motion: its values, ``(n,)``.

    Raises
    ------
    ValueError
        For times outside of the run, and forces that have no values.
    """

    def __init__(
        self,
        run: LinearisedRun,
        times: Array,
        expression: Expression,
        names: Observations,
        parameters: Sequence[Parameter] = (),
    ) -> None:
        self._run, self._names, self._parameters = run, names, parameters
        used, derived = expression.names, names.derived
        self._derived = {name: one for name, one in derived.items() if name in used}
        own = {*derived, *names.parameters, *names.inputs}
        dampers = damper_values(run.scene)
        self._dampers = {name: dampers[name] for name in dampers.keys() & used - own}
        self._kinds = {prefix for prefix, _ in self._derived.values()}
        self._kinds |= {one.kind for one in self._dampers.values()}
        is_forced = self._kinds & {"a", "d", "force"}
        scenes, weights = rule_of(
            run.scene, parameters, ON_FORCES if is_forced else ("initial_velocity",)
        )

        self._motion = Motion(
            scenes,
            [run.steps] * len(scenes),
            lambda place: self._forces(scenes, place, run.steps.velocity),
        )
        self._places = self._motion.located(0, times)
        observer = Observer(self._motion, [names] * len(scenes))
        along = observer.along(expression)(*self._places_of(self._motion))
        values = along.reshape(len(scenes), -1)
        self.values = values[0]
        self._at_fixed_motion = weights @ values
        known = {**names.parameters, **observer.variables(expression, *self._places)}
        self._slopes = slopes_of(expression, known, {*own, *self._dampers})

    def _forces(self, scenes: Sequence[Scene], place: int | None, velocity: Array) -> list[Array]:
        """Forces of all dampers of scenes, or of one on its deformation."""
        if place is None:
            return self._run.forces_of(scenes, velocity)
        moved = deformation_of(scenes[0], place, velocity)
        return self._run.forces_of([damper_alone(one, place) for one in scenes], moved)

    def _places_of(self, motion: Motion) -> tuple[Places, Array]:
        """The places of the times in the motion of every member."""
        (step, tau), firsts = self._places, motion.firsts[:-1]
        return np.concatenate([step + one for one in firsts]), np.tile(tau, len(firsts))

    def derivatives(self, tangent: Tangent | None) -> Array:
        """Derivatives by the parameters, ``(n, p)``; without a tangent the motion is given."""
        total, time = self._at_fixed_motion.copy(), self._motion.time(*self._places)
        for own, one in zip(total, self._parameters, strict=True):
            for name, slope in self._slopes.items():
                own += slope * one.of(f"names.{name}")
                given = rate_of_forcing(self._names.inputs.get(name), one, f"inputs.{name}")
                if given is not None:
                    own += slope * given(time)[:, 0]
        if tangent is not None:
            for name, change in self._moved(tangent).items():
                total += self._slopes[name] * change
        return total.T

    def _moved(self, tangent: Tangent) -> dict[str, Array]:
        """Effect of disturbances on the variables of the expression, ``(p, n)`` each."""
        run, scene, p = self._run, self._run.scene, tangent.position.shape[-1]
        # what the data of the start change directly is known at fixed motion
        at_rest = replace(
            scene, initial_velocity=np.zeros(run.d), derivative="caputo", forcing=None
        )
        x, v = (np.moveaxis(one, -1, 0) for one in tangent)
        steps = [replace(run.steps, position=x[k], velocity=v[k]) for k in range(p)]

        def forces(place: int | None) -> list[Array]:
            (found,) = self._forces([at_rest], place, tangent.velocity.swapaxes(2, 3))
            return list(np.moveaxis(found, 2, 0))

        motion = Motion([at_rest] * p, steps, forces)
        places = self._places_of(motion)

        def observed(compute: Callable[[Places, Array], Array]) -> Array:
            return compute(*places).reshape(p, self.values.size, -1)

        found = {
            name: observed(partial(damper_along, motion, one))[..., 0]
            for name, one in self._dampers.items()
        }
        computed = {"": motion.position, "v": motion.velocity, "d": motion.damping}
        needed = computed.keys() if "a" in self._kinds else computed.keys() & self._kinds
        every = {kind: observed(computed[kind]) for kind in needed}
        if "a" in self._kinds:
            every["a"] = self._accelerations(every[""], every["v"], every["d"])
        return found | {
            name: every[prefix][..., index] for name, (prefix, index) in self._derived.items()
        }

    def _accelerations(self, moved: Array, turned: Array, force: Array) -> Array:
        """Effect of disturbances of position, velocity and damping forces, ``(p, n, d)`` each."""
        motion, places, scene = self._motion, self._places, self._run.scene
        x, v, a = (of(*places) for of in (motion.position, motion.velocity, motion.acceleration))
        time = motion.time(*places)
        at = scene.derivatives(x, v, time)
        slopes = np.stack([at.stiffness, 0.0 * at.stiffness], axis=1)
        if scene.lagrangian is not None:
            slopes = scene.lagrangian.remainder_slopes(x, v, a, time)
        total = force + np.einsum("nkbd,kpnb->pnd", slopes, np.stack([moved, turned]))
        for own, one in zip(total, self._parameters, strict=True):
            own += rate_of_remainder(scene, one, x, v, a, time)
            if (forcing := rate_of_forcing(scene.forcing, one, "forcing")) is not None:
                own += forcing(time)
        return np.linalg.solve(at.mass, total[..., None])[..., 0]
