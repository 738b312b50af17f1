"""The hard cases: every claim holds with Gauss3, and every judge sees what is wrong."""

import dataclasses
import functools
import json

import mpmath
import numpy as np
import pytest
from oracles.contour import talbot_inverse
from spread import spread

from fvi_cli.integrator.integrate import integrate
from hard_cases.judge import (
    FLAGSHIP,
    METHODS,
    Setting,
    cases,
    energy_change,
    energy_defect,
    error,
    response_from_rest,
)

CASES = {case["name"]: case for case in cases()}
LONG = ("million-steps", "resonance", "tiny-and-huge-scales", "chaotic-double-pendulum")
GAUSS3 = METHODS[FLAGSHIP]


@spread(few=3, name=[name for name in CASES if name not in LONG])
def test_much_holds_with_gauss3(name):
    check_everything_holds(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_longer_cases_hold_with_gauss3(name):
    check_everything_holds(name)


def check_everything_holds(name):
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


def test_resonance_agrees_with_talbot():
    order, mu, frequency, time = 0.5, 0.05, 1.0177, 25.0

    def transform(k, s):
        return s / (s**2 + mpmath.mpf(frequency) ** 2) / (s**2 + mpmath.mpf(mu) * s**order + k)

    found = response_from_rest(order, mu, frequency)(np.array([time]))
    exact, moved = (
        talbot_inverse(functools.partial(transform, k), (time,), largest_frequency=1.02)
        for k in (1.0, 1.0 + 1e-9)
    )
    assert found == pytest.approx(exact, rel=1e-12)
    assert found != pytest.approx(moved, rel=1e-12)


def test_the_energy_balance_of_the_double_pendulum_sees_a_wrong_coefficient():
    (one,) = CASES["chaotic-double-pendulum"]["claims"][0].settings
    scene = dataclasses.replace(one.scene, final_time=5.0)
    run = integrate(scene, GAUSS3, 400)

    def defect(coefficient):
        joints = [{"order": 0.5, "coefficient": coefficient}]
        changed = {**json.loads(one.problem), "joints": joints, "final_time": 5.0}
        return energy_defect([Setting(json.dumps(changed), 400)], run, hanging=-3.0)

    assert defect(0.005) < 1e-9
    assert defect(0.005005) > 1e-6
