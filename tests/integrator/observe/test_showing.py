"""Trajectories as lines, data frames and datasets."""

import numpy as np
import pytest
from letters import spring

import fvi_cli as fvi


@pytest.fixture(scope="module")
def run() -> fvi.Trajectory:
    scene = spring(T=3.0, m=np.eye(2), k=np.array([[2.0, -1.0], [-1.0, 2.0]]), x=[1.0, 0.0])
    return fvi.integrate(scene, "gauss2-graded", 30, quantities={"drift": "x2 - x1"})


def test_a_data_frame_has_named_columns_and_clean_times(run):
    pytest.importorskip("pandas")
    frame = run.to_dataframe()
    assert list(frame.columns) == ["x1", "x2", "p_x1", "p_x2", "energy", "drift"]
    assert frame.index.name == "time"
    # 3 * 0.1 is 0.30000000000000004
    assert 0.3 in frame.index
    assert np.array_equal(frame["x2"], run.position[:, 1])
    assert frame.loc[0.3, "drift"] == pytest.approx(run.position[3, 1] - run.position[3, 0])


def test_a_dataset_has_named_axes(run):
    pytest.importorskip("xarray")
    data = run.to_xarray()
    assert data.position.sel(coordinate="x2", time=0.3).item() == run.position[3, 1]
    assert data.drift.dims == ("time",)


def test_runs_of_a_configuration_know_their_coordinates():
    problem = {"kind": "double-pendulum", "initial": {"position": [0.5, 0.0]}, "final_time": 1.0}
    config = {"name": "two", "problem": {**problem, "exact": "none"}, "ladder": {"steps": [10]}}
    (outcome,) = fvi.run(config)
    assert outcome.finished[0].trajectory.coordinates == ("theta1", "theta2")
