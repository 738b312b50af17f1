"""Scenes by themselves, without a configuration; methods also by their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fvi_cli.config import method_named
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator import integrate as engine
from fvi_cli.integrator import members, stability
from fvi_cli.integrator.diagnostics import NOTHING, Asked
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.run.runge_kutta import AnySteps
from fvi_cli.integrator.stability import StabilityPrediction
from fvi_cli.integrator.trajectory import Trajectory


def integrate(
    scene: Scene,
    method: AnyMethod | str,
    n_steps: AnySteps,
    *,
    every: int = 1,
    diagnostics: Asked = NOTHING,
    with_steps: bool = False,
) -> Trajectory:
    """Integrate a scene over [0, T].

    Parameters
    ----------
    scene
        Effects and initial data; what is absent is not simulated.
    method
        A method, or its name (:func:`fvi_cli.config.method_named`): ``gauss3``, ``bdf2-nodes``.
        With a mesh or adaptive steps the name of a Gauss method means the one without a series.
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
        for Gauss methods without a series.

    Returns
    -------
    Trajectory
        With its status; a run that diverges is no exception.

    Raises
    ------
    ValueError
        For numbers out of range and a name that says no method.
    """
    chosen = _method(method)
    is_number = isinstance(n_steps, int | np.integer)
    if isinstance(method, str) and isinstance(chosen, Method) and not is_number:
        is_carried = chosen.is_runge_kutta and chosen.start == "series"
        if is_carried and "series" not in method.lower():
            chosen = replace(chosen, start="none")
    return engine.integrate(
        scene, chosen, n_steps, every=every, diagnostics=diagnostics, with_steps=with_steps
    )


def integrate_members(
    scenes: Sequence[Scene], method: AnyMethod | str, n_steps: int, *, every: int = 1
) -> list[Trajectory]:
    """Integrate many scenes, those that fit together side by side; otherwise :func:`integrate`."""
    return members.integrate_members(scenes, _method(method), n_steps, every=every)


def predict_stability(scene: Scene, method: AnyMethod | str, n_steps: int) -> StabilityPrediction:
    """Whether a run would blow up, and why, before it is computed; methods also by name."""
    return stability.predict_stability(scene, _method(method), n_steps)


def _method(method: AnyMethod | str) -> AnyMethod:
    return method_named(method) if isinstance(method, str) else method
