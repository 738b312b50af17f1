"""Derivatives of a run: of one number by many parameters, of many numbers by a few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.adjoint.linear_run import linear_run
from fvi_cli.integrator.adjoint.linearised import Disturbance, LinearisedRun, Tangent
from fvi_cli.integrator.adjoint.quantity import Observation, Quantity
from fvi_cli.integrator.adjoint.variation import Variation, disturbance
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.runge_kutta import AnySteps
from fvi_cli.integrator.run.steps_of_run import RunSteps

Array = NDArray[np.float64]


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
) -> Gradient:
    """Derivatives of one number by any number of parameters: one run, one adjoint sweep."""
    done = run_steps(scene, method, steps)
    observation = Observation(done, quantity.times)
    motion = observation.motion()
    run = LinearisedRun(scene, method, done)
    cotangent = run.adjoint(*observation.spread(*quantity.derivatives(*motion)))
    found = [cotangent.along(disturbance(run, method, [one]))[0] for one in variations]
    return Gradient(
        value=float(quantity.value(*motion)),
        derivatives=np.array(found),
        step_solves=run.step_solves,
        n_steps=done.n_steps,
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
    """

    position: Array
    velocity: Array
    by_position: Array
    by_velocity: Array
    run: LinearisedRun
    change: Disturbance
    tangent: Tangent


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
    observation = Observation(run.steps, times)
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
    )
