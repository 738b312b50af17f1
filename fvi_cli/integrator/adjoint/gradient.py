"""Derivatives of a run: of one number by many parameters, of many numbers by a few."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.adjoint.formula import Asked, Formula
from fvi_cli.integrator.adjoint.linear_run import linear_run
from fvi_cli.integrator.adjoint.linearised import Disturbance, LinearisedRun, Tangent
from fvi_cli.integrator.adjoint.observation import Observation
from fvi_cli.integrator.adjoint.quantity import Quantity
from fvi_cli.integrator.adjoint.variation import Variation, disturbance
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.asked import Observations, names_of
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.mathematics.arrays import Array


class RunFailedError(ValueError):
    """A run that did not come to its end, which has no derivatives."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Gradient:
    """A number of a trajectory and its derivatives.

    Parameters
    ----------
    value
        The number.
    derivatives
        By every parameter, shape ``(p,)``.
    step_solves
        Linear systems of a step that were solved beyond the run itself.
    n_steps
        Steps of the run.
    """

    value: float
    derivatives: Array
    step_solves: int
    n_steps: int


def run_steps(scene: Scene, method: Method, steps: AnySteps) -> RunSteps:
    """All steps of a run.

    Raises
    ------
    RunFailedError
        If it does not come to its end.
    ValueError
        For a method that keeps no steps.
    """
    trajectory = integrate(scene, method, steps, with_steps=True)
    if trajectory.status != "ok" or trajectory.steps is None:
        raise RunFailedError(f"the run {trajectory.status}: {trajectory.message}")
    return trajectory.steps


def gradient_of(
    scene: Scene,
    method: Method,
    steps: AnySteps,
    quantity: Quantity,
    variations: Sequence[Variation],
    asked: Asked | None = None,
) -> Gradient:
    """Derivatives of one number by any number of parameters: one run, one adjoint sweep.

    Parameters
    ----------
    scene, method, steps
        The run.
    quantity, variations
        The number, and the parameters.
    asked
        Names in expressions; None: t and the coordinates of the scene with what derives from them.

    Raises
    ------
    RunFailedError
        If the run does not come to its end.
    ValueError
        For times outside of the run, names that are not known, and a number without derivatives.
    """
    named = asked or (lambda index, value: Observations(coordinates=names_of(scene)))
    expression = quantity.expression(named(-1, 0.0), scene)
    run = LinearisedRun(scene, method, run_steps(scene, method, steps))
    if expression is None:
        observation = Observation(run.steps, run.steps.located(quantity.times))
        given: tuple[Array, ...] = observation.motion()
        by_position, by_velocity = quantity.derivatives(*given)
        by_force, rates = np.zeros_like(by_position), np.zeros(len(variations))
    else:
        formula = Formula(run, quantity.times, expression, named)
        observation, given = formula.observation, (formula.values,)
        (by_value,) = quantity.derivatives(*given)
        by_position, by_velocity, by_force = (by_value[:, None] * o for o in formula.slopes())
        rates = by_value @ formula.rates(variations)
    spread = observation.spread(by_position, by_velocity)
    by_stages = observation.spread_force(by_force) if by_force.any() else None
    cotangent = run.adjoint(*spread, by_stages)
    found = [cotangent.along(disturbance(run, method, [one]))[0] for one in variations]
    derivatives, value = np.array(found) + rates, float(quantity.value(*given))
    if not (math.isfinite(value) and np.isfinite(derivatives).all()):
        raise ValueError("quantity: it, or a derivative of it, is not finite at these times")
    return Gradient(
        value=value, derivatives=derivatives, step_solves=run.step_solves, n_steps=run.steps.n_steps
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivities:
    """A motion at some times, and its derivatives by p parameters.

    Parameters
    ----------
    position, velocity
        Shape ``(n, d)``.
    by_position, by_velocity
        Derivatives of both, ``(n, d, p)``.
    run, change, tangent
        The run, what the parameters do to its equations, and to the motion.
    variations
        The parameters.
    """

    position: Array
    velocity: Array
    by_position: Array
    by_velocity: Array
    run: LinearisedRun
    change: Disturbance
    tangent: Tangent
    variations: Sequence[Variation]

    @cached_property
    def by_force(self) -> Array:
        """Derivatives of the damping force at the stages, ``(N, r, d, p)``."""
        return self.run.damping_changes(self.tangent, self.change)

    def of(self, formula: Formula) -> Array:
        """Derivatives of an expression at n times of the run, ``(n, p)``."""
        by_position, by_velocity, by_force = formula.slopes()
        position, velocity = formula.observation.changes(self.tangent)
        found = formula.rates(self.variations)
        found += np.einsum("nd,ndp->np", by_position, position)
        found += np.einsum("nd,ndp->np", by_velocity, velocity)
        if by_force.any():
            force = formula.observation.force_changes(self.by_force)
            found += np.einsum("nd,ndp->np", by_force, force)
        return found


def sensitivities(
    scene: Scene,
    method: Method,
    steps: AnySteps,
    times: Array,
    variations: Sequence[Variation],
) -> Sensitivities:
    """Derivatives of a motion by a few parameters: one run, one sweep with a column for each."""
    if isinstance(steps, Mesh) and scene.is_linear:
        run = linear_run(scene, method, steps)
    else:
        run = LinearisedRun(scene, method, run_steps(scene, method, steps))
    observation = Observation(run.steps, run.steps.located(times))
    position, velocity = observation.motion()
    change = disturbance(run, method, variations)
    tangent = run.tangent(change)
    changes = observation.changes(tangent)
    return Sensitivities(
        position=position,
        velocity=velocity,
        by_position=changes[0],
        by_velocity=changes[1],
        run=run,
        change=change,
        tangent=tangent,
        variations=variations,
    )
