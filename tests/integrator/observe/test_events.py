"""Events on the dense motion: none is lost, however fast formulas change, and each is in place."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from letters import spring
from numpy.typing import NDArray
from spread import few_of

import fvi_cli as fvi

SCENE = spring(T=20.0, m=1.0, k=1.0, x=1.0)
"""x = cos(t)."""


def _events(events: dict[str, object], n_steps: int = 40) -> fvi.Trajectory:
    return fvi.integrate(SCENE, "gauss12", n_steps, events=events)


def test_crossings_of_a_cosine():
    found = _events(
        {
            "zero": "x",
            "up": {"when": "x", "direction": "rising"},
            "top": {"when": "vx", "direction": "falling"},
            "clock": {"when": "sin(2*t)", "direction": "rising"},
        }
    ).observed
    zeros = np.pi * (np.arange(6) + 0.5)
    assert np.abs(found.events["zero"].time - zeros).max() < 1e-9
    assert np.abs(found.events["up"].time - zeros[1::2]).max() < 1e-9
    assert np.abs(found.events["top"].time - 2 * np.pi * np.arange(1, 4)).max() < 1e-9
    # the start is on the section, and does not count
    assert np.abs(found.events["clock"].time - np.pi * np.arange(1, 7)).max() < 1e-11
    assert np.abs(found.events["zero"].position).max() < 1e-12
    assert np.abs(np.abs(found.events["zero"].velocity) - 1.0).max() < 1e-9


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6, 1e-8])
def test_none_is_lost_where_a_step_has_two(gap):
    # 1 - gap is passed twice near every top, within sqrt(8 gap)
    run = _events({"near": f"x - {1 - gap!r}"}, n_steps=9)
    half = np.arccos(1 - gap)
    tops = 2 * np.pi * np.arange(1, 4)
    expected = np.sort(np.concatenate([[half], tops - half, tops + half]))
    assert run.observed.events["near"].time.size == expected.size
    fine = fvi.integrate(SCENE, "gauss12", 60, events={"near": f"x - {1 - gap!r}"})
    assert np.abs(fine.observed.events["near"].time - expected).max() < 1e-12 / np.sqrt(gap) + 1e-9


def test_a_touch_is_no_crossing_and_a_root_at_a_mesh_point_is_one():
    run = _events({"touch": "x - 1.0000000001", "node": "t - 10"}, n_steps=40)
    assert run.observed.events["touch"].time.size == 0
    assert run.observed.events["node"].time.tolist() == [10.0]


def test_the_run_ends_at_an_event():
    run = fvi.integrate(
        SCENE,
        "gauss12",
        40,
        events={"stop": {"when": "x + 0.5", "stop": True}, "zero": "x"},
        quantities={"v": "vx"},
    )
    end = 2 * np.pi / 3
    assert abs(run.time[-1] - end) < 1e-9
    assert abs(run.position[-1, 0] + 0.5) < 1e-12
    assert run.observed.stopped_by == "stop"
    assert run.observed.events["zero"].time.size == 1
    assert run.observed.extents["v"].peak == pytest.approx(1.0, abs=1e-9)
    assert any("stopped by the event stop" in one for one in run.remarks)


Array = NDArray[np.float64]
Function = Callable[[Array], Array]

ROOT_OF_2 = math.sqrt(math.log(2.0))


def _crossings(level: float, final_time: float, *, of_speed: bool) -> Array:
    """Times at which x = cos t, or its velocity -sin t, is at a level."""
    k = np.arange(math.ceil(final_time / (2 * math.pi)) + 2)
    first = math.asin(-level) if of_speed else math.acos(level)
    second = math.pi - first if of_speed else -first
    found = np.concatenate([first + 2 * math.pi * k, second + 2 * math.pi * k])
    return np.sort(found[(found > 0) & (found < final_time)])


def _wave(rng: np.random.Generator, final_time: float) -> tuple[str, Array, Function]:
    rate, shift = 10.0 ** rng.uniform(0.5, 3.0), rng.uniform(0.1, 3.0)
    k = np.arange(1, int((rate * final_time + shift) / math.pi) + 1)
    return (
        f"sin({rate!r}*t + {shift!r})",
        (k * math.pi - shift) / rate,
        lambda t: np.sin(rate * t + shift),
    )


def _pulse_in_the_motion(
    rng: np.random.Generator, final_time: float
) -> tuple[str, Array, Function]:
    width, at = 10.0 ** rng.uniform(-1.5, -0.7), rng.uniform(-0.7, 0.7)
    of_speed = bool(rng.random() < 0.5)
    name = "vx" if of_speed else "x"
    levels = (at - width * ROOT_OF_2, at + width * ROOT_OF_2)
    times = np.concatenate([_crossings(one, final_time, of_speed=of_speed) for one in levels])

    def value(t: Array) -> Array:
        here = -np.sin(t) if of_speed else np.cos(t)
        return np.asarray(np.exp(-(((here - at) / width) ** 2)) - 0.5)

    return f"exp(-(({name} - {at!r})/{width!r})**2) - 0.5", np.sort(times), value


def _lesser(rng: np.random.Generator, final_time: float) -> tuple[str, Array, Function]:
    a, b = rng.uniform(-0.6, 0.6, 2).tolist()
    word, choose = ("min", np.minimum) if rng.random() < 0.5 else ("max", np.maximum)

    def value(t: Array) -> Array:
        return np.asarray(choose(np.cos(t) - a, -np.sin(t) - b))

    every = [_crossings(a, final_time, of_speed=False), _crossings(b, final_time, of_speed=True)]
    times = np.sort(np.concatenate(every))
    times = times[np.sign(value(times - 1e-7)) != np.sign(value(times + 1e-7))]
    return f"{word}(x - ({a!r}), vx - ({b!r}))", times, value


KINDS = (_wave, _pulse_in_the_motion, _lesser)


@few_of(10, 500)
def test_all_changes_of_sign_are_found(seed):
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    final_time = float(rng.uniform(3.0, 30.0))
    when, times, value = kind(rng, final_time)
    direction = ("any", "rising", "falling")[seed // len(KINDS) % 3]
    n_steps = int(final_time * 10.0 ** rng.uniform(0.2, 1.3))
    run = fvi.integrate(
        spring(T=final_time, m=1.0, k=1.0, x=1.0),
        "gauss12",
        n_steps,
        events={"e": {"when": when, "direction": direction}},
    )
    times = times[(times > 1e-6) & (times < final_time * (1 - 1e-6))]
    if direction != "any":
        near = 1e-3 * np.append(np.diff(times), 1.0).min() if times.size else 0.0
        rises = value(times + near) > value(times - near)
        times = times[rises == (direction == "rising")]
    found = run.observed.events["e"].time
    found = found[(found > 1e-6) & (found < final_time * (1 - 1e-6))]
    assert run.remarks == ()
    assert found.size == times.size, (when, n_steps)
    assert np.abs(found - times).max(initial=0.0) < 1e-7


@pytest.mark.parametrize("rate", [200, 1000])
def test_a_stroboscope_is_complete_under_a_tolerance(rate):
    final_time = 8.0
    run = fvi.integrate(
        spring(T=final_time, m=1.0, k=1.0, x=1.0),
        "gauss6",
        fvi.AdaptiveSteps(tolerance=1e-6),
        events={"e": {"when": f"sin({rate}*t)", "direction": "rising"}},
    )
    expected = 2 * math.pi / rate * np.arange(1, int(rate * final_time / (2 * math.pi)) + 1)
    found = run.observed.events["e"].time
    assert found.size == expected.size
    assert np.abs(found - expected).max() < 1e-11
