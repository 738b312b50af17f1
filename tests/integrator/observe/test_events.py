"""Events on the dense motion: none is lost, and each is where the motion is."""

import numpy as np
import pytest
from letters import spring

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


def test_peaks_lie_between_the_points():
    run = fvi.integrate(SCENE, "gauss12", 23, quantities={"x": "x - 0.25", "mixed": "x*vx"})
    one = run.observed.extents["x"]
    assert one.peak == pytest.approx(1.25, abs=1e-10)
    assert one.peak_time % (2 * np.pi) == pytest.approx(np.pi, abs=1e-5)
    assert (one.least, one.greatest) == (pytest.approx(-1.25, abs=1e-9), pytest.approx(0.75))
    mean_square = 0.5 + 0.0625 + np.sin(40.0) / 80 - 0.5 * np.sin(20.0) / 20
    assert one.rms == pytest.approx(np.sqrt(mean_square), rel=1e-8)
    assert run.observed.extents["mixed"].peak == pytest.approx(0.5, abs=1e-8)
