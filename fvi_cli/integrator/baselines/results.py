"""What all baselines give."""

from __future__ import annotations

import time

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.domain import check_domain
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.results.newton_record import NewtonRecord
from fvi_cli.integrator.trajectory import Trajectory, status_of
from fvi_cli.mathematics.arrays import Array


def forces_on_grid(scene: Scene, n_steps: int) -> Array:
    """The forcing at t_0 .. t_N, shape ``(N + 1, d)``; zeros where there is none."""
    if scene.forcing is None:
        return np.zeros((n_steps + 1, scene.dimension))
    # as products: quotients of sums would put break points beside the grid
    return scene.forcing(scene.final_time / n_steps * np.arange(n_steps + 1, dtype=float))


def baseline_operations(name: str, scene: Scene, n_steps: int) -> int | None:
    """Multiply-adds that the sums of a baseline over its past take in so many steps.

    None for the solvers of others: theirs are not ours to count.
    """
    total = 0
    for term in scene.active_damping:
        if name == "explicit-euler":
            terms = 0 if term.is_integer_order else n_steps * (n_steps - 1) // 2
        elif name == "implicit-euler":
            terms = 0 if term.is_integer_order else n_steps * (n_steps + 1) // 2
        elif name == "gruenwald-letnikov":
            terms = 2 * n_steps - 1 if term.is_integer_order else n_steps * (n_steps + 1) // 2
        elif name == "product-integration":
            terms = n_steps if term.is_integer_order else n_steps * (n_steps - 1) // 2
        else:
            # SciPy's integrator has no memory; that of peers is not ours to count
            return 0 if name == "dop853" else None
        total += terms * scene.dimension
    return total


def baseline_trajectory(
    scene: Scene,
    position: Array,
    velocity: Array | None,
    n_steps: int,
    *,
    failure: Failure | None,
    operations: int | None,
    iterations: int,
    began: float,
    ready: float,
    remarks: tuple[str, ...] = (),
) -> Trajectory:
    """What a baseline gives back.

    Parameters
    ----------
    scene, n_steps
        What was integrated, and on how many steps.
    position, velocity
        The finished points, shape ``(n, d)``; no velocity for methods that have none.
    failure
        Why it stopped early; None where it did not.
    operations, iterations
        Multiply-adds spent on the memory, and Newton iterations.
    began, ready
        When set-up and stepping began, by ``time.perf_counter``.
    remarks
        What the reader of a table should know.
    """
    finished = time.perf_counter()
    h = scene.final_time / n_steps
    times = h * np.arange(1, position.shape[0], dtype=float)
    left = check_domain(scene.potential, position, 1, times, 0)
    if left is not None:
        kept, failure = left[0] + 1, left[1]
        position, velocity = position[:kept], None if velocity is None else velocity[:kept]
    momentum = energy = None
    if velocity is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            momentum = velocity @ scene.inertia.mass
            energy = scene.energy(position, momentum)
    return Trajectory(
        time=h * np.arange(position.shape[0], dtype=float),
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=n_steps,
        step_size=h,
        status=status_of(failure),
        message=str(failure or ""),
        failure=failure,
        history_operations=operations or 0,
        newton=NewtonRecord(iterations=iterations),
        setup_seconds=ready - began,
        stepping_seconds=finished - ready,
        remarks=remarks,
    )
