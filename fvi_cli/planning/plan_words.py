"""What a plan says in words about systems, history, start and forcing."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Method
from fvi_cli.planning.history_work import Shape


def effects_of_scene(scene: Scene) -> tuple[str, ...]:
    """Names of what is simulated."""
    inertia = "inertia" if scene.lagrangian is None else "general Lagrangian"
    effects = [f"{inertia} ({scene.dimension} dof)"]
    if scene.potential is not None:
        effects.append("linear potential" if scene.is_linear else "nonlinear potential")
    effects += [f"damping of order {term.order:g}" for term in scene.active_damping]
    effects += [law.kernel.label for law in scene.active_laws]
    if scene.forcing is not None:
        effects.append("sampled forcing" if scene.forcing.samples else "forcing")
    return tuple(effects)


def systems_in_words(shape: Shape, *, has_modes: bool) -> str:
    """How many systems there are, and what they are."""
    if shape.batch == 1:
        return "one system" if shape.coupled == 1 else f"{shape.coupled} coupled components"
    kind = "modes" if has_modes else "components"
    return f"{shape.batch} uncoupled {kind} side by side"


def history_in_words(shape: Shape, group: int) -> str:
    """How the memory is summed up; it is direct inside of `group` steps."""
    if not shape.memories:
        return "none: nothing is damped"
    count = len(shape.memories)
    sequences = f"{count} combined sequences of weights" if count > 1 else "one sequence of weights"
    if shape.memory == 1:
        return "none: derivatives of order 1 need no past"
    if shape.memory <= group + 1 and shape.memory < 8:
        return f"finite stencil of {shape.memory} weights, {sequences}"
    return f"{sequences}, direct inside of {group} steps, FFT beyond"


def start_in_words(scene: Scene, method: Method, n_steps: int) -> str:
    """What becomes of a singular start; `n_steps` are those of the mesh, reported or not."""
    if method.start == "graded":
        return f"steps behind singular points are halved again and again, {n_steps} steps in all"
    if method.start == "weights" and scene.active_damping:
        return "starting weights"
    return "nothing is done about the start"


def forcing_in_words(scene: Scene, method: Method) -> str:
    """How the forcing enters."""
    if scene.forcing is None:
        return "none"
    words = {
        "galerkin": "at the points of the rule",
        "exact": "moments to round-off",
        "projected": "exact moments of the projection",
    }
    return words[method.forcing_quadrature]
