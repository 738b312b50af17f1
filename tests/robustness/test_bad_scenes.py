"""Scenes that make no sense, at the start or on the way: the place is named, the rest is kept."""

import h5py
import pytest
from command_line import fvi

BAD = """\
  problem:
    kind: lagrangian
    coordinates: [x]
    lagrangian: {formula}
    initial: {{position: {position}, velocity: -1.0}}
    final_time: 4.0
  method: {{rk: gauss, degree: 2}}
  ladder: {{steps: [16]}}
"""


@pytest.mark.parametrize(
    ("formula", "position", "place"),
    [("x*vx**2/2 - x", 1.0, "step 2, t = 0.5: "), ("vx**2/2 - x**1.5", 0.5, "step 1, t = 0.25: ")],
)
def test_what_happens_on_the_way_is_told_with_step_and_time(folder, formula, position, place):
    """And runs that are finished are kept beside one that fails."""
    good = "- name: good\n  problem: {kind: pendulum, final_time: 1.0}\n  ladder: {steps: [8]}\n"
    bad = "- name: bad\n" + BAD.format(formula=formula, position=position)
    (folder / "both.yaml").write_text(f"name: both\nexperiments:\n{good}{bad}")
    result = fvi("run", "both.yaml", code=1)
    assert place in result.stderr
    rows = [row.split() for row in result.stdout.splitlines()[1:3]]
    assert [(row[0], row[-1]) for row in rows] == [("good", "ok"), ("bad", "failed")]
    with h5py.File(folder / "results" / "both.h5") as file:
        (case,) = file["bad"].values()
        run = case["n000016"]
        assert run.attrs["status"] == b"failed"
        # what was finished before is there
        assert run["time"].size >= 2
        (case,) = file["good"].values()
        assert case["n000008"].attrs["status"] in (b"ok", b"floor")
