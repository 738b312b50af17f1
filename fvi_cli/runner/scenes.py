"""Scenes by themselves, without a configuration; methods also by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.config import method_named
from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator import members
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.observations.dampers import damper_values
from fvi_cli.integrator.observations.observe import integrate_requested
from fvi_cli.integrator.observations.request import Event, names_of, observations
from fvi_cli.integrator.run import parts
from fvi_cli.integrator.run.checkpoint import Checkpoint
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.run.parts import Part
from fvi_cli.integrator.stability import prediction as stability
from fvi_cli.integrator.stability.prediction import StabilityPrediction
from fvi_cli.integrator.trajectory import Trajectory


def integrate(
    scene: Scene,
    method: AnyMethod | str,
    n_steps: AnySteps,
    *,
    every: int = 1,
    diagnostics: DiagnosticsRequest = NO_DIAGNOSTICS,
    with_steps: bool = False,
    output: ArrayLike | None = None,
    quantities: Mapping[str, str | float] | None = None,
    events: Mapping[str, str | Event | Mapping[str, object]] | None = None,
    impacts: Mapping[str, Mapping[str, object]] | None = None,
    coordinates: Sequence[str] | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Trajectory:
    """Integrate a scene over [0, T].

    Parameters
    ----------
    scene
        Effects and initial data; what is absent is not simulated.
    method
        A method, or its name (:func:`fvi_cli.config.method_named`): ``gauss3``, ``bdf2-nodes``.
        With a mesh or adaptive steps the name of a Gauss method means the one with ``start: none``.
    n_steps
        N >= 1 for N equal steps; for Gauss methods also a :class:`Mesh`
        (:func:`uniform_mesh`, :func:`graded_mesh`, :func:`mesh_of`), or :class:`AdaptiveSteps`,
        which are found on the way.
    every
        Keep every n-th point of the grid, and the last.
    diagnostics
        What is computed beside the trajectory.
    with_steps
        Keep the polynomials of the steps, for ``trajectory(t)`` and ``trajectory.velocity(t)``;
        for Runge-Kutta methods.
    output
        Times at which the motion is reported; the points of the mesh by default.
    quantities
        By name expressions in coordinates, ``v<name>``, ``a<name>``, ``d<name>`` (the damping
        force on it) and t: ``trajectory.observed.quantities`` at the reported times, and
        ``trajectory.observed.extents``.
    events
        By name such an expression, or ``{"when": ..., "direction": ..., "stop": ...}``, for the
        times at which it changes its sign: ``trajectory.observed.events``.
    impacts
        By name ``{"when": ..., "restitution": ...}``: where that expression in coordinates and t
        falls to 0 the velocity along its gradient is reversed and scaled.
    coordinates, parameters
        Names in these expressions: by default ``x``, or ``x1``, ``x2``, ..., or the coordinates of
        the Lagrangian; and values of further names.

    Returns
    -------
    Trajectory
        With its status; a run that diverges is no exception.

    Raises
    ------
    ValueError
        For numbers out of range and a name that says no method.
    """
    chosen = method_on(method, n_steps)
    request = observations(
        coordinates or names_of(scene),
        output=output,
        quantities=quantities,
        events=events,
        impacts=impacts,
        parameters=parameters,
        further=tuple(damper_values(scene)),
    )
    ((_, found),) = integrate_requested(
        [scene],
        chosen,
        [n_steps],
        [request],
        every=every,
        diagnostics=diagnostics,
        with_steps=with_steps,
    )
    steps = found.steps if with_steps else None
    return replace(found, steps=steps, coordinates=request.coordinates)


def integrate_part(
    scene: Scene,
    method: Method | str,
    n_steps: int,
    *,
    until: int | None = None,
    checkpoint: Checkpoint | None = None,
    every: int = 1,
) -> Part:
    """Integrate from a checkpoint to the next place to stop.

    The trajectories of successive parts, one after the other, are that of the whole run to the
    last bit.

    Parameters
    ----------
    scene, method, n_steps, every
        As for :func:`integrate`, always those of the whole run; no baseline.
    until
        Stop when so many steps are done, or up to 4096 later; the end by default.
    checkpoint
        Where to begin, the start by default. It knows the method and the number of steps, not the
        scene.

    Raises
    ------
    ValueError
        If the checkpoint belongs to another run, the method is a baseline, or a number is
        outside of its range.
    """
    chosen = _method(method)
    if not isinstance(chosen, Method):
        raise ValueError(
            f"method: {method_name(chosen)} cannot stop and resume; take a variational method"
        )
    return parts.integrate_part(
        scene, chosen, n_steps, until=until, checkpoint=checkpoint, every=every
    )


def integrate_members(
    scenes: Sequence[Scene], method: AnyMethod | str, n_steps: int, *, every: int = 1
) -> list[Trajectory]:
    """Integrate many scenes, those that fit together in batches; otherwise :func:`integrate`."""
    return members.integrate_members(scenes, _method(method), n_steps, every=every)


def predict_stability(scene: Scene, method: AnyMethod | str, n_steps: int) -> StabilityPrediction:
    """Whether a run would blow up, and why, before it is computed; methods also by name."""
    return stability.predict_stability(scene, _method(method), n_steps)


def method_on(method: AnyMethod | str, n_steps: AnySteps) -> AnyMethod:
    """A method, also by name; on a mesh the name of a Gauss method means ``start: none``."""
    chosen = _method(method)
    is_number = isinstance(n_steps, int | np.integer)
    is_default = isinstance(method, str) and "graded" not in method.lower()
    if is_default and isinstance(chosen, Method) and chosen.start == "graded" and not is_number:
        return replace(chosen, start="none")
    return chosen


def _method(method: AnyMethod | str) -> AnyMethod:
    return method_named(method) if isinstance(method, str) else method
