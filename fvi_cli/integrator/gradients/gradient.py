"""Derivatives of a run: of one number by many parameters, of many numbers by a few."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.formula import Formula, MotionAt, NameResolver
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun, Tangent
from fvi_cli.integrator.gradients.quantity import Quantity
from fvi_cli.integrator.gradients.variation import Variation, disturbance, loads_of
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.request import Observations, names_of
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread


class RunFailedError(ValueError):
    """A run that stopped early, which has no derivatives."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RunGradient:
    """A number of a trajectory and its derivatives by p parameters, ``(p,)``."""

    value: float
    derivatives: Array  # nan for parameters that are left out
    left_out: Mapping[int, str]  # indices of parameters without a derivative, and why
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
    variations: Sequence[Variation],
    resolve_names: NameResolver | None = None,
    *,
    leaves_out: bool = False,
) -> RunGradient:
    """Derivatives of one number by any number of parameters: one run, one adjoint sweep.

    By default the names in expressions are t and the coordinates, velocities, accelerations and
    damping forces. A parameter without a derivative is an error, or is left out if `leaves_out`.

    Raises
    ------
    RunFailedError
        If the run stops early.
    ValueError
        For times outside of the run, names that are not known, and a number without derivatives.
    """
    named = resolve_names or (lambda index, value: Observations(coordinates=names_of(scene)))
    expression = quantity.expression(named(-1, 0.0), scene)
    run = LinearisedRun(scene, method, run_steps(scene, method, steps))
    formula = Formula(run, quantity.times, expression, named)
    by_value = quantity.slopes(formula.values)
    cotangent = run.adjoint(*formula.spread(by_value))

    def rate(index: int, one: Variation) -> float:
        through_motion = float(cotangent.along(disturbance(run, [one]))[0])
        if not math.isfinite(found := through_motion + by_value @ formula.rate(index, one)):
            raise ValueError(f"quantity: its derivative by {one.name} is not finite at these times")
        return float(found)

    value = float(quantity.value(formula.values))
    if not math.isfinite(value):
        raise ValueError("quantity: it is not finite at these times")
    derivatives, left_out = np.full(len(variations), math.nan), {}
    # one after the other: a disturbance is as large as the run
    for index, one in enumerate(variations):
        try:
            derivatives[index] = rate(index, one)
        except ValueError as error:
            if not leaves_out:
                raise
            left_out[index] = str(error)
    return RunGradient(
        value=value,
        derivatives=derivatives,
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
    variations: Sequence[Variation]

    def of(self, formula: Formula) -> Array:
        """Derivatives of an expression at n times of the run, ``(n, p)``."""
        return formula.rates(self.variations) + formula.changes(self.tangent, self.change)


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
    motion = MotionAt(run.steps, run.steps.located(times))
    position, velocity = motion.motion()
    change = disturbance(run, variations)
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
        variations=variations,
    )


def linear_run(scene: Scene, method: Method, mesh: Mesh) -> LinearisedRun:
    """A run of a linear scene on a mesh, ready for tangents and adjoints.

    The motion is the response of the state of rest to initial data and loads, as disturbances, so
    that the run and its derivatives share the tables of steps. Momenta at the points are not
    computed.

    Raises
    ------
    ValueError
        If the equations of a step have no unique solution, or a step has too many unknowns.
    """
    tables, d = step_tables(method), scene.dimension
    sizes = mesh.sizes
    zero = np.zeros((sizes.size + 1, d))
    stages = np.zeros((sizes.size, tables.points.size, d))
    rest = RunSteps(
        tables=tables,
        time=mesh.times,
        position=zero,
        momentum=np.full_like(zero, np.nan),
        step_size=sizes,
        velocity=stages,
    )
    run = LinearisedRun(scene, method, rest)
    loads = loads_of(run, scene, "of_forcing") + loads_of(run, scene, "of_initial_data")
    loads -= run.loads_by(stages, run.changes_by_start(scene.initial_velocity))
    motion = run.tangent(
        Disturbance(
            loads=loads[None],
            position=scene.initial_position[None],
            momentum=(scene.inertia.mass @ scene.initial_velocity)[None],
            damping=stages[None],
        )
    )
    run.steps = replace(rest, position=motion.position[0], velocity=motion.velocity[0])
    return run
