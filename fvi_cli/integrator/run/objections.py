"""Why a method is not made for a scene."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.integrator.method_names import method_name


def law_objection(scene: Scene, method: AnyMethod) -> str:
    """Why the method has no steps for the relaxation laws of a scene; empty where it has."""
    if not scene.active_laws:
        return ""
    if not isinstance(method, Baseline) and method.is_runge_kutta:
        return ""
    return (
        f"{method_name(method)} cannot integrate relaxation laws "
        "(zener, maxwell, prony, tempered); take rk: gauss"
    )
