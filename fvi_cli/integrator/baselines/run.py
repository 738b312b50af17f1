"""Baselines: what users would write otherwise."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import PEER_NAMES, Baseline
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.threads import in_one_thread


def baseline_objection(scene: Scene, method: Baseline) -> str:
    """Why `method` is not made for `scene`; empty where it is."""
    name = method.case
    if scene.lagrangian is not None:
        return f"{name} is not made for a Lagrangian without a constant mass matrix"
    fractional = [t.order for t in scene.active_damping if not t.is_integer_order]
    if method.name == "dop853" and fractional:
        return f"{name} knows no memory: the order of damping must be 1, not {fractional[0]:g}"
    if scene.derivative == "riemann-liouville" and scene.initial_position.any():
        return f"{name} needs derivative: caputo, or an initial position of 0"
    if method.name in PEER_NAMES:
        from fvi_cli.integrator.baselines.peers import peer_objection

        return peer_objection(scene, method)
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
    if method.tolerance is not None:
        from fvi_cli.integrator.baselines.dormand_prince import integrate_dop853

        return integrate_dop853(scene, method.tolerance, n_steps)
    if method.name in PEER_NAMES:
        from fvi_cli.integrator.baselines.peers import integrate_peer

        return integrate_peer(scene, method, n_steps)
    from fvi_cli.integrator.baselines.schemes import integrate_by_scheme

    return integrate_by_scheme(scene, method, n_steps)
