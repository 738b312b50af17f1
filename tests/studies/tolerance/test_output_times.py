"""What is reported at the times of `output` keeps the tolerance, between the points as well."""

from dataclasses import replace

import numpy as np
import pytest
from oracles.volterra import VolterraSolution, solve_volterra
from spread import few_of

from fvi_cli.config import parse_config
from fvi_cli.integrator.observe import motion
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.tolerance.experiment_run import run_for_tolerance

Random = np.random.Generator
TEXT = """\
name: seen
problem:
  kind: damped-oscillator
  derivative: {derivative}
  stiffness: {stiffness!r}
  damping: [{{order: {order!r}, coefficient: {coefficient!r}}}]
  initial: {{position: {position!r}, velocity: {velocity!r}}}
  {force}
  final_time: {final_time!r}
  exact: none
accuracy: {{tolerance: {tolerance!r}}}
output: {{times: {times!r}}}
"""


def draw(random: Random, *, near_two: bool = False) -> dict[str, object]:
    """A linear oscillator of any order, from 0 or from elsewhere, some with a smooth pulse."""
    order = float(random.choice([0.0, 1.0]) + random.uniform(0.05, 0.99))
    order = float(random.uniform(1.7, 1.99)) if near_two else order
    derivative = str(random.choice(["caputo", "riemann-liouville"]))
    is_at_rest = derivative == "caputo" and random.random() < 0.3
    final_time = float(random.uniform(1.0, 4.0))
    begins_at_zero = is_at_rest or derivative == "riemann-liouville"
    times = sorted(final_time * random.uniform(0.0, 1.0, 20))
    return {
        "derivative": derivative,
        "order": order,
        "coefficient": float(10 ** random.uniform(-1.5, 0.3)),
        "stiffness": float(10 ** random.uniform(-0.5, 1.0)),
        "position": 0.0 if begins_at_zero else float(random.uniform(-1, 1)),
        "velocity": 0.0 if is_at_rest else float(random.uniform(0.3, 1.0)),
        "force": "forcing: exp(-(3*(t - 1))**2)" if is_at_rest else "",
        "final_time": final_time,
        "times": [float(t) for t in times],
        "tolerance": float(10 ** -random.uniform(4, 9)),
    }


def run(data: dict[str, object]) -> FinishedRun:
    (experiment,) = parse_config(TEXT.format(**data), "seen.yaml").experiments
    (search,) = experiment.runs()
    return run_for_tolerance(search)


def truth(data: dict[str, object]) -> VolterraSolution:
    def force(t: np.ndarray) -> np.ndarray:
        return (np.exp(-((3 * (t - 1)) ** 2)) if data["force"] else 0.0 * t)[:, None]

    k = data["stiffness"]
    return solve_volterra(
        1.0,
        [(data["order"], data["coefficient"])],
        lambda x: k * x,
        lambda x: np.full((len(x), 1, 1), k),
        force,
        [data["position"]],
        [data["velocity"]],
        data["final_time"],
        derivative=data["derivative"],
    )


def largest_error(found: FinishedRun, known: VolterraSolution) -> float:
    path = found.trajectory
    return float(np.abs(path.position - known.position(path.time)).max())


def check(data: dict[str, object]) -> None:
    found, known = run(data), truth(data)
    assert found.trajectory.outcome == "met", data
    assert found.trajectory.time == pytest.approx(data["times"], rel=1e-14)
    assert largest_error(found, known) <= data["tolerance"] + known.error.max(), data


@few_of(2, 120)
def test_drawn_scenes(seed):
    check(draw(np.random.default_rng([21, seed]), near_two=seed % 2 == 1))


HARD = {
    "derivative": "riemann-liouville",
    "order": 1.9,
    "coefficient": 0.4,
    "stiffness": 1.0,
    "position": 0.0,
    "velocity": 1.0,
    "force": "",
    "final_time": 2.0,
    "times": np.linspace(0.0, 2.0, 41).tolist(),
    "tolerance": 1e-8,
}


def spoil(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the motion between the points go wrong by a cubic."""
    position = motion.Motion.position

    def wrong(self, steps, tau, columns=None):
        bump = 1e-3 * self.step_size[steps] * tau * (1.0 - tau) * (1.0 - 2.0 * tau)
        return position(self, steps, tau, columns) + bump[..., None]

    monkeypatch.setattr(motion.Motion, "position", wrong)


def test_the_error_is_that_of_the_times_that_are_reported(monkeypatch):
    data = HARD | {"tolerance": 1e-6}
    known = truth(data)
    spoil(monkeypatch)
    (experiment,) = parse_config(TEXT.format(**data), "a").experiments
    problem = replace(experiment.problem, exact=known.position, exact_source="another method")
    (search,) = replace(experiment, problem=problem).runs()
    found = run_for_tolerance(search)
    assert found.error == pytest.approx(largest_error(found, known), rel=1e-3)
    assert found.error > 1e-6
    assert found.trajectory.outcome == "unreliable"
