"""Motions and sections of runs to a tolerance: complete, and right at all times."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from oracles.volterra import VolterraSolution, solve_volterra
from spread import few_of

from fvi_cli.config import parse_config
from fvi_cli.integrator.observe import motion
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.tolerance.experiment_run import run_for_tolerance

TEXT = """\
name: section
problem:
  kind: damped-oscillator
  derivative: {derivative}
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
    order = float(random.choice([random.uniform(0.1, 0.95), 1.0, random.uniform(1.05, 1.99)]))
    derivative = str(random.choice(["caputo", "riemann-liouville"]))
    return {
        "derivative": derivative,
        "stiffness": unit**-2 * float(random.uniform(0.5, 10.0)),
        "order": order,
        "coefficient": unit ** (order - 2) * float(10 ** random.uniform(-2, 0)),
        "position": float(random.uniform(0.3, 1.0)) if derivative == "caputo" else 0.0,
        "velocity": float(random.uniform(0.3, 1.0)) / unit,
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


def experiment(data: dict[str, object]) -> Experiment:
    (found,) = parse_config(TEXT.format(**data), "section.yaml").experiments
    return found


def run(asked: Experiment) -> FinishedRun:
    (search,) = asked.runs()
    return run_for_tolerance(search)


def truth(data: dict[str, object]) -> tuple[VolterraSolution, float]:
    """The motion in the units of a quarter of the run, in which the oracle works, and that unit."""
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
        derivative=data["derivative"],
    )
    return known, unit


@few_of(3, 120)
def test_drawn_motions_and_sections(seed):
    data = draw(seed)
    path, (known, unit) = run(experiment(data)).trajectory, truth(data)
    assert path.met, data
    seen, times = path.observed.events["period"], expected_times(data)
    assert seen.time.shape == times.shape, data
    assert np.abs(seen.time - times).max() < 1e-12 * data["final_time"]
    for at, position in ((times, seen.position), (path.time, path.position)):
        error = np.abs(position - known.position(np.minimum(at / unit, 4.0))).max()
        assert error <= data["tolerance"] + known.error.max(), data


def test_the_error_is_that_of_the_times_that_are_reported(monkeypatch):
    """The motion between the points goes wrong by a cubic, and an exact solution shows it."""
    data = draw(2) | {"more": "output: {step: 0.1}", "final_time": 4.0, "tolerance": 1e-6}
    known, position = truth(data)[0].position, motion.Motion.position

    def wrong(self, steps, tau, columns=None):
        bump = 1e-3 * self.step_size[steps] * tau * (1.0 - tau) * (1.0 - 2.0 * tau)
        return position(self, steps, tau, columns) + bump[..., None]

    asked = experiment(data)
    asked = replace(asked, problem=replace(asked.problem, exact=known))
    monkeypatch.setattr(motion.Motion, "position", wrong)
    found = run(asked)
    path = found.trajectory
    assert found.error == pytest.approx(np.abs(path.position - known(path.time)).max(), rel=1e-3)
    assert found.error > 1e-6
    assert not path.met
