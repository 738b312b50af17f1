"""Ladders without a closed solution are measured against one dense adaptive run."""

import math
import os

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.studies.order import order_table
from fvi_cli.studies.reference import find_reference
from fvi_cli.studies.study import execute

Array = NDArray[np.float64]
SEED = int(os.environ.get("FVI_TEST_SEED", "1"))

JUMPS = """\
name: jumps
problem:
  kind: {kind}
  damping: [{{order: {order}, coefficient: 0.4}}]
  forcing: {{pieces: {pieces}}}
  initial: {{position: 1.0}}
  final_time: {final_time}
method: {{rk: gauss, degree: 2}}
ladder: {{steps: [24, 48, 96, 192, 384]}}
"""


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", range(12))
def test_the_order_is_right_where_jumps_meet_no_steps(seed):
    random = np.random.default_rng([SEED, 41, seed])
    final_time = float(random.uniform(2.0, 5.0))
    ends = np.sort(final_time * random.uniform(0.05, 0.95, int(random.integers(1, 4))))
    values = random.uniform(-3.0, 3.0, ends.size + 1).round(3)
    pieces = [
        f"{{until: {end!r}, value: {value}}}"
        for end, value in zip(ends.tolist(), values.tolist(), strict=False)
    ]
    text = JUMPS.format(
        kind=str(random.choice(["duffing", "pendulum"])),
        order=float(random.uniform(0.2, 1.6)),
        pieces=f"[{', '.join(pieces)}, {{value: {float(values[-1])}}}]",
        final_time=final_time,
    )
    (experiment,) = parse_config(text, "jumps.yaml").experiments
    runs = list(map(execute, experiment.runs()))
    (case,) = order_table(experiment, runs).cases
    assert all(row.status in ("ok", "floor") for row in case.rows)
    # where the jumps lie in their steps moves single errors
    assert 2.5 < case.slope < 5.5
    truth = fvi.solve(experiment.problem.scene, tolerance=1e-11)
    for one in runs:
        error = float(np.abs(one.trajectory.position - truth(one.trajectory.time)).max())
        assert one.error == pytest.approx(error, rel=1e-3, abs=1e-11)


def between_two_wells(a: float, b: float, x: float, v: float, times: Array) -> Array:
    """Motion in a (|x| - b)^2: around b to the right of 0, around -b to the left of it."""
    found, begin, rate = np.empty(times.size), 0.0, math.sqrt(2.0 * a)
    side = math.copysign(1.0, x)
    while begin < times[-1]:
        offset = x - side * b

        def path(s: float | Array, offset=offset, v=v, side=side) -> Array:
            return side * b + offset * np.cos(rate * s) + v / rate * np.sin(rate * s)

        s = np.linspace(1e-6, 2.0 * math.pi / rate, 4001)
        crossed = np.flatnonzero(side * path(s) < 0)
        length = brentq(path, s[crossed[0] - 1], s[crossed[0]], xtol=1e-15) if crossed.size else 1e9
        inside = (times >= begin) & (times <= begin + length)
        found[inside] = path(times[inside] - begin)
        v = v * math.cos(rate * length) - rate * offset * math.sin(rate * length)
        begin, x, side = begin + length, 0.0, -side
    return found


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(8))
def test_kinks_of_a_potential_leave_digits_and_no_floors(seed):
    random = np.random.default_rng([SEED, 42, seed])
    a, b, x = (float(random.uniform(*ends)) for ends in ((1.0, 5.0), (0.5, 1.0), (0.3, 1.5)))
    # above the barrier between the wells
    v = float(math.sqrt(2.0 * a) * b * random.uniform(1.1, 1.8))
    text = f"""\
name: wells
problem:
  kind: lagrangian
  coordinates: [x]
  lagrangian: vx**2/2 - {a!r}*(abs(x) - {b!r})**2
  initial: {{position: {x!r}, velocity: {v!r}}}
  final_time: 3.0
method: {{rk: gauss, degree: 2}}
ladder: {{steps: [50, 100, 200, 400]}}
"""
    (experiment,) = parse_config(text, "wells.yaml").experiments
    reference = find_reference(experiment.problem)
    times = np.linspace(0.0, 3.0, 101)
    error = np.abs(reference.values(times)[:, 0] - between_two_wells(a, b, x, v, times)).max()
    assert error <= max(10.0 * reference.error, 1e-12)
    assert reference.error < 1e-5
    (case,) = order_table(experiment, list(map(execute, experiment.runs()))).cases
    assert all(row.status in ("ok", "floor") for row in case.rows)
