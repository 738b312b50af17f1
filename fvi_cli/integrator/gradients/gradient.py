"""Derivatives of values of a run by parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.along import Along
from fvi_cli.integrator.gradients.disturbance import disturbance
from fvi_cli.integrator.gradients.linearised import LinearisedRun
from fvi_cli.integrator.gradients.parameters import Parameter
from fvi_cli.integrator.gradients.quantity import Quantity
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.observe.request import Observations, names_of
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread

AT_ONCE = 2**17
"""Most numbers in the velocities of disturbed runs that are computed together."""


class RunFailedError(ValueError):
    """A run that stopped early, which has no derivatives."""


def run_steps(scene: Scene, method: AnyMethod, steps: AnySteps) -> RunSteps:
    """All steps of a run.

    Raises
    ------
    RunFailedError
        If it stops early.
    ValueError
        For a method that keeps no steps.
    """
    trajectory = integrate(scene, method, steps, with_steps=True)
    if trajectory.status != "ok" or trajectory.steps is None:
        raise RunFailedError(f"the run {trajectory.status}: {trajectory.message}")
    return trajectory.steps


@in_one_thread
@np.errstate(all="ignore")
def gradient_of(
    scene: Scene,
    method: AnyMethod,
    steps: AnySteps,
    quantity: Quantity,
    parameters: Sequence[Parameter],
    names: Observations | None = None,
) -> tuple[float, Array]:
    """One number of a run, and its derivatives by p parameters, ``(p,)``.

    By default the names in expressions are t and the coordinates, velocities, accelerations and
    damping forces.

    Raises
    ------
    RunFailedError
        If the run stops early.
    ValueError
        For times outside of the run, names that are not known, a number that is not finite, and
        parameters by which there is no derivative.
    """
    named = names or Observations(coordinates=names_of(scene))
    expression = quantity.expression(named, scene)
    done = run_steps(scene, method, steps)
    assert isinstance(method, Method)
    run = LinearisedRun(scene, method, done)
    values = Along(run, quantity.times, expression, named).values
    value, by_value = quantity.value(values), quantity.slopes(values)
    together = max(1, AT_ONCE // run.steps.velocity.size)
    found = np.zeros(len(parameters))
    for first in range(0, len(parameters), together):
        part = parameters[first : first + together]
        along = Along(run, quantity.times, expression, named, part)
        (slopes,) = jacobians(run, [along], part)
        found[first : first + together] = by_value @ slopes
    if not (math.isfinite(value) and np.isfinite(found).all()):
        raise ValueError("quantity: it, or a derivative of it, is not finite at these times")
    return value, found


def jacobians(
    run: LinearisedRun, expressions: Sequence[Along], parameters: Sequence[Parameter]
) -> list[Array]:
    """Derivatives of expressions along a run by their p parameters, ``(n, p)`` each.

    One sweep with a column for each parameter; a motion that is given does not change.
    """
    tangent = None
    if parameters and run.scene.prescribed is None:
        tangent = run.tangent(disturbance(run, parameters))
    return [one.derivatives(tangent) for one in expressions]
