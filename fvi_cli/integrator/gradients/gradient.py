"""Derivatives of a run: of one number by many parameters, of many numbers by a few."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.along import Along
from fvi_cli.integrator.gradients.linearised import LinearisedRun
from fvi_cli.integrator.gradients.parameters import Parameter, disturbance, objection
from fvi_cli.integrator.gradients.quantity import Quantity
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.request import Observations, names_of
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread


class RunFailedError(ValueError):
    """A run that stopped early, which has no derivatives."""


class RunGradient(NamedTuple):
    """A number of a trajectory and its derivatives by p parameters, ``(p,)``."""

    value: float
    derivatives: Array  # nan for parameters that are left out
    left_out: Mapping[str, str]  # names of parameters without a derivative, and why


def run_steps(scene: Scene, method: Method, steps: AnySteps) -> RunSteps:
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
def gradient_of(
    scene: Scene,
    method: Method,
    steps: AnySteps,
    quantity: Quantity,
    parameters: Iterable[Parameter],
    names: Observations | None = None,
) -> RunGradient:
    """Derivatives of one number by any number of parameters: one run, one adjoint sweep.

    By default the names in expressions are t and the coordinates, velocities, accelerations and
    damping forces.

    Raises
    ------
    RunFailedError
        If the run stops early.
    ValueError
        For times outside of the run, names that are not known, and a number that is not finite.
    """
    named = names or Observations(coordinates=names_of(scene))
    expression = quantity.expression(named, scene)
    run = LinearisedRun(scene, method, run_steps(scene, method, steps))
    along = Along(run, quantity.times, expression, named)
    value = float(quantity.value(along.values))
    if not math.isfinite(value):
        raise ValueError("quantity: it is not finite at these times")
    by_value = quantity.slopes(along.values)
    cotangent = run.adjoint(*along.spread(by_value))
    derivatives, left_out = list[float](), dict[str, str]()
    # one after the other: a disturbance is as large as the run
    for one in parameters:
        found, wrong = math.nan, objection(scene, one, of_forces=along.has_forces)
        if not wrong:
            found = float(cotangent.along(disturbance(run, [one]))[0])
            found += float(along.rates([one])[0] @ by_value)
        if not (wrong or math.isfinite(found)):
            wrong = f"quantity: its derivative by {one.name} is not finite at these times"
        if wrong:
            left_out.setdefault(one.name, wrong)
        derivatives.append(found)
    return RunGradient(value, np.array(derivatives), left_out)


def jacobians(
    run: LinearisedRun, expressions: Sequence[Along], parameters: Sequence[Parameter]
) -> list[Array]:
    """Derivatives of expressions along a run by a few parameters, ``(n, p)`` each.

    One sweep with a column for each parameter; a motion that is given does not change.

    Raises
    ------
    ValueError
        If one has none by one of the parameters.
    """
    of_forces = any(one.has_forces for one in expressions)
    for each in parameters:
        if wrong := objection(run.scene, each, of_forces=of_forces):
            raise ValueError(wrong)
    found = [np.zeros((one.values.size, len(parameters))) for one in expressions]
    if not parameters:
        return found
    if run.scene.prescribed is None:
        tangent = run.tangent(disturbance(run, parameters))
        found = [one.changes(tangent) for one in expressions]
    return [own + one.rates(parameters).T for own, one in zip(found, expressions, strict=True)]
