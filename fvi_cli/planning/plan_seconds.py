"""How long a run will take on this machine, roughly: two small measurements, and the plan's counts.

An estimate for choosing between minutes and hours; other processes on the machine are not known.
"""

from __future__ import annotations

import functools
import math
import time

import numpy as np

from fvi_cli.integrator.batches.run import MOST_TOGETHER
from fvi_cli.integrator.blocks.sizes import LARGEST_SLICE
from fvi_cli.integrator.equal_steps.routes import EqualPlan
from fvi_cli.planning.machinery import Machinery

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


def predicted_seconds(run: Machinery) -> float:
    """Time of set-up and steps together; of members that are integrated together, a share of it."""
    per_operation, per_call = machine_speed()
    n, plan, coupled = run.n_steps, run.plan, run.coupled
    work = 2.0 * per_operation * plan.operations
    m, degree, d = run.samples, run.method.degree, run.scene.dimension
    # weights and tables are shared
    each = 1.0 / run.members
    if run.is_side_by_side:
        steps = plan.n_steps * (4 if run.scene.is_linear else 120)
        own = each * per_call * steps * -(-run.systems // MOST_TOGETHER)
        own += per_operation * 60 * plan.n_steps * (d * m) ** 2
        return 10_000 * per_call * (0.1 * each + 0.02) + 0.3 * work + own
    if not isinstance(plan, EqualPlan):
        steps = plan.n_steps
        if run.scene.is_linear:
            own = per_call * (30 * steps / max(plan.block, 1) + 60 * min(steps, 60))
        else:
            own = per_call * (8 * steps + 300 * min(steps, 60))
        return 10_000 * per_call * 0.1 + 0.3 * work + own + per_operation * 40 * steps * (d * m)
    weights = 40.0 * per_operation * n * m * m * len(run.memories) * math.log2(n + 2)
    setup = each * weights + (0.05 + 0.95 * each) * 10_000 * per_call
    if plan.batch is not None:
        # products of matrices are quicker than transforms
        inside = 0.3 * plan.block * coupled * (m + degree + 3) * n * d
        slices = max(1, -(-run.systems // LARGEST_SLICE))
        calls = each * 40 * per_call * slices * n / plan.block
        return setup + work + per_operation * inside + calls
    if plan.newton is not None:
        return setup + work + n * (8 * per_call + per_operation * 60 * (d * m) ** 2)
    calls_per_step = 30 if run.scene.is_linear else 150
    if run.scene.lagrangian is not None:
        calls_per_step = 400
    if plan.route == "direct steps":
        work *= 0.5
    return setup + work + n * (calls_per_step * per_call + per_operation * 4 * (degree * d) ** 2)
