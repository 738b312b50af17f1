"""Endless rebounds end in rest, at the same time for every degree: any order, restitution, unit."""

import math
import re

import numpy as np
import pytest
from spread import few_of

import fvi_cli as fvi


def most_impacts(restitution: float) -> int:
    """Impacts until flights are 1e-13 of the first, and what it takes to see no shrinking."""
    return math.ceil((math.log(1e-13) + 2 * math.log(0.25)) / math.log(restitution)) + 20


def time_of_rest(run: fvi.Trajectory) -> float:
    """The time from which on a run says that it rests."""
    assert run.status == "ok", run.message
    (said,) = [re.search(r"at rest from t = (\S+)", one) for one in run.remarks]
    assert said is not None
    return float(said[1])


@few_of(1, 60)
def test_drawn_rebounds_end_in_rest(seed: int) -> None:
    random = np.random.default_rng([25, 1, seed])
    order = float(random.uniform(0.05, 1.95)) if seed % 2 else float(random.uniform(1.05, 1.95))
    restitution = float(random.uniform(0.2, 0.85))
    length, second = (float(10 ** random.uniform(-6, 6)) for _ in range(2))
    n_steps, spring = int(random.integers(20, 200)), float(random.choice([0.0, 1.0]))
    gravity, stiffness = 10 * length / second**2, spring / length**2 / second**2
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2 - {gravity!r}*x - {stiffness!r}*x**4",
        initial_position=[length],
        initial_velocity=[0.0],
        damping=[fvi.FractionalDamping(order=order, coefficient=0.4 * second ** (order - 2))],
        final_time=1.5 * math.sqrt(0.2) * (1 + restitution) / (1 - restitution) * second,
    )
    floor, rests = {"floor": {"when": "x", "restitution": restitution}}, []
    for degree in random.choice([2, 3, 4, 5, 6, 8], 2, replace=False):
        run = fvi.integrate(scene, f"gauss{degree}", n_steps, impacts=floor)
        assert run.observed.events["floor"].time.size <= most_impacts(restitution)
        # the work of a flight is bounded
        assert run.newton_iterations <= 30 * (run.time.size + n_steps)
        rests.append(time_of_rest(run) / second)
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
    assert time_of_rest(found) == pytest.approx(0.4604787, abs=1e-4)
