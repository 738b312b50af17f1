"""Events of stiff motions that are much worse than the points of the mesh get a remark."""

import os
import random

import numpy as np
import pytest
from spread import SEED

import fvi_cli as fvi

SAID = "between the points of the mesh the motion is off by"


def finished(stiffness: float, coefficient: float, order: float, steps: int, folder: str):
    source = {
        "name": "events",
        "problem": {
            "kind": "damped-oscillator",
            "stiffness": stiffness,
            "damping": [{"order": order, "coefficient": coefficient}],
            "initial": {"position": 1.0, "velocity": 0.1},
            "final_time": 10.0,
        },
        "method": {"rk": "gauss", "degree": 3},
        "ladder": {"steps": [steps]},
        "events": {"zero": {"when": "x"}},
    }
    (outcome,) = fvi.run(source, output=folder)
    (one,) = outcome.finished
    return one


@pytest.mark.few(2)
@pytest.mark.parametrize("place", range(4))
def test_events_alone_are_held_against_a_closed_form(place, tmp_path):
    chance = random.Random(f"{os.environ[SEED]} events {place}")
    # motions of much damping do not pass 0
    while True:
        stiffness = 10 ** chance.uniform(4.5, 6.5)
        coefficient = stiffness * 10 ** chance.uniform(-2.8, -1.8)
        one = finished(stiffness, coefficient, chance.uniform(0.93, 0.99), 10, str(tmp_path))
        found = one.trajectory.observed.events["zero"]
        if found.time.size:
            break
    # where an event is told, x is 0 but for the error of the motion
    exact = one.run.problem.exact(found.time)
    gap = float(np.abs(exact - found.position).max())
    limit = max(10 * one.measured.max, 1e-4 * one.measured.largest)
    assert any(SAID in remark for remark in one.trajectory.remarks) == (gap > limit)


def test_a_stiff_motion_has_the_remark_and_a_smooth_one_has_not(tmp_path):
    """The control."""
    stiff = finished(274200.0, 766.9, 0.9626, 10, str(tmp_path / "stiff"))
    assert any(SAID in remark for remark in stiff.trajectory.remarks)
    smooth = finished(2.0, 0.3, 0.5, 100, str(tmp_path / "smooth"))
    assert smooth.trajectory.observed.events["zero"].time.size
    assert not any(SAID in remark for remark in smooth.trajectory.remarks)
