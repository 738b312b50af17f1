"""Derivatives of a run: of one number by many parameters, of many numbers by a few."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun, Tangent
from fvi_cli.integrator.gradients.parameters import Parameter, disturbance, objection
from fvi_cli.integrator.gradients.quantity import Formula, MotionAt, Quantity
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.request import Observations, names_of
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread


class RunFailedError(ValueError):
    """A run that stopped early, which has no derivatives."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RunGradient:
    """A number of a trajectory and its derivatives by p parameters, ``(p,)``."""

    value: float
    derivatives: Array  # nan for parameters that are left out
    left_out: Mapping[str, str]  # names of parameters without a derivative, and why
    step_solves: int  # solved steps in addition to the run
    n_steps: int


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
    formula = Formula(run, quantity.times, expression, named)
    value = float(quantity.value(formula.values))
    if not math.isfinite(value):
        raise ValueError("quantity: it is not finite at these times")
    by_value = quantity.slopes(formula.values)
    cotangent = run.adjoint(*formula.spread(by_value))
    derivatives, left_out = list[float](), dict[str, str]()
    # one after the other: a disturbance is as large as the run
    for one in parameters:
        found, wrong = math.nan, objection(scene, one) or formula.objection(one)
        if not wrong:
            found = float(cotangent.along(disturbance(run, [one]))[0])
            found += float(by_value @ formula.rates(one))
        if not (wrong or math.isfinite(found)):
            wrong = f"quantity: its derivative by {one.name} is not finite at these times"
        if wrong:
            left_out.setdefault(one.name, wrong)
        derivatives.append(found)
    return RunGradient(
        value=value,
        derivatives=np.array(derivatives),
        left_out=left_out,
        step_solves=run.step_solves,
        n_steps=run.steps.n_steps,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivities:
    """A motion at n times, and its derivatives by p parameters."""

    position: Array  # (n, d)
    velocity: Array
    by_position: Array  # derivatives of both, (n, d, p)
    by_velocity: Array
    run: LinearisedRun
    change: Disturbance  # changes of its equations by the parameters
    tangent: Tangent  # changes of the motion
    parameters: Sequence[Parameter]

    def of(self, formula: Formula) -> Array:
        """Derivatives of an expression at n times of the run, ``(n, p)``.

        Raises
        ------
        ValueError
            If it has none by one of the parameters.
        """
        for one in self.parameters:
            if wrong := formula.objection(one):
                raise ValueError(wrong)
        found = formula.changes(self.tangent, self.change)
        for column, one in enumerate(self.parameters):
            found[:, column] += formula.rates(one)
        return found


def sensitivities(
    scene: Scene, method: Method, steps: AnySteps, times: Array, parameters: Sequence[Parameter]
) -> Sensitivities:
    """Derivatives of a motion by a few parameters: one run, one sweep with a column for each."""
    run = LinearisedRun(scene, method, run_steps(scene, method, steps))
    motion = MotionAt(run.steps, run.steps.located(times))
    position, velocity = motion.motion()
    change = disturbance(run, parameters)
    tangent = run.tangent(change)
    by_position, by_velocity = (np.moveaxis(one, 0, -1) for one in motion.changes(tangent))
    return Sensitivities(
        position=position,
        velocity=velocity,
        by_position=by_position,
        by_velocity=by_velocity,
        run=run,
        change=change,
        tangent=tangent,
        parameters=parameters,
    )
