"""The one function in which scene and method meet."""

from __future__ import annotations

import numpy as np

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines import integrate_baseline
from fvi_cli.integrator.failure import no_unique_solution
from fvi_cli.integrator.memory.damping import law_objection
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.run.on_mesh import AnySteps, integrate_scenes, mesh_for
from fvi_cli.integrator.run.prescribed_run import integrate_prescribed
from fvi_cli.integrator.trajectory import Trajectory, thinned


def check_counts(n_steps: object, every: object) -> None:
    """Refuse numbers of steps and of points that are no positive integers.

    Raises
    ------
    ValueError
        With the number and what is allowed.
    """
    for name, value in (("n_steps", n_steps), ("every", every)):
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1:
            others = ", a Mesh or AdaptiveSteps" if name == "n_steps" else ""
            raise ValueError(
                f"{name}: {value!r} is not allowed; it must be an integer >= 1{others}"
            )


def integrate(
    scene: Scene,
    method: AnyMethod,
    n_steps: AnySteps,
    *,
    every: int = 1,
    diagnostics: DiagnosticsRequest = NO_DIAGNOSTICS,
    with_steps: bool = False,
) -> Trajectory:
    """Integrate `scene` over [0, T] by `method` in `n_steps` steps.

    Parameters
    ----------
    scene
        Effects and initial data; absent effects are not computed.
    method
        Method or baseline.
    n_steps
        Number N >= 1 of steps, h = T / N; for Runge-Kutta methods also a mesh or `AdaptiveSteps`.
    every
        Keep every n-th point of the grid, the first and the last.
    diagnostics
        What else is computed; it does not change the trajectory.
    with_steps
        Keep the steps of a Runge-Kutta method as polynomials, for values at any time.

    Returns
    -------
    Trajectory
        With status ``ok``, or ``failed`` (equations unsolved, or numbers that are not finite);
        finished steps are kept.

    Raises
    ------
    ValueError
        If N or `every` is no positive integer, a break point lies inside a step of a method that
        takes equal steps only, or the method does not support a general Lagrangian, laws, or
        diagnostics.
    """
    is_given = isinstance(n_steps, Mesh | AdaptiveSteps)
    check_counts(1 if is_given else n_steps, every)
    steps = n_steps if isinstance(n_steps, Mesh | AdaptiveSteps) else int(n_steps)
    if scene.prescribed is not None:
        if not diagnostics.is_empty:
            raise ValueError("diagnostics: the motion is given; it has no energy and no momentum")
        return integrate_prescribed(
            scene, scene.prescribed, method, steps, every=every, with_steps=with_steps
        )
    if reason := law_objection(scene, method):
        raise ValueError(f"method: {reason}")
    if isinstance(method, Baseline) or not method.is_runge_kutta:
        if not isinstance(steps, int):
            raise ValueError(
                f"mesh: {method.label} takes equal steps only; give a number, "
                "or take rk: gauss with start: none"
            )
        if with_steps:
            raise ValueError(
                f"with_steps: {method.label} has no polynomials to keep; "
                "take rk: gauss, such as gauss3"
            )
    if isinstance(method, Method):
        (found,) = integrate_scenes(
            [scene],
            method,
            mesh_for(scene, method, steps) if isinstance(steps, int) else steps,
            every=every,
            diagnostics=diagnostics,
            with_steps=with_steps,
        )
        return found
    if not diagnostics.is_empty:
        raise ValueError(f"diagnostics: {method.label} keeps no increments of its steps")
    if not isinstance(steps, int):
        raise ValueError(f"mesh: {method.label} takes equal steps only")
    try:
        return thinned(integrate_baseline(scene, method, steps), every)
    except np.linalg.LinAlgError:
        # singular equations, as with negative stiffness
        message = str(no_unique_solution(scene.final_time / steps))
        return _start_only(scene, steps, message)


def _start_only(scene: Scene, n_steps: int, message: str) -> Trajectory:
    """A trajectory that has the start only, where no step can be made."""
    position = scene.initial_position[None]
    momentum = scene.momentum(position, scene.initial_velocity[None], np.zeros(1))
    return Trajectory(
        time=np.zeros(1),
        position=position,
        momentum=momentum,
        energy=scene.energy(position, momentum, np.zeros(1)),
        n_steps=n_steps,
        step_size=scene.final_time / n_steps,
        status="failed",
        message=message,
    )
