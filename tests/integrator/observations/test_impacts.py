"""Impacts with memory, against the free motion plus pushes through the impulse response."""

import re
from functools import lru_cache

import numpy as np
import pytest
from letters import spring
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import rgamma

import fvi_cli as fvi

Array = NDArray[np.float64]

ORDER, COEFFICIENT, GRAVITY, RESTITUTION = 0.5, 0.2, 10.0, 0.9
HEIGHT, AMPLITUDE, FREQUENCY, COUNT = 1.0, 0.05, 3.0, 20


@lru_cache
def _series(beta: float) -> tuple[Array, Array]:
    k = np.arange(60)
    powers = (2 - ORDER) * k + beta
    return powers, (-COEFFICIENT) ** k * rgamma(powers)


class Oracle:
    """x'' + mu D^gamma x = -g + sum J_k delta(t - t_k) by Mittag-Leffler functions."""

    def __init__(self) -> None:
        self.pushes: list[tuple[float, float]] = []

    @staticmethod
    def _power(t: Array | float, beta: float) -> Array:
        """t**(beta - 1) E_{2 - gamma, beta}(-mu t**(2 - gamma))."""
        powers, factors = _series(beta)
        return np.asarray(np.asarray(t)[..., None] ** (powers - 1) @ factors)

    def position(self, t: float, lift: float = 0.0) -> float:
        """Of the ball; with a lift of 1 its velocity."""
        found = -GRAVITY * self._power(t, 3.0 - lift) + (HEIGHT if lift == 0 else 0.0)
        past = [one for one in self.pushes if one[0] < t]
        if past:
            at, push = np.array(past).T
            found = found + push @ self._power(t - at, 2.0 - lift)
        return float(found)

    def gap(self, t: float) -> float:
        return self.position(t) - AMPLITUDE * np.sin(FREQUENCY * t)

    def bounce(self) -> float:
        """Go on to the next impact."""
        t = self.pushes[-1][0] + 1e-6 if self.pushes else 1e-6
        while self.gap(t + 0.01) > 0:
            t += 0.01
        at = brentq(self.gap, t, t + 0.01, xtol=1e-15, rtol=1e-15)
        table = AMPLITUDE * FREQUENCY * np.cos(FREQUENCY * at)
        speed = self.position(at, lift=1.0) - table
        self.pushes.append((at, -(1 + RESTITUTION) * speed))
        return float(at)


def _ball(final_time: float) -> fvi.Scene:
    return spring((ORDER, COEFFICIENT), T=final_time, m=1.0, k=0.0, x=HEIGHT, forcing=f"-{GRAVITY}")


def test_twenty_impacts_on_a_moving_table():
    oracle = Oracle()
    times = np.array([oracle.bounce() for _ in range(COUNT)])
    final_time = times[-1] + 0.01
    table = {"when": f"x - {AMPLITUDE}*sin({FREQUENCY}*t)", "restitution": RESTITUTION}
    run = fvi.integrate(
        _ball(final_time),
        "gauss6",
        80,
        output=np.linspace(0.0, final_time, 41),
        impacts={"table": table},
        quantities={"a": "ax", "d": "dx"},
    )
    found = run.observed.events["table"]
    assert found.time.size == COUNT
    assert np.abs(found.time - times).max() < 1e-9
    exact = np.array([oracle.position(t) for t in run.time])
    assert np.abs(run.position[:, 0] - exact).max() < 1e-8
    # between impacts the equation of motion holds, with the memory of all before
    seen = run.observed.quantities
    assert np.abs(seen["a"] + GRAVITY - seen["d"]).max() < 1e-12
    shifted = [oracle.position(t, lift=1.0) for t in times * (1 - 1e-12)]
    assert np.abs(found.velocity[:, 0] - shifted).max() < 1e-7


def test_the_memory_is_what_makes_the_difference():
    """The same bounces from rest at each impact come at other times: a control that must fail."""
    oracle = Oracle()
    first, second = oracle.bounce(), oracle.bounce()
    fresh = Oracle()
    fresh.pushes = []
    speed = RESTITUTION * abs(oracle.position(first * (1 - 1e-14), lift=1.0))
    forgetful = 2 * speed / GRAVITY
    assert abs(second - first - forgetful) > 1e-3


@pytest.mark.parametrize("restitution", [0.5, 0.8])
def test_endless_rebounds_end_in_rest(restitution):
    scene = spring(T=30.0, m=2.0, k=0.0, x=1.0, forcing="-4")
    run = fvi.integrate(
        scene, "gauss4", 60, impacts={"floor": {"when": "x", "restitution": restitution}}
    )
    rest = (1 + restitution) / (1 - restitution)
    assert run.status == "ok"
    assert run.time[-1] == pytest.approx(rest, abs=1e-6)
    (told,) = [re.search(r"at rest on floor from t = (\S+) on", one) for one in run.remarks]
    assert float(told[1]) == pytest.approx(rest, abs=1e-8)
    # the flights shrink by the restitution
    flights = np.diff(run.observed.events["floor"].time)[:10]
    assert np.abs(flights[1:] / flights[:-1] - restitution).max() < 1e-6


def test_a_frictionless_wall_turns_the_normal_velocity_only():
    scene = fvi.lagrangian_scene(
        coordinates=["x", "y"],
        lagrangian="(vx**2 + 2*vy**2)/2",
        initial_position=[0.0, 0.0],
        initial_velocity=[1.0, 0.25],
        final_time=4.0,
    )
    run = fvi.integrate(
        scene,
        "gauss3",
        8,
        coordinates=["x", "y"],
        impacts={"wall": {"when": "1 - x - y", "restitution": 1.0}},
    )
    assert run.observed.events["wall"].time == pytest.approx([0.8])
    assert run.energy == pytest.approx(np.full(run.time.size, run.energy[0]))
    assert run.momentum is not None
    along = run.momentum @ [1.0, -1.0]
    assert along == pytest.approx(np.full(run.time.size, along[0]))


def test_surfaces_that_are_none_are_refused():
    for when, message in (
        ("vx", "vx is no place"),
        ("t - 1", "no coordinate occurs in it"),
        ("abs(x)", "abs has no normal everywhere"),
    ):
        with pytest.raises(ValueError, match=message):
            fvi.integrate(_ball(1.0), "gauss3", 10, impacts={"floor": {"when": when}})
    with pytest.raises(ValueError, match=r"restitution: 2\.0 is not allowed"):
        fvi.integrate(
            _ball(1.0), "gauss3", 10, impacts={"floor": {"when": "x", "restitution": 2.0}}
        )
