"""Trajectories and operation counts of all baselines."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.results.diagnostics import NewtonRecord
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array


def baseline_operations(name: str, scene: Scene, n_steps: int) -> int:
    """Multiply-adds that the sums of a baseline over its past take in `n_steps` steps."""
    terms = _DOT_PRODUCTS[name]
    orders = [terms[term.is_integer_order](n_steps) for term in scene.active_damping]
    return scene.dimension * sum(orders)


_DOT_PRODUCTS: dict[str, tuple[Callable[[int], int], Callable[[int], int]]] = {
    "explicit-euler": (lambda n: n * (n - 1) // 2, lambda n: 0),
    "implicit-euler": (lambda n: n * (n + 1) // 2, lambda n: 0),
    "gruenwald-letnikov": (lambda n: n * (n + 1) // 2, lambda n: 2 * n - 1),
    "product-integration": (lambda n: n * (n - 1) // 2, lambda n: n),
}
"""Numbers of terms of the sums in n steps: for a fractional order, and for order 1."""


def baseline_trajectory(
    scene: Scene,
    position: Array,
    velocity: Array | None,
    n_steps: int,
    *,
    failure: Failure | None,
    began: float,
    ready: float,
    operations: int = 0,
    iterations: int = 0,
) -> Trajectory:
    """The trajectory of a baseline from its finished points, shape ``(n, d)``.

    Set-up began at `began` and stepping at `ready`, by ``time.perf_counter``; `operations` are
    multiply-adds spent on the memory, `iterations` those of Newton.
    """
    finished = time.perf_counter()
    h = scene.final_time / n_steps
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
        status="ok" if failure is None else "failed",
        message=str(failure or ""),
        failure=failure,
        history_operations=operations,
        newton=NewtonRecord(iterations=iterations),
        setup_seconds=ready - began,
        stepping_seconds=finished - ready,
    )
