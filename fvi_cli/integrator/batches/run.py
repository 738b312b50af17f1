"""From scenes of one kind to their trajectories."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.kinds import decoupling_of
from fvi_cli.integrator.batches.lags import SideLags
from fvi_cli.integrator.batches.march import Loads, SideMarch
from fvi_cli.integrator.batches.memory import SideDamping
from fvi_cli.integrator.batches.plan import BLOCK, plan_side_by_side
from fvi_cli.integrator.batches.systems import Systems, filled, joined
from fvi_cli.integrator.convolution.stages import StageOperator
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.growth_bound import TOLERATED_FACTOR, energy_remarks
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import integrate_on_mesh, mesh_for
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.integrator.steps.step import sampling_of
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.runge_kutta import tableau

MOST_TOGETHER = 512
"""Systems that are stepped together: more would not stay in the cache."""


def integrate_side_by_side(
    scenes: Sequence[Scene], method: Method, n_steps: int, *, every: int = 1
) -> list[Trajectory]:
    """Integrate scenes of one kind, :func:`side_by_side`.

    Each is what it is alone, to round-off, and the same to the last bit whatever others are beside
    it. Where the equations of a member cannot be solved here, or it leaves what can be told to be
    sound without a closer look, it is integrated alone and tells itself what happened.

    Parameters
    ----------
    scenes
        What is integrated.
    method, n_steps, every
        As for :func:`fvi_cli.integrator.integrate.integrate`, the same for all.
    """
    decouplings = [decoupling_of(scene) for scene in scenes]
    most = max(1, MOST_TOGETHER // decouplings[0].batch)
    found: list[Trajectory] = []
    for first in range(0, len(scenes), most):
        part = slice(first, first + most)
        found += _together(scenes[part], decouplings[part], method, n_steps, every)
    return found


def _together(
    scenes: Sequence[Scene],
    decouplings: Sequence[Decoupling],
    method: Method,
    n_steps: int,
    every: int,
) -> list[Trajectory]:
    began = clock.perf_counter()
    width = decouplings[0].batch
    places = filled(len(scenes), width)
    systems = joined([scenes[i] for i in places], [decouplings[i] for i in places])
    mesh, tables = mesh_for(scenes[0], method, n_steps), step_tables(method)
    damping = _damping(systems, scenes[0], method, mesh)
    loads = [None if _is_free(scene) else StepLoads(scene, method, tables) for scene in scenes]
    known = _loads_of(loads, decouplings, places)
    march = SideMarch(
        systems, damping, tables, sampling_of(method, tables), mesh, known, every=every
    )
    ready = clock.perf_counter()
    times, positions, momenta = march.run()
    operations = plan_side_by_side(scenes[0], method, n_steps).operations
    share = 1.0 / len(scenes)
    stepped = clock.perf_counter()
    results = []
    for index, (scene, own) in enumerate(zip(scenes, decouplings, strict=True)):
        part = slice(index * width, (index + 1) * width)
        farthest = _farthest(own, march.largest.T[part])
        if march.failed[part].any() or not farthest <= _surely_sound(scene, loads[index]):
            results.append(integrate_on_mesh(scene, method, n_steps, every=every))
            continue
        position = own.scene_positions(positions[part])
        momentum = own.scene_forces(momenta[part])
        energy, alone = scene.energy(position, momentum), loads[index]
        force = 0.0 if alone is None else alone.largest_force
        results.append(
            Trajectory(
                time=times.copy(),
                position=position,
                momentum=momentum,
                energy=energy,
                n_steps=mesh.n_reported,
                step_size=scene.final_time / mesh.n_reported,
                history_operations=operations,
                newton=march.notes.of(index),
                setup_seconds=share * (ready - began),
                stepping_seconds=share * (stepped - ready),
                every=every,
                remarks=energy_remarks(scene, position, energy, force),
            )
        )
    return results


def _damping(systems: Systems, scene: Scene, method: Method, mesh: Mesh) -> SideDamping:
    """The damping of scenes like this one."""
    if not method.is_runge_kutta:
        return SideLags(
            systems,
            method,
            step_tables(method),
            step_size=scene.final_time / mesh.n_steps,
            n_steps=mesh.n_steps,
            block=BLOCK,
            jumps=method.sampling == "nodes" and scene.derivative == "riemann-liouville",
        )
    return SideDamping(
        systems,
        StageOperator(tableau=tableau(method.cq, method.stages)),
        shortest_step=mesh.shortest_step,
        n_steps=mesh.equivalent_steps,
        final_time=scene.final_time,
        block=BLOCK,
    )


def _is_free(scene: Scene) -> bool:
    """Whether no known force pulls, that of Riemann-Liouville derivatives among them."""
    return scene.forcing is None and scene.derivative == "caputo"


def _loads_of(
    every: Sequence[StepLoads | None], decouplings: Sequence[Decoupling], places: NDArray[np.intp]
) -> Loads:
    """Known forces of all systems, those of scenes without any zero."""

    def loads(begin: float, step_size: float, n_steps: int, is_fresh: bool) -> Array | None:
        if all(one is None or one.is_empty for one in every):
            return None
        found = [
            None if one is None else one.of_steps(begin, step_size, n_steps, is_fresh=is_fresh)
            for one in every
        ]
        shape = next(one.shape for one in found if one is not None)
        parts = [
            own.forces(np.zeros(shape) if one is None else one)
            for one, own in zip(found, decouplings, strict=True)
        ]
        joined_loads = np.concatenate([parts[place] for place in places])
        return np.ascontiguousarray(np.moveaxis(joined_loads, 0, -1))

    return loads


def _farthest(own: Decoupling, largest: Array) -> float:
    """No position of a scene was larger, by its largest coordinates, ``(width, e)``."""
    if own.modes is None:
        return float(largest.max())
    modes = np.abs(own.modes)
    found = modes * largest[:, 0] if modes.ndim == 1 else modes @ largest[:, 0]
    return float(found.max())


def _surely_sound(scene: Scene, loads: StepLoads | None) -> float:
    """A position up to which no run is taken for diverged."""
    scale = float(np.abs(scene.initial_position).max())
    scale += scene.final_time * float(np.abs(scene.initial_velocity).max())
    if loads is not None and loads.largest_force > 0:
        inverse = float(np.linalg.norm(np.linalg.inv(scene.inertia.mass), 2))
        scale += scene.final_time**2 * inverse * loads.largest_force
    return TOLERATED_FACTOR * scale if scale > 0 else np.inf
