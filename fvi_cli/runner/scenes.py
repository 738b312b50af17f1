"""Scenes by themselves, without a configuration; methods also by their names."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.config import method_named
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator import integrate as engine
from fvi_cli.integrator import members, stability
from fvi_cli.integrator.diagnostics import NOTHING, Asked
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability import StabilityPrediction
from fvi_cli.integrator.trajectory import Trajectory


def integrate(
    scene: Scene,
    method: AnyMethod | str,
    n_steps: int,
    *,
    every: int = 1,
    diagnostics: Asked = NOTHING,
) -> Trajectory:
    """Integrate a scene over [0, T] in `n_steps` equal steps.

    Parameters
    ----------
    scene
        Effects and initial data; what is absent is not simulated.
    method
        A method, or its name (:func:`fvi_cli.config.method_named`): ``gauss3``, ``bdf2-nodes``.
    n_steps
        N >= 1.
    every
        Keep every n-th point of the grid, and the last.
    diagnostics
        What is computed beside the trajectory.

    Returns
    -------
    Trajectory
        With its status; a run that diverges is no exception.

    Raises
    ------
    ValueError
        For numbers out of range and a name that says no method.
    """
    return engine.integrate(scene, _method(method), n_steps, every=every, diagnostics=diagnostics)


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
