"""How long a run will take on this machine, roughly: two small measurements, and the plan's counts.

An estimate for choosing between minutes and hours; other processes on the machine are not known.
"""

from __future__ import annotations

import functools
import math
import time

import numpy as np

from fvi_cli.integrator.members import MOST_TOGETHER
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
    plan = run.plan
    work = 2.0 * per_operation * plan.operations
    m, d = run.samples, run.scene.dimension
    # tables are shared
    each = 1.0 / run.members
    if run.is_side_by_side:
        steps = plan.n_steps * (4 if run.scene.is_linear else 120)
        own = each * per_call * steps * -(-run.systems // MOST_TOGETHER)
        own += per_operation * 60 * plan.n_steps * (d * m) ** 2
        return 10_000 * per_call * (0.1 * each + 0.02) + 0.3 * work + own
    single, is_general = plan.single, run.scene.lagrangian is not None
    steps = plan.n_steps - single
    blocks = steps / max(plan.block, 1)
    if run.scene.is_linear:
        calls = 30 * blocks + 60 * single
    else:
        calls = (35 if is_general else 4) * steps + (400 if is_general else 220) * single
    own = per_call * calls + per_operation * run.block_numbers * (0.8 * blocks + 6)
    return 3_000 * per_call + 0.3 * work + own + per_operation * 40 * plan.n_steps * (d * m)
