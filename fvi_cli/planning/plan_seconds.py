"""How long a run will take on this machine, roughly: two small measurements, and the plan's counts.

An estimate for choosing between minutes and hours; other processes on the machine are not known.
"""

from __future__ import annotations

import functools
import math
import time

import numpy as np

from fvi_cli.integrator.batches.run import MOST_TOGETHER
from fvi_cli.integrator.blocks.sizes import batch_sizes
from fvi_cli.planning.batches import Machinery
from fvi_cli.planning.history_work import direct_operations

CALIBRATION_LENGTH = 2**15


@functools.cache
def machine_speed() -> tuple[float, float]:
    """Seconds of a multiply-add inside of NumPy, and of a call of a small NumPy function."""
    values = np.linspace(0.0, 1.0, CALIBRATION_LENGTH)
    small, vector = np.eye(4), np.ones(4)

    def transform() -> None:
        np.fft.rfft(values)

    def calls() -> None:
        for _ in range(100):
            small @ vector

    multiply_adds = 1.25 * CALIBRATION_LENGTH * math.log2(CALIBRATION_LENGTH)
    shortest = []
    for work in (transform, calls):
        durations = []
        for _ in range(5):
            began = time.perf_counter()
            work()
            durations.append(time.perf_counter() - began)
        shortest.append(min(durations))
    return shortest[0] / multiply_adds, shortest[1] / 100


def predicted_seconds(sizes: Machinery) -> float:
    """Time of set-up and steps together; of members that are integrated together, a share of it."""
    per_operation, per_call = machine_speed()
    n, shape = sizes.n_steps, sizes.shape
    work = 2.0 * per_operation * sizes.operations
    m, degree, d = shape.samples, sizes.method.degree, sizes.scene.dimension
    # weights and tables are shared
    each = 1.0 / sizes.members
    weights = 40.0 * per_operation * n * m * m * len(shape.memories) * math.log2(n + 2)
    setup = each * weights + (0.05 + 0.95 * each) * 10_000 * per_call
    systems = max(1, -(-shape.batch // 128))
    if sizes.route == "linear blocks":
        chosen = batch_sizes(m, shape.coupled, shape.batch, n)
        block = 1 if chosen is None else chosen[1].block
        # products of matrices are quicker than transforms
        inside = 0.3 * block * shape.coupled * (m + degree + 3) * n * d
        return setup + work + per_operation * inside + each * 40 * per_call * systems * n / block
    if sizes.route == "any mesh":
        steps = sizes.n_mesh_steps
        if sizes.scene.is_linear:
            own = per_call * (30 * steps / max(sizes.block, 1) + 60 * min(steps, 60))
        else:
            own = per_call * (8 * steps + 300 * min(steps, 60))
        return 10_000 * per_call * 0.1 + 0.3 * work + own + per_operation * 40 * steps * (d * m)
    if sizes.route == "side by side":
        steps = sizes.n_mesh_steps * (4 if sizes.scene.is_linear else 120)
        own = each * per_call * steps * -(-shape.batch // MOST_TOGETHER)
        own += per_operation * 60 * sizes.n_mesh_steps * (d * m) ** 2
        return 10_000 * per_call * (0.1 * each + 0.02) + 0.3 * work + own
    if sizes.route == "newton blocks":
        return setup + work + n * (8 * per_call + per_operation * 60 * (d * m) ** 2)
    calls = 30 if sizes.scene.is_linear else 150
    if sizes.scene.lagrangian is not None:
        calls = 400
    if sizes.route == "direct steps":
        work = per_operation * direct_operations(shape, n)
    return setup + work + n * (calls * per_call + per_operation * 4 * (degree * d) ** 2)
