"""Baselines: what users would write otherwise."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Baseline
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.threads import in_one_thread


def baseline_objection(scene: Scene, method: Baseline) -> str:
    """Why `method` is not made for `scene`; empty where it is."""
    name = method.case
    if scene.lagrangian is not None:
        return f"{name} is not made for a Lagrangian without a constant mass matrix"
    if scene.derivative == "riemann-liouville" and scene.initial_position.any():
        return f"{name} needs derivative: caputo, or an initial position of 0"
    return ""


@in_one_thread
def integrate_baseline(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    """The trajectory of a baseline on t_k = k T / N.

    Raises
    ------
    ValueError
        For scenes that the method is not made for.
    """
    objection = baseline_objection(scene, method)
    if objection:
        raise ValueError(f"baseline: {objection}")
    from fvi_cli.integrator.baselines.schemes import integrate_by_scheme

    return integrate_by_scheme(scene, method, n_steps)
