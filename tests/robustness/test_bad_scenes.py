"""Scenes that make no sense, at the start or on the way: the place is named, the rest is kept."""

import h5py
import pytest
from command_line import fvi

LAGRANGIAN = """\
name: bad
problem:
  kind: lagrangian
  coordinates: {coordinates}
  lagrangian: "{formula}"
  initial: {{position: {position}, velocity: {velocity}}}
  final_time: 4.0
method: {{rk: gauss, degree: 2}}
ladder: {{steps: [{steps}]}}
"""


def run_text(folder, text, code):
    (folder / "bad.yaml").write_text(text)
    return fvi("run", "bad.yaml", code=code)


def lagrangian(
    formula: str,
    *,
    coordinates: str = "[x]",
    position: str = "1.0",
    velocity: str = "0.0",
    steps: str = "8",
) -> str:
    return LAGRANGIAN.format(
        formula=formula, coordinates=coordinates, position=position, velocity=velocity, steps=steps
    )


ON_THE_WAY = [
    # the scene, step and time
    (lagrangian("x*vx**2/2 - x", velocity="-1.0", steps="16"), "step 2, t = 0.5: "),
    (lagrangian("vx**2/2 - x**1.5", position="0.5", velocity="-1.0", steps="16"),
     "step 1, t = 0.25: "),
    (lagrangian("vx**2/2*(1 + x**2) - x**1.5", velocity="-1.0", steps="16"), "step "),
    ("name: bad\nproblem:\n  kind: kepler\n  initial: {position: [1.0, 0.0], velocity: 0.0}\n"
     "  final_time: 4.0\n  exact: none\nmethod: {rk: gauss, degree: 2}\nladder: {steps: [16]}\n",
     "step 4, t = 1: "),
]  # fmt: skip


@pytest.mark.parametrize(("text", "place"), ON_THE_WAY)
def test_what_happens_on_the_way_is_told_with_step_and_time(folder, text, place):
    result = run_text(folder, text, 1)
    assert place in result.stderr
    with h5py.File(folder / "results" / "bad.h5") as file:
        (case,) = (group for name, group in file["bad"].items())
        run = case["n000016"]
        assert run.attrs["status"] == b"failed"
        # what was finished before is there
        assert run["time"].size >= 2


def test_runs_that_are_finished_are_kept_beside_one_that_fails(folder):
    """A well that ends at x = 0: short steps at the start stay inside of it, long times do not."""
    text = """\
experiments:
  - name: good
    problem: {kind: pendulum, initial: {position: 1.0, velocity: 0.0}, final_time: 1.0}
    method: {rk: gauss, degree: 2}
    ladder: {steps: [8]}
  - name: bad
    problem:
      kind: lagrangian
      coordinates: [x]
      lagrangian: "vx**2/2 - x**1.5"
      initial: {position: 0.5, velocity: -1.0}
      final_time: 4.0
    method: {rk: gauss, degree: 2}
    ladder: {steps: [16]}
"""
    result = run_text(folder, f"name: both\n{text}", 1)
    rows = [row.split() for row in result.stdout.splitlines()[1:3]]
    assert [(row[0], row[-1]) for row in rows] == [("good", "ok"), ("bad", "failed")]
    with h5py.File(folder / "results" / "both.h5") as file:
        (case,) = file["good"].values()
        assert case["n000008"].attrs["status"] in (b"ok", b"floor")
