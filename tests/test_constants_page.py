"""The page of constants: which there are, who reads them, what they steer."""

import math
import sys

import numpy as np
import pytest

from benchmarks import constants
from fvi_cli.integrator.meshes import adaptive


@pytest.fixture(scope="module")
def known():
    constants.runs()  # whatever they need is imported
    return {(one.module.rpartition(".")[2], one.name): one for one in constants.constants()}


def test_constants_are_found_with_their_readers(known):
    unit = known["convergence", "UNIT"]
    assert unit.value == 2.0**-53
    assert unit.readers[0] == "fvi_cli.mathematics.convergence"
    assert "fvi_cli.integrator.engine.newton" in unit.readers
    for one in known.values():
        assert getattr(sys.modules[one.module], one.name) == one.value
        assert math.isfinite(one.value)
    # a flag and a table are no numbers
    assert not any(isinstance(one.value, bool) for one in known.values())


def test_a_constant_is_changed_wherever_it_is_read_and_put_back(known):
    unit = known["convergence", "UNIT"]
    loaded = [sys.modules[one] for one in unit.readers if one in sys.modules]
    assert len(loaded) > 1

    def fail() -> None:
        with constants.changed(unit, 0.5):
            assert {one.UNIT for one in loaded} == {0.5}
            raise RuntimeError("ends")

    with pytest.raises(RuntimeError, match="ends"):
        fail()
    assert {one.UNIT for one in loaded} == {unit.value}


def test_whole_numbers_stay_whole_and_at_least_one(known):
    sweeps = constants.Constant("m", "N", 3, ("m",))
    assert [sweeps.times(factor) for factor in (0.25, 0.5, 2.0)] == [1, 2, 6]
    assert constants.Constant("m", "X", 3.0, ("m",)).times(0.5) == 1.5


@pytest.mark.parametrize(
    ("moves", "works", "steers"),
    [
        (1.0, 0, "results"),
        (1e-13, 0, "last digits"),
        (0.0, 100, "time"),
        (1e-13, 100, "time and last digits"),
        (0.0, 0, "nothing here"),
    ],
)
def test_what_steers_results_time_and_nothing(known, monkeypatch, moves, works, steers):
    safety = known["adaptive", "SAFETY"]
    clock = [0.0]

    def run() -> np.ndarray:
        """A run whose positions and time are known."""
        clock[0] += 1.0 + works * adaptive.SAFETY
        return np.array([1.0, 1.0 + moves * adaptive.SAFETY])

    monkeypatch.setattr("time.process_time", lambda: clock[0])
    usual = constants.usual(run, 1)
    felt = constants.feel(safety, {"made up": usual}, 1)
    assert felt.steers == steers
    assert felt.steers_time == bool(works)
    if works:
        row = constants.sweep(felt, usual, 1)
        assert row[2] == "made up"
        assert [float(cell) for cell in row[3:7]] == pytest.approx([0.25, 0.5, 2, 4], abs=0.05)
        assert row[7] == f"{0.25 * safety.value:g}"


def test_a_run_that_fails_is_a_result(known):
    safety = known["adaptive", "SAFETY"]

    def run() -> np.ndarray:
        return np.ones(1) / (safety.value == adaptive.SAFETY)

    with np.errstate(divide="raise"):
        felt = constants.feel(safety, {"made up": constants.usual(run, 1)}, 1)
    assert math.isinf(felt.change)
    assert felt.steers == "results"


def test_the_page(monkeypatch):
    every = {"graded": constants.runs()["graded"]}
    monkeypatch.setattr(constants, "runs", lambda size: every)
    page = constants.run_constants(most=2, repeats=1)
    assert "2 doubled and halved" in page
    assert "by 1 runs (graded)" in page
    assert page.count("\n| `") >= 2
