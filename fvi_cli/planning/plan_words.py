"""What a plan says in words about systems, history, start and forcing."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Method
from fvi_cli.planning.machinery import Machinery


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


def steps_in_words(run: Machinery) -> str:
    """How the steps are done, and of what."""
    plan, is_linear = run.plan, run.scene.is_linear
    blocks = f"blocks of {plan.block} steps as one matrix product"
    if not is_linear:
        blocks = (
            f"Newton's iteration on blocks of up to {plan.block} steps with a frozen linear "
            "response, single steps with the exact Jacobian where that does not contract"
        )
    if run.is_side_by_side:
        together = f"{plan.n_steps} steps of {run.members} members together"
        if not is_linear:
            together += ", Newton's iteration for all at once with a linear response of each"
        return f"{together}, {_systems(run)}"
    single = f"Newton's iteration with the exact Jacobian, {plan.single} single steps"
    if is_linear:
        single = f"{plan.single} single steps with one factorisation for each size"
    words = [blocks] if plan.n_steps > plan.single else []
    words += [single] if plan.single else []
    # where every sum is written out nobody looks for systems
    words += [] if is_linear and plan.n_lags == plan.single > 0 else [_systems(run)]
    return ", ".join(words)


def _systems(run: Machinery) -> str:
    """How many systems a scene is, and what they are."""
    plan = run.plan
    if plan.systems == 1:
        return "one system" if run.coupled == 1 else f"{run.coupled} coupled components"
    kind = "modes" if plan.has_modes else "components"
    return f"{plan.systems} uncoupled {kind} side by side"


def history_in_words(run: Machinery) -> str:
    """How the memory is summed up."""
    plan = run.plan
    if not run.n_directions:
        return "none: nothing is damped"
    if not plan.n_states:
        return "none: derivatives of order 1 need no past"
    if not plan.n_lags:
        return f"{plan.n_states} exponentials in place of the past"
    if plan.n_lags == plan.n_steps:
        return "every sum written out"
    near = f"the last {plan.n_lags} steps summed directly"
    return f"{near}, {run.n_sums} exponentials in place of the others" if run.n_sums else near


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
