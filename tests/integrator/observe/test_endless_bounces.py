"""Endless rebounds end, in work that is counted: any order, restitution, degree and unit."""

import math
import re

import numpy as np
import pytest
from spread import few_of, spread

import fvi_cli as fvi
from fvi_cli.integrator.engine.engine import Engine

# the order, restitution and even degree of a run that had no end, and its time of rest by degree 3
KNOWN = {"order": 1.4, "restitution": 0.8, "degree": 4}
KNOWN_REST = 2.31574


class WorkExceededError(Exception):
    """More steps were solved than a test allows."""


def most_impacts(restitution: float) -> int:
    """Impacts until flights are 1e-13 of the first, and what it takes to see no shrinking."""
    return math.ceil((math.log(1e-13) + 2 * math.log(0.25)) / math.log(restitution)) + 20


def most_solved(restitution: float, degree: int, n_steps: int) -> int:
    """Graded steps behind every impact, with those that look for the next one, in two runs."""
    return n_steps + 25 * degree * most_impacts(restitution)


def fall_to_rest(
    monkeypatch: pytest.MonkeyPatch,
    *,
    order: float,
    restitution: float,
    degree: int,
    n_steps: int = 100,
    length: float = 1.0,
    second: float = 1.0,
    spring: float = 0.0,
) -> tuple[fvi.Trajectory, int]:
    """A ball on a floor, its force of the past in units of length and time; solved steps."""
    gravity = 10 * length / second**2
    duration = 1.5 * math.sqrt(0.2) * (1 + restitution) / (1 - restitution) * second
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2 - {gravity!r}*x - {spring / length**2 / second**2!r}*x**4",
        initial_position=[length],
        initial_velocity=[0.0],
        damping=[fvi.FractionalDamping(order=order, coefficient=0.4 * second ** (order - 2))],
        final_time=duration,
    )
    solved, bound = 0, most_solved(restitution, degree, n_steps)
    solve = Engine.solve

    def counted(self: Engine, *arguments: object, **more: object) -> object:
        nonlocal solved
        solved += 1
        if solved > bound:
            raise WorkExceededError(f"{solved} steps")
        return solve(self, *arguments, **more)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(Engine, "solve", counted)
        run = fvi.integrate(
            scene,
            f"gauss{degree}",
            n_steps,
            impacts={"floor": {"when": "x", "restitution": restitution}},
        )
    return run, solved


def time_of_rest(run: fvi.Trajectory) -> float:
    """The time from which on a run says that it rests."""
    (said,) = [re.search(r"at rest from t = (\S+)", one) for one in run.remarks]
    assert said is not None
    return float(said[1])


@spread(few=1, degree=[2, 4, 5, 6])
def test_rebounds_below_the_error_of_momenta_end(
    monkeypatch: pytest.MonkeyPatch, degree: int
) -> None:
    run, solved = fall_to_rest(monkeypatch, **{**KNOWN, "degree": degree})
    assert run.status == "ok", run.message
    assert run.observed.stopped_by == "floor"
    assert solved <= most_solved(0.8, degree, 100)
    assert time_of_rest(run) == pytest.approx(KNOWN_REST, rel=1e-4)


@few_of(1, 60)
def test_drawn_rebounds_end_in_counted_work(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    random = np.random.default_rng([25, 1, seed])
    order = float(random.uniform(0.05, 1.95)) if seed % 2 else float(random.uniform(1.05, 1.95))
    drawn = {
        "order": order,
        "restitution": float(random.uniform(0.2, 0.85)),
        "length": float(10 ** random.uniform(-6, 6)),
        "second": float(10 ** random.uniform(-6, 6)),
        "n_steps": int(random.integers(20, 200)),
        "spring": float(random.choice([0.0, 1.0])),
    }
    degree, other = (int(one) for one in random.choice([2, 3, 4, 5, 6, 8], 2, replace=False))
    rests = []
    for stages in (degree, other):
        run, _ = fall_to_rest(monkeypatch, degree=stages, **drawn)
        assert run.status == "ok", run.message
        impacts = run.observed.events["floor"].time.size
        assert impacts <= most_impacts(drawn["restitution"])
        per_impact = run.newton.iterations / (run.time.size + drawn["n_steps"])
        assert per_impact <= 30
        rests.append(time_of_rest(run) / drawn["second"])
    assert rests[0] == pytest.approx(rests[1], rel=2e-3)


@pytest.mark.parametrize("seed", range(2))
def test_rebounds_lost_in_round_off_end_in_rest(seed: int) -> None:
    """No step ends on the floor any more, by the round-off of the steps."""
    length = 2.0 ** float(np.random.default_rng([31, seed]).integers(-20, 20))
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2 - {1.0388745839100777 * length!r}*x",
        initial_position=[0.17688010560000791 * length],
        initial_velocity=[-0.5501000166255532 * length],
        damping=[fvi.FractionalDamping(order=1.6256986883167162, coefficient=1.2012597866851293)],
        final_time=8.257836431340108,
    )

    floor = {"when": "x", "restitution": 0.5327635060394853}
    found = fvi.integrate(scene, "gauss5", 30, impacts={"floor": floor})
    assert found.status == "ok", found.message
    assert time_of_rest(found) == pytest.approx(0.4604787, abs=1e-4)
