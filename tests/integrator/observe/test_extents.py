"""Peaks and RMS of runs that an event stops anywhere in a step: a class."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from letters import observe_one
from numpy.typing import NDArray
from scipy.integrate import quad

import fvi_cli as fvi
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.request import observations
from fvi_cli.integrator.trajectory import Observed

Array = NDArray[np.float64]

GROWTH, FINAL_TIME = 0.2, 20.0
RATE = math.sqrt(1 - GROWTH**2)
SCENE = fvi.linear_oscillator(
    final_time=FINAL_TIME,
    mass=1.0,
    stiffness=1.0,
    initial_velocity=1.0,
    damping=[fvi.FractionalDamping(order=1.0, coefficient=-2 * GROWTH)],
)
"""x = exp(t/5) sin(w t) / w, which grows."""


def _x(t: Array) -> Array:
    return np.asarray(np.exp(GROWTH * t) * np.sin(RATE * t) / RATE)


def _vx(t: Array) -> Array:
    return np.asarray(GROWTH * _x(t) + np.exp(GROWTH * t) * np.cos(RATE * t))


QUANTITIES: dict[str, tuple[str, Callable[[Array], Array]]] = {
    "x": ("x", _x),
    "power": ("0.4*vx**2", lambda t: 0.4 * _vx(t) ** 2),
    "mixed": ("x*vx - t", lambda t: _x(t) * _vx(t) - t),
    "falling": ("exp(-t)", lambda t: np.exp(-t)),
    "a": ("ax", lambda t: 0.4 * _vx(t) - _x(t)),
}


def _observed(when: str, n_steps: int, output: Array | None = None) -> Observed:
    asked = observations(
        ("x",),
        output=output,
        quantities={name: text for name, (text, _) in QUANTITIES.items()},
        events={"stop": {"when": when, "direction": "rising", "stop": True}},
    )
    method = Method(cq="gauss", degree=12, start="none")
    run = observe_one(SCENE, method, n_steps, asked)
    assert run.observed is not None
    assert output is not None or run.time[-1] == run.observed.events["stop"].time[0]
    return run.observed


def _worst(observed: Observed, end: float) -> float:
    """Largest error of peak, extremes and RMS up to a time, relative to the peak."""
    t = np.linspace(0.0, end, 400_001)
    worst = 0.0
    for name, (_, function) in QUANTITIES.items():
        values, found = function(t), observed.extents[name]
        mean = quad(lambda s, f=function: float(f(s)) ** 2, 0, end, limit=400, epsabs=1e-12)[0]
        wanted = [values.min(), values.max(), np.abs(values).max(), math.sqrt(mean / end)]
        seen = [found.least, found.greatest, found.peak, found.rms]
        seen.append(abs(float(function(np.array(found.peak_time)))))
        wanted.append(found.peak)
        worst = max(worst, np.abs(np.subtract(seen, wanted)).max() / np.abs(values).max())
    return float(worst)


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(12))
def test_what_ends_within_a_step_is_counted_up_to_there(seed):
    rng = np.random.default_rng(seed)
    end = float(rng.uniform(0.03, 0.98) * FINAL_TIME)
    n_steps = int(rng.integers(14, 60))
    output = np.linspace(0.0, FINAL_TIME, 23) if seed % 3 == 2 else None
    observed = _observed(f"t - {end!r}", n_steps, output)
    assert observed.stopped_by == "stop"
    assert _worst(observed, end) < 1e-6


def test_another_end_has_another_peak():
    """The control: what a step goes through behind the end is told apart."""
    observed = _observed("t - 7.3", 14)
    assert _worst(observed, 7.3) < 1e-6
    assert _worst(observed, 7.4) > 1e-3


@pytest.mark.parametrize("seed", range(16))
def test_a_value_that_begins_with_zero_up_to_round_off_is_no_event(seed):
    """Scales and phases are drawn; the motion comes back to where it began."""
    rng = np.random.default_rng(seed)
    scale, phase = 10.0 ** rng.uniform(-8, 8), float(rng.uniform(-1.5, 1.5))
    x, v = scale * math.sin(phase), scale * math.cos(phase)
    scene = fvi.linear_oscillator(
        final_time=9.0, mass=1.0, stiffness=1.0, initial_position=x, initial_velocity=v
    )
    texts = (f"x - ({x!r})", f"3*x - ({3 * x!r})", f"({x!r} - x)/7")
    when = texts[seed % len(texts)]
    asked = observations(("x",), events={"back": {"when": when}})
    method = Method(cq="gauss", degree=12, start="none")
    run = observe_one(scene, method, int(rng.integers(8, 40)), asked)
    # sin(t + phase) = sin(phase)
    other = math.pi - 2 * phase
    expected = sorted(t for t in (other, other + 2 * math.pi, 2 * math.pi) if 0 < t < 9.0)
    assert run.observed is not None
    assert run.observed.events["back"].time == pytest.approx(expected, abs=1e-5)
