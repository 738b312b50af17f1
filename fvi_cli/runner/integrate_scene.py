"""Integrate a scene without a configuration; methods may be given by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import AnyMethod, Method, as_method
from fvi_cli.integrator.observations.dampers import damper_values
from fvi_cli.integrator.observations.observe import integrate_requested
from fvi_cli.integrator.observations.request import Event, names_of, observations
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.keys.complaints import excerpt


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
        Effects and initial data; effects that are absent are not simulated.
    method
        A method, or its name (:func:`fvi_cli.method_named`): ``gauss3``, ``bdf2-nodes``.
        With a mesh or adaptive steps the name of a Gauss method means the one with ``start: none``.
    n_steps
        N >= 1 for N equal steps; for Gauss methods also a :class:`Mesh`
        (:func:`uniform_mesh`, :func:`graded_mesh`, :func:`mesh_of`), or :class:`AdaptiveSteps`,
        which are chosen during the run.
    every
        Keep every n-th point of the grid, and the last.
    diagnostics
        What is computed in addition to the trajectory.
    with_steps
        Keep the polynomials of the steps, for ``trajectory(t)`` and ``trajectory.velocity(t)``;
        for Runge-Kutta methods.
    output
        Times at which the motion is reported; the points of the mesh by default.
    quantities
        Expressions by name, in coordinates, ``v<name>``, ``a<name>``, ``d<name>`` (the damping
        force on the coordinate) and t; their values at the reported times are
        ``trajectory.observed.quantities``, their peaks etc. ``trajectory.observed.extents``.
    events
        Such expressions, or ``{"when": ..., "direction": ..., "stop": ...}``, by name; the times
        at which they change sign are ``trajectory.observed.events``.
    impacts
        ``{"when": ..., "restitution": ...}`` by name: where the expression ``when`` in coordinates
        and t falls to 0, the velocity along its gradient is reversed and scaled.
    coordinates, parameters
        Names in these expressions: by default ``x``, or ``x1``, ``x2``, ..., or the coordinates of
        the Lagrangian; and values of further names.

    Returns
    -------
    Trajectory
        With its status; a run that fails raises no exception.

    Raises
    ------
    ValueError
        For numbers out of range and an unknown name of a method.
    """
    if not isinstance(scene, Scene):
        raise TypeError(
            f"integrate: scene: {excerpt(repr(scene))} is no scene; write one such as "
            "fvi.duffing(final_time=10.0); a configuration is computed by fvi.run"
        )
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
    remarks: tuple[str, ...] = ()
    if scene.forcing is not None:
        longest = 0.0 if isinstance(n_steps, AdaptiveSteps) else found.step_size
        if isinstance(n_steps, Mesh):
            longest = float(np.diff(n_steps.times).max())
        remarks = scene.forcing.remarks(scene.final_time, longest)
    return replace(
        found,
        steps=found.steps if with_steps else None,
        coordinates=request.coordinates,
        remarks=tuple(dict.fromkeys((*found.remarks, *remarks))),
    )


def method_on(method: AnyMethod | str, n_steps: AnySteps) -> AnyMethod:
    """A method, also by name; on a mesh the name of a Gauss method means ``start: none``."""
    chosen = as_method(method)
    is_number = isinstance(n_steps, int | np.integer)
    is_default = isinstance(method, str) and "graded" not in method.lower()
    if is_default and isinstance(chosen, Method) and chosen.start == "graded" and not is_number:
        return replace(chosen, start="none")
    return chosen
