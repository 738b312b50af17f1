"""Which scenes are taken side by side."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.memory import rates_of
from fvi_cli.integrator.batches.potentials import formulas_of
from fvi_cli.integrator.convolution.damping import directions_of
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import mesh_for
from fvi_cli.integrator.run.regular import has_rough_momenta
from fvi_cli.integrator.run.setup import writes_out

LARGEST_STEP = 24
"""Unknowns of a step of a system, at most: beyond, matrix products are quicker one by one."""
FEWEST_LINEAR = 4
"""Linear scenes that make it worth while."""
FEWEST_NONLINEAR, STEPS_FOR_ONE_MORE = (16, 64), 64
"""The same for nonlinear ones, on few steps and on many, which are quick alone in blocks; and with
how many steps one more is needed."""


def side_by_side(scene: Scene, method: Method, n_steps: int) -> Hashable | None:
    """What scenes have in common that are taken side by side; None: this one stands alone."""
    if scene.lagrangian is not None or scene.is_sparse or has_rough_momenta(scene, method):
        return None
    shared: Hashable = None
    if not method.is_runge_kutta:
        is_corrected = method.start == "weights" and scene.active_damping
        if scene.active_laws or is_corrected or writes_out(method, n_steps):
            return None
        if _drops_the_jump(scene, method):
            return None
        shared = (frozenset(term.order for term in scene.active_damping), scene.derivative)
    width, formulas = 1, None
    if isinstance(scene.potential, ExpressionPotential):
        formulas = formulas_of(scene.potential)
    else:
        width = decoupling_of(scene).batch
    if method.degree * (scene.dimension // width) > LARGEST_STEP:
        return None
    powers = None
    if method.start == "graded":
        powers = tuple(start_power(scene, at_start=at_start) for at_start in (True, False))
    slots = int(bool(scene.active_forces))
    if slots and scene.dimension > width:
        slots = len(directions_of(scene))
    has_memory = bool(scene.active_laws) or any(term.order != 1 for term in scene.active_damping)
    rates = None
    if scene.active_laws:
        rates = rates_of(scene, mesh_for(scene, method, n_steps), method.stages)
    return (
        *(scene.dimension, width, scene.final_time, scene.break_points),
        *(formulas, powers, slots, has_memory, rates, shared),
    )


def _drops_the_jump(scene: Scene, method: Method) -> bool:
    """Whether terms of order 1 leave out the jump to the initial position that others see."""
    jumps = scene.derivative == "riemann-liouville" and method.sampling == "nodes"
    return (
        jumps
        and bool(scene.initial_position.any())
        and any(term.order == 1 for term in scene.active_damping)
    )


def decoupling_of(scene: Scene) -> Decoupling:
    """Coordinates in which a member falls apart; those of the scene for nonlinear ones."""
    found = linear_decoupling(scene) if scene.dimension > 1 else None
    return Decoupling(mass=scene.inertia.mass, modes=None) if found is None else found


def kinds_of(scenes: Sequence[Scene], method: Method, n_steps: int) -> list[list[int]]:
    """Places of the scenes that are taken side by side; one place where a scene stands alone."""
    found: dict[Hashable, list[int]] = {}
    for index, scene in enumerate(scenes):
        kind = side_by_side(scene, method, n_steps)
        found.setdefault(("alone", index) if kind is None else kind, []).append(index)
    kinds: list[list[int]] = []
    for places in found.values():
        if len(places) >= fewest(scenes[places[0]], n_steps):
            kinds.append(places)
        else:
            kinds += [[place] for place in places]
    return kinds


def fewest(scene: Scene, n_steps: int) -> int:
    """So many scenes of one kind are quicker side by side."""
    if scene.is_linear:
        return FEWEST_LINEAR
    least, most = FEWEST_NONLINEAR
    return max(least, min(most, n_steps // STEPS_FOR_ONE_MORE))
