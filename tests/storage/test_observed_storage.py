"""Output times, quantities and events in files: written, read, listed, exported."""

from pathlib import Path

import h5py
import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.runner.compute import plan

CONFIG = {
    "name": "seen",
    "problem": {
        "kind": "pendulum",
        "damping": [{"order": 0.5, "coefficient": 0.3}],
        "initial": {"position": 1.0},
        "final_time": 8.0,
        "exact": "none",
    },
    "method": {"rk": "gauss", "degree": 4},
    "ladder": {"steps": [32]},
    "output": {"step": 0.1},
    "quantities": {"torque": "dx", "a": "ax"},
    "events": {"turn": {"when": "vx"}, "never": {"when": "x - 2"}},
}


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, fvi.Trajectory]:
    folder = tmp_path_factory.mktemp("seen")
    (outcome,) = fvi.run(CONFIG, output=folder)
    return folder / "seen.h5", outcome.finished[0].trajectory


def test_the_run_is_read_as_it_was(stored):
    path, first = stored
    (outcome,) = fvi.recall(path)
    again = outcome.finished[0].trajectory
    # no dust: the times are the decimal numbers
    assert again.time.tolist() == [float(f"{k / 10:.1f}") for k in range(81)]
    assert np.array_equal(again.position, first.position)
    assert np.array_equal(again.observed.mesh, first.observed.mesh)
    for name, values in first.observed.quantities.items():
        assert np.array_equal(again.observed.quantities[name], values)
    assert again.observed.extents == first.observed.extents
    for name, one in first.observed.events.items():
        assert np.array_equal(again.observed.events[name].time, one.time)
        assert np.array_equal(again.observed.events[name].velocity, one.velocity)
    # the second time nothing is computed
    assert {one.action for one in plan(CONFIG, output=path.parent)} == {"reuse"}
    changed = {**CONFIG, "quantities": {"torque": "2*dx"}}
    assert {one.action for one in plan(changed, output=path.parent)} == {"compute"}


def test_groups_and_axes(stored):
    with h5py.File(stored[0]) as file:
        run = file["seen/gauss-s4-graded/n000032"]
        assert run["time"].size == 81
        assert run["mesh"].is_scale
        assert run["quantities/torque"].dims[0][0] == run["time"]
        turns = run["events/turn/time"]
        assert turns.dims[0][0] == run["events/turn/occurrence"]
        assert turns.size >= 2
        assert run["events/turn/velocity"].shape == (turns.size, 1)
        assert np.abs(run["events/turn/velocity"][()]).max() < 1e-12
        assert run["events/never/time"].size == 0


def test_members_of_a_sweep_keep_their_quantities(tmp_path):
    events = {**CONFIG["events"], "low": {"when": "x + 0.52"}, "end": {"when": "t - 7.55"}}
    config = {**CONFIG, "events": events, "sweep": {"problem.damping.0.order": [0.2, 0.5, 0.8]}}
    (first,) = fvi.run(config, output=tmp_path)
    (again,) = fvi.recall(tmp_path / "seen.h5")
    for one, other in zip(first.finished, again.finished, strict=True):
        kept, read = one.trajectory.observed, other.trajectory.observed
        assert np.array_equal(kept.quantities["torque"], read.quantities["torque"])
        assert kept.extents == read.extents
        for name, event in kept.events.items():
            for part in ("time", "position", "velocity"):
                assert np.array_equal(getattr(event, part), getattr(read.events[name], part))
    counts = [one.trajectory.observed.events["low"].time.size for one in again.finished]
    assert len(set(counts)) > 1
    with h5py.File(tmp_path / "seen.h5") as file:
        run = file["seen/gauss-s4-graded/n000032"]
        assert run["events/low/time"].shape == (3, max(counts))
        assert run["events/low/velocity"].dims[1][0] == run["events/low/occurrence"]
        assert run["events/low/velocity"].dims[0][0] == run["member"]
        assert run["events/never/position"].shape == (3, 0, 1)
    observed = [one.trajectory.observed for one in again.finished]
    assert len({one.extents["torque"].peak for one in observed if one is not None}) == 3
