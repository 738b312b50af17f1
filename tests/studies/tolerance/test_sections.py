"""Sections by a stroboscope, in runs that `accuracy` makes: complete, and right where they lie."""

from __future__ import annotations

import math

import numpy as np
from oracles.volterra import solve_volterra
from spread import few_of

from fvi_cli.config import parse_config
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.tolerance.experiment_run import run_for_tolerance

TEXT = """\
name: section
problem:
  kind: damped-oscillator
  stiffness: {stiffness!r}
  damping: [{{order: {order!r}, coefficient: {coefficient!r}}}]
  initial: {{position: {position!r}, velocity: {velocity!r}}}
  final_time: {final_time!r}
  exact: none
accuracy: {{tolerance: {tolerance!r}}}
events: {{period: {{when: "sin({rate!r}*t + {phase!r})", direction: {direction}}}}}
figures: [section]
{more}
"""


def draw(seed: int) -> dict[str, object]:
    random = np.random.default_rng([29, seed])
    unit = float(10 ** random.uniform(-3, 3))
    final_time = unit * float(random.uniform(2.0, 8.0))
    every, step = int(random.integers(2, 50)), final_time / int(random.integers(3, 40))
    order = float(random.choice([random.uniform(0.1, 0.95), 1.0, random.uniform(1.05, 1.9)]))
    return {
        "stiffness": unit**-2 * float(random.uniform(0.5, 10.0)),
        "order": order,
        "coefficient": unit ** (order - 2) * float(10 ** random.uniform(-2, 0)),
        "position": float(random.uniform(0.3, 1.0)),
        "velocity": float(random.uniform(-1.0, 1.0)) / unit,
        "final_time": final_time,
        "tolerance": float(10 ** -random.uniform(3, 8)),
        # up to 6,000 changes of sign, of which the motion knows nothing
        "rate": float(10 ** random.uniform(1.0, 3.8)) * math.pi / final_time,
        "phase": float(random.uniform(0.2, 3.0)),
        "direction": ("rising", "falling", "any")[seed % 3],
        "more": ("", f"store: {{every: {every}}}", f"output: {{step: {step}}}")[seed // 2 % 3],
    }


def expected_times(data: dict[str, object]) -> np.ndarray:
    rate, phase, final_time = data["rate"], data["phase"], data["final_time"]
    k = np.arange(1, int((rate * final_time + phase) / math.pi) + 1)
    if data["direction"] != "any":
        k = k[k % 2 == (data["direction"] == "falling")]
    return (k * math.pi - phase) / rate


def run(data: dict[str, object]) -> FinishedRun:
    (experiment,) = parse_config(TEXT.format(**data), "section.yaml").experiments
    (search,) = experiment.runs()
    return run_for_tolerance(search)


def check(data: dict[str, object]) -> None:
    found = run(data)
    assert found.trajectory.outcome == "met", data
    seen, times = found.trajectory.observed.events["period"], expected_times(data)
    assert seen.time.shape == times.shape, data
    assert np.abs(seen.time - times).max() < 1e-12 * data["final_time"]
    # in the units of one second, in which the oracle works
    unit, order = data["final_time"] / 4.0, data["order"]
    stiffness = data["stiffness"] * unit**2
    known = solve_volterra(
        1.0,
        [(order, data["coefficient"] * unit ** (2 - order))],
        lambda x: stiffness * x,
        lambda x: np.full((len(x), 1, 1), stiffness),
        None,
        [data["position"]],
        [data["velocity"] * unit],
        4.0,
    )
    error = np.abs(seen.position - known.position(np.minimum(times / unit, 4.0))).max()
    assert error <= data["tolerance"] + known.error.max(), data


@few_of(2, 120)
def test_drawn_sections(seed):
    check(draw(seed))
