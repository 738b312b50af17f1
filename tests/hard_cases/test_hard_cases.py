"""The hard cases: every claim holds with Gauss3, and every judge sees what is wrong."""

import dataclasses
import json

import pytest
from spread import spread

from fvi_cli.integrator.integrate import integrate
from hard_cases.judge import (
    FLAGSHIP,
    METHODS,
    Setting,
    cases,
    energy_change,
    error,
)

CASES = {case["name"]: case for case in cases()}
GAUSS3 = METHODS[FLAGSHIP]


@spread(few=3, name=list(CASES))
def test_everything_holds_with_gauss3(name):
    for claim in CASES[name]["claims"]:
        measured, status, is_unstable = claim.measure(GAUSS3)
        assert (status, is_unstable) == ("ok", False), claim.quantity
        assert claim.holds(measured), (claim.quantity, measured)


@pytest.mark.few(1)
@pytest.mark.parametrize("method", ["BDF3", "BDF6 (nodes)", "Gauss1"])
@pytest.mark.parametrize("name", ["order-1-9-coefficient-100", "jumps-at-every-period"])
def test_other_methods_fail(name, method):
    found = [(claim, claim.measure(METHODS[method])[0]) for claim in CASES[name]["claims"]]
    assert not any(claim.holds(measured) for claim, measured in found)


def cosine(n_steps=1000, order=1.0, coefficient=0.0, stiffness=1.0):
    problem = {
        "kind": "damped-oscillator",
        "stiffness": stiffness,
        "damping": [{"order": order, "coefficient": coefficient}],
        "initial": {"position": 1.0},
        "final_time": 50.0,
    }
    return Setting(json.dumps(problem), n_steps, '"cos(t)"')


def test_a_slow_clock_and_a_little_damping_are_seen():
    energy, position = CASES["million-steps"]["claims"]
    for claim, judge, wrong in (
        (position, error, cosine(stiffness=1 - 1e-6)),
        (energy, energy_change, cosine(coefficient=1e-8)),
    ):
        for one, holds in ((cosine(), True), (wrong, False)):
            run = integrate(one.scene, GAUSS3, one.n_steps)
            assert claim.holds(judge([one], run)) == holds


def test_a_stable_scene_with_an_unstable_method_is_called_unstable():
    claim = CASES["negative-damping"]["claims"][1]
    blown = dataclasses.replace(claim, settings=(cosine(400, 1.5, 5.0),))
    assert blown.measure(METHODS["BDF6 (nodes)"]) == (1.0, "ok", True)


def test_a_run_that_ends_early_holds_nothing():
    claim = CASES["huge-damping"]["claims"][0]
    measured, status, is_unstable = claim.measure(METHODS["BDF6 (nodes)"])
    assert status != "ok"
    assert is_unstable
    assert not claim.holds(measured)
