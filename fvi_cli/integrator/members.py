"""Many scenes by one method and on one grid: those of one kind are integrated as one batch."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.matrices import Form, dense
from fvi_cli.effects.potential import ExpressionPotential, SuppliedPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import linear_decoupling
from fvi_cli.integrator.engine.frame import longest_in_batch
from fvi_cli.integrator.integrate import check_counts, integrate
from fvi_cli.integrator.memory.damping import damping_of, pattern_of
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.meshes.graded import start_power
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import AnyMethod, Method, as_method
from fvi_cli.integrator.run.on_mesh import integrate_scenes, mesh_for
from fvi_cli.integrator.tables import step_tables
from fvi_cli.integrator.trajectory import Trajectory

LARGEST_STEP = 24
"""Most unknowns of a step of a member: larger matrix products are quicker one by one."""
FEWEST_LINEAR = 4
"""Fewest linear scenes for which a batch is worth while."""
FEWEST_NONLINEAR, STEPS_FOR_ONE_MORE = (16, 64), 64
"""Fewest nonlinear scenes, for few steps and for many, which are quick individually in blocks; and
the number of steps for which one more scene is needed."""
MOST_TOGETHER = 512
"""Most members that are stepped together: more would not stay in the cache."""


def integrate_members(
    scenes: Sequence[Scene],
    method: AnyMethod | str,
    n_steps: int | Mesh,
    *,
    every: int = 1,
    with_steps: bool = False,
) -> list[Trajectory]:
    """Integrate every scene, those of one kind (:func:`batch_kind`) as one batch.

    Arguments are those of :func:`fvi_cli.integrator.integrate.integrate`, the same for all;
    the method may be given by name. Returns one trajectory per scene, in order, with its own
    status: the result of `integrate` to round-off. Run times are equal shares of those of the
    batch.

    Raises
    ------
    ValueError
        As `integrate` does, for the first scene that is not allowed.
    """
    method = as_method(method)
    if isinstance(n_steps, int):
        check_counts(n_steps, every)
    found: dict[int, Trajectory] = {}
    for indices in groups(scenes, method, n_steps):
        together = [scenes[index] for index in indices]
        if len(indices) > 1 and isinstance(method, Method):
            batch = integrate_batch(together, method, n_steps, every=every, with_steps=with_steps)
        else:
            (scene,) = together
            batch = [integrate(scene, method, n_steps, every=every, with_steps=with_steps)]
        found.update(zip(indices, batch, strict=True))
    return [found[index] for index in range(len(scenes))]


def integrate_batch(
    scenes: Sequence[Scene],
    method: Method,
    n_steps: int | Mesh,
    *,
    every: int = 1,
    with_steps: bool = False,
) -> list[Trajectory]:
    """Integrate scenes of one kind, as many at a time as stay in the cache."""
    mesh, block = mesh_for(scenes[0], method, n_steps), _block_in_batch(scenes[0], method)
    found: list[Trajectory] = []
    together = max(1, MOST_TOGETHER // _width(scenes[0]))
    for first in range(0, len(scenes), together):
        part = scenes[first : first + together]
        found += integrate_scenes(
            part, method, mesh, every=every, with_steps=with_steps, most=block
        )
    return found


def _block_in_batch(scene: Scene, method: Method) -> int:
    """Steps of the longest block of a scene in a batch."""
    inputs = len(step_tables(method).to_inputs) * scene.dimension // _width(scene)
    return longest_in_batch(inputs, is_linear=scene.is_linear)


def _fewest(scene: Scene, n_steps: int) -> int:
    """Fewest scenes of one kind that are quicker in a batch."""
    if scene.is_linear:
        return FEWEST_LINEAR
    least, most = FEWEST_NONLINEAR
    return max(least, min(most, n_steps // STEPS_FOR_ONE_MORE))


def _count(n_steps: int | Mesh) -> int:
    return n_steps.n_steps if isinstance(n_steps, Mesh) else n_steps


def groups(scenes: Sequence[Scene], method: AnyMethod, n_steps: int | Mesh) -> list[list[int]]:
    """Places of the scenes that are integrated together; a single place for individual scenes."""
    if not isinstance(method, Method):
        return [[place] for place in range(len(scenes))]
    found: dict[Hashable, list[int]] = {}
    for index, scene in enumerate(scenes):
        kind = batch_kind(scene, method, n_steps)
        found.setdefault(("alone", index) if kind is None else kind, []).append(index)
    groups: list[list[int]] = []
    for places in found.values():
        if len(places) >= _fewest(scenes[places[0]], _count(n_steps)):
            groups.append(places)
        else:
            groups += [[place] for place in places]
    return groups


def batch_kind(scene: Scene, method: Method, n_steps: int | Mesh) -> Hashable | None:
    """A key, equal for scenes of one batch; None: the scene is integrated individually."""
    if scene.is_sparse or scene.prescribed is not None:
        return None
    memory: Hashable = any(term.order != 1 for term in scene.active_damping)
    if not method.is_runge_kutta:
        is_corrected = method.start == "weights" and scene.active_damping
        if scene.active_laws or is_corrected:
            return None
        memory = tuple(term.order for term in scene.active_damping)
    elif scene.active_laws:
        memory = _rates_of(scene, method, mesh_for(scene, method, n_steps))
    width = _width(scene)
    if method.degree * (scene.dimension // width) > LARGEST_STEP:
        return None
    powers = None
    if method.start == "graded":
        powers = tuple(start_power(scene, at_start=at_start) for at_start in (True, False))
    return (
        *(scene.dimension, width, scene.final_time, scene.break_points, scene.derivative),
        *(_formulas_of(scene.lagrangian or scene.potential), powers, memory),
        pattern_of(scene),
    )


def _rates_of(scene: Scene, method: Method, mesh: Mesh) -> Hashable:
    """Rates of the exponentials for a scene, which depend on its laws."""
    damping = damping_of(
        [scene], method, shortest_step=mesh.shortest_step, steps=mesh.equivalent_steps
    )
    memory = None if damping is None else damping.memory
    if not isinstance(memory, Exponentials):
        return None
    return memory.kernel.rates.tobytes()


def _formulas_of(energy: object) -> Hashable:
    """The formulas, or functions, of a nonlinear scene; None for linear ones."""
    if isinstance(energy, SuppliedPotential):
        return (id(energy.functions), _entries(energy.stiffness))
    if isinstance(energy, ExpressionPotential):
        formulas = (energy.gradient_system, energy.hessian_system)
        names = tuple(sorted(energy.parameters))
        return (energy.coordinates, names, formulas, _entries(energy.stiffness))
    if isinstance(energy, Lagrangian):
        formulas = (energy.first, energy.second)
        names = tuple(sorted(energy.parameters))
        return (energy.coordinates, names, formulas, _entries(energy.stiffness))
    return None


def _entries(stiffness: Form | None) -> bytes | None:
    return None if stiffness is None else dense(stiffness).tobytes()


def _width(scene: Scene) -> int:
    """Number of independent systems that make a scene."""
    found = linear_decoupling(scene) if scene.dimension > 1 else None
    return 1 if found is None else found.batch
