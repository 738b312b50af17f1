"""A run with output that is a member of a sweep later keeps all that is stored of it."""

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.storage.result_file import ResultFile

PROBLEM = {
    "kind": "duffing",
    "damping": [{"order": 0.6, "coefficient": 0.25}],
    "parameters": {"F": 0.375},
    "forcing": "F*cos(t)",
    "initial": {"position": 0.5},
    "final_time": 4.0,
    "exact": "none",
}
CONFIG = {
    "name": "joins",
    "problem": PROBLEM,
    "method": "gauss3",
    "ladder": {"steps": [32]},
    "output": {"step": 0.25},
}
STARTS = {"problem.initial.position": [0.25, 0.5, 0.75]}
STOPPED = {"events": {"low": {"when": "x", "direction": "falling", "stop": True}}}


def alone(start):
    return {**PROBLEM, "initial": {"position": start}}


def meshes(path):
    """The points of the steps of every run that has them, every record verified."""
    stored = ResultFile(path)
    records = [entry.record() for entry in stored.entries]
    stored.close()
    return {one.identity: one.arrays["mesh"] for one in records if "mesh" in one.arrays}


@pytest.mark.few(1)
@pytest.mark.parametrize("more", [{}, STOPPED], ids=["whole", "stopped"])
@pytest.mark.parametrize("between", [(), ({"problem.parameters.F": [0.25, 0.5]},)])
def test_what_was_stored_of_runs_is_read_again_after_sweeps(more, between, tmp_path):
    config, known = {**CONFIG, **more}, {}
    for start in (0.5, 0.75):
        fvi.run({**config, "problem": alone(start)}, output=tmp_path)
        known |= meshes(tmp_path / "joins.h5")
    for sweep in (*between, STARTS, {"problem.parameters.F": [0.375, 0.5]}, STARTS):
        fvi.run({**config, "sweep": sweep}, output=tmp_path)
        found = meshes(tmp_path / "joins.h5")
        assert found.keys() >= known.keys()
        assert all(np.array_equal(found[one], mesh) for one, mesh in known.items())
    assert len(known) == 2
    assert (len({mesh.size for mesh in known.values()}) > 1) == bool(more)
    (again,) = fvi.recall(tmp_path / "joins.h5")
    (fresh,) = fvi.run({**config, "sweep": STARTS})
    for one, other in zip(again.finished, fresh.finished, strict=True):
        assert np.array_equal(one.trajectory.position, other.trajectory.position)
    (first,) = fvi.run({**config, "problem": alone(0.5)}, output=tmp_path)
    (own,) = fvi.run({**config, "problem": alone(0.5)})
    assert np.array_equal(
        first.finished[0].trajectory.observed.mesh, own.finished[0].trajectory.observed.mesh
    )
