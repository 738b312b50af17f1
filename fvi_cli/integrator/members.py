"""Many scenes by one method and on one grid: those of one kind are integrated as one batch."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.directions import scale_and_direction
from fvi_cli.integrator.counts import check_counts
from fvi_cli.integrator.decoupling import linear_decoupling
from fvi_cli.integrator.engine.blocks import longest_in_batch
from fvi_cli.integrator.engine.checkpoint import RunKeeper
from fvi_cli.integrator.engine.engine import LEAST_BLOCK_STEPS
from fvi_cli.integrator.engine.frame import sampling_of
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.run.on_mesh import integrate_scenes, mesh_for
from fvi_cli.integrator.trajectory import Trajectory

LARGEST_STEP = 24
"""Unknowns of a step of a member, at most: beyond, matrix products are quicker one by one."""
FEWEST_LINEAR = 4
"""Linear scenes that make a batch worth while."""
FEWEST_NONLINEAR, STEPS_FOR_ONE_MORE = (16, 64), 64
"""The same for nonlinear ones, on few steps and on many, which are quick alone in blocks; and with
how many steps one more is needed."""
MOST_TOGETHER = 512
"""Members that are stepped together: more would not stay in the cache."""


def integrate_members(
    scenes: Sequence[Scene],
    method: AnyMethod,
    n_steps: int,
    *,
    every: int = 1,
    checkpoints: Callable[[Scene], RunKeeper | None] = lambda scene: None,
) -> list[Trajectory]:
    """Integrate every scene, those of one kind (:func:`kind_of`) as one batch.

    Parameters
    ----------
    scenes
        What is integrated.
    method, n_steps, every
        As for :func:`fvi_cli.integrator.integrate.integrate`, the same for all.
    checkpoints
        Where a scene that is integrated individually keeps its checkpoint.

    Returns
    -------
    list of Trajectory
        One per scene, in their order: what `integrate` gives, to round-off, and the same to the
        last bit whatever others are in its batch, with a status of its own; times are the equal
        shares of those of the batch.

    Raises
    ------
    ValueError
        As `integrate` does, for the first scene that is not allowed.
    """
    check_counts(n_steps, every)
    found: dict[int, Trajectory] = {}
    for indices in _groups(scenes, method, n_steps):
        together = [scenes[index] for index in indices]
        if len(indices) > 1 and isinstance(method, Method):
            batch = integrate_batch(together, method, int(n_steps), every=every)
        else:
            batch = [
                integrate(scene, method, n_steps, every=every, checkpoints=checkpoints(scene))
                for scene in together
            ]
        found.update(zip(indices, batch, strict=True))
    return [found[index] for index in range(len(scenes))]


def integrate_batch(
    scenes: Sequence[Scene], method: Method, n_steps: int, *, every: int = 1
) -> list[Trajectory]:
    """Integrate scenes of one kind, so many at a time as stay in the cache.

    Where the equations of a member have no unique solution, all are integrated individually, in
    blocks of the same length; one whose numbers cease to be finite in a block is so step by step.
    """
    mesh, block = mesh_for(scenes[0], method, n_steps), block_in_batch(scenes[0], method)
    found: list[Trajectory] = []
    together = max(1, MOST_TOGETHER // _width(scenes[0]))
    for first in range(0, len(scenes), together):
        part = scenes[first : first + together]
        runs = integrate_scenes(part, method, mesh, every=every, most=block)
        if len(part) > 1 and any(_is_singular(one) for one in runs):
            runs = [
                integrate_scenes([one], method, mesh, every=every, most=block)[0] for one in part
            ]
        found += [
            integrate_scenes([scene], method, mesh, every=every)[0] if _overflows(one) else one
            for scene, one in zip(part, runs, strict=True)
        ]
    return found


def block_in_batch(scene: Scene, method: Method) -> int:
    """Steps of the longest block of a scene in a batch, whatever others are in it."""
    inputs = len(sampling_of(method).to_inputs) * scene.dimension // _width(scene)
    return longest_in_batch(inputs, is_linear=scene.is_linear)


def _overflows(trajectory: Trajectory) -> bool:
    """Whether a look step by step may show that it left its bound before."""
    return trajectory.failure is not None and trajectory.failure.reason == "not finite"


def _is_singular(trajectory: Trajectory) -> bool:
    return trajectory.failure is not None and trajectory.failure.reason == "no unique solution"


def companions(scenes: Sequence[Scene], method: AnyMethod, n_steps: int) -> list[int]:
    """How many of the scenes `integrate_members` takes together with each of them, itself among."""
    found = [1] * len(scenes)
    for indices in _groups(scenes, method, n_steps):
        for index in indices:
            found[index] = len(indices)
    return found


def goes_together(scene: Scene, method: AnyMethod, n_steps: int) -> bool:
    """Whether a scene may be one of a batch."""
    return isinstance(method, Method) and kind_of(scene, method, n_steps) is not None


def fewest(scene: Scene, n_steps: int) -> int:
    """So many scenes of one kind are quicker in a batch."""
    if scene.is_linear:
        return FEWEST_LINEAR
    least, most = FEWEST_NONLINEAR
    return max(least, min(most, n_steps // STEPS_FOR_ONE_MORE))


def _groups(scenes: Sequence[Scene], method: AnyMethod, n_steps: int) -> list[list[int]]:
    """Places of the scenes that are integrated together; one where a scene is so individually."""
    if not isinstance(method, Method):
        return [[place] for place in range(len(scenes))]
    found: dict[Hashable, list[int]] = {}
    for index, scene in enumerate(scenes):
        kind = kind_of(scene, method, n_steps)
        found.setdefault(("alone", index) if kind is None else kind, []).append(index)
    groups: list[list[int]] = []
    for places in found.values():
        if len(places) >= fewest(scenes[places[0]], n_steps):
            groups.append(places)
        else:
            groups += [[place] for place in places]
    return groups


def kind_of(scene: Scene, method: Method, n_steps: int) -> Hashable | None:
    """What scenes have in common that differ in numbers alone; None: it goes individually."""
    if scene.is_sparse:
        return None
    if not method.is_runge_kutta:
        is_corrected = method.start == "weights" and scene.active_damping
        if scene.active_laws or is_corrected or writes_out(method, n_steps):
            return None
    width = _width(scene)
    if method.degree * (scene.dimension // width) > LARGEST_STEP:
        return None
    powers = None
    if method.start == "graded":
        powers = tuple(start_power(scene, at_start=at_start) for at_start in (True, False))
    return (
        *(scene.dimension, width, scene.final_time, scene.break_points, scene.derivative),
        *(_formulas_of(scene.lagrangian or scene.potential), powers, _damping_of(scene)),
    )


def writes_out(method: Method, n_steps: int) -> bool:
    """Whether every sum of the memory of backward differences is written out."""
    if method.history == "auto":
        return n_steps < LEAST_BLOCK_STEPS
    return method.history == "direct"


def _formulas_of(energy: object) -> Hashable:
    """The formulas of a nonlinear scene; None for linear ones."""
    if isinstance(energy, ExpressionPotential):
        own = None if energy.stiffness is None else dense(energy.stiffness).tobytes()
        formulas = (energy.gradient_system, energy.hessian_system)
        return (energy.coordinates, tuple(sorted(energy.parameters)), formulas, own)
    if isinstance(energy, Lagrangian):
        own = None if energy.stiffness is None else dense(energy.stiffness).tobytes()
        formulas = (energy.first, energy.second)
        return (energy.coordinates, tuple(sorted(energy.parameters)), formulas, own)
    return None


def _damping_of(scene: Scene) -> Hashable:
    """What scenes have in common whose damping is of one form."""
    above = scene.derivative == "caputo" and bool(scene.initial_velocity.any())
    terms, sizes = [], []
    for force in scene.active_forces:
        size, matrix = scale_and_direction(force)
        sizes.append((size, dense(matrix).tobytes()))
        is_relative = above and isinstance(force, FractionalDamping) and force.order > 1
        term = force.order if isinstance(force, FractionalDamping) else force.kernel
        terms.append((term, is_relative))
    return tuple(terms), tuple((one / sizes[0][0], matrix) for one, matrix in sizes[1:])


def _width(scene: Scene) -> int:
    """Number of independent systems that make a scene."""
    found = linear_decoupling(scene)
    return 1 if found is None else found.batch
