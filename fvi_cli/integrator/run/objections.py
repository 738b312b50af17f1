"""Why a method is not made for a scene."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Baseline


def law_objection(scene: Scene, method: AnyMethod) -> str:
    """Why the method has no steps for the relaxation laws of a scene; empty where it has."""
    if not scene.active_laws:
        return ""
    if not isinstance(method, Baseline) and method.is_runge_kutta:
        return ""
    return (
        f"{method.case} is not made for relaxation laws (zener, maxwell, prony, tempered); take "
        "rk: gauss"
    )


def check_laws(scene: Scene, method: AnyMethod) -> None:
    """Refuse a method that has no steps for the laws of a scene.

    Raises
    ------
    ValueError
        ``method: why``.
    """
    if reason := law_objection(scene, method):
        raise ValueError(f"method: {reason}")
