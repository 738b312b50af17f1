"""The benchmarks measure, count and say what they measured; no time is asserted."""

import math
import os

import numpy as np
import pytest
from written_out import every_lag_written_out

import fvi_cli as fvi
from benchmarks import __main__ as page
from benchmarks import peers, people
from benchmarks.accuracy import pendulum_figure
from benchmarks.measuring import figures_table, in_own_process
from benchmarks.memory import KEPT, measure_memory
from benchmarks.stepping import measure_stepping, stepping_cases, stepping_table
from benchmarks.truth import run_truth, truth_table
from benchmarks.truth.judging import Claim, RefusedError, UnjudgedError, judge


@pytest.fixture(autouse=True)
def measured_once(monkeypatch):
    monkeypatch.setattr("benchmarks.measuring.YARDSTICK_REPEATS", 1)
    # the heap of a process that has run many tests
    monkeypatch.setattr("gc.collect", lambda *generation: 0)


def columns(text: str) -> dict[str, list[str]]:
    """The cells of a table in Markdown below the words of its head."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    head, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    assert all(len(cells) == len(head) for cells in rows)
    return dict(zip(head, map(list, zip(*rows, strict=True)), strict=True))


def test_stepping_at_a_small_size():
    rows = [measure_stepping(case, 1) for case in stepping_cases(6)]
    for row in rows:
        assert row.stepping > 0
        assert row.error < 1e-3 if row.case.is_linear else math.isnan(row.error)
    assert columns(stepping_table(rows))["N"] == ["2^6"] * len(rows)


def test_the_whole_trajectory_is_all_the_memory_there_is():
    """Time, position, momentum, energy are four doubles; parts are put together once."""

    def added(method, exponent):
        shorter, longer = (
            measure_memory(method, 2**power).doubles_per_step for power in (exponent, exponent + 1)
        )
        return 2 * longer - shorter

    # tables of the recurrence, which do not grow with the steps, take a third of a double
    assert 4.0 <= measure_memory(KEPT[1][0], 2**20).doubles_per_step < 8.4
    # control: what a history adds that keeps all samples
    with every_lag_written_out():
        assert added(KEPT[0][0], 11) > 8.0


def test_the_page_of_what_is_asked_for(tmp_path, capsys, monkeypatch):
    (pendulum,) = fvi.cost(fvi.load("cost-pendulum", overrides=["ladder.steps=[20]"]), repeats=1)
    monkeypatch.setattr(page, "run_accuracy", lambda: [pendulum_figure(pendulum)])
    page.main(["accuracy", "--output", str(tmp_path)])
    text = (tmp_path / "accuracy.md").read_text(encoding="utf-8")
    assert "Made by `python -m benchmarks accuracy`" in text
    assert text in capsys.readouterr().out
    with pytest.raises(SystemExit):
        page.main(["no-such-page", "--output", str(tmp_path)])


@pytest.mark.processes
def test_a_process_of_its_own_has_one_core():
    assert in_own_process(os.getenv, "OMP_NUM_THREADS") == "1"
    assert in_own_process(os.getpid) != os.getpid()


class TestTruth:
    def test_numbers_are_right_and_falsified_ones_are_not(self):
        kinds = ["modes", "stability", "convergence"]
        rows = run_truth(1, seed=7, kinds=kinds, workers=0)
        assert [row.kind for row in rows] == ["convergence", "modes", "stability"]
        assert {row.verdict for row in rows} == {"right"}
        reports = []
        falsified = run_truth(
            1, seed=7, kinds=kinds, workers=0, change=lambda x: 1.1 * x + 1, report=reports.append
        )
        assert {row.verdict for row in falsified} == {"wrong"}
        assert len(reports) == 3
        assert all("of seed 7" in text and "fvi " in text for text in reports)
        assert columns(truth_table(falsified))["wrong"] == ["1", "1", "1", "3"]

    def test_what_is_refused_or_breaks_down(self):
        def refused(random, words):
            yield Claim("first", 1.0, 1.0, 0.1)
            raise RefusedError("too stiff")

        def broken(random, words):
            yield Claim("first", 1.0, 1.0, 0.1)
            raise ZeroDivisionError("a mistake")

        def unknown(random, words):
            yield Claim("first", 2.0, 1.0, 0.1)
            raise UnjudgedError("a tangency")

        random = np.random.default_rng(0)
        verdicts = [judge("any", kind, random).verdict for kind in (refused, broken, unknown)]
        assert verdicts == ["refused", "wrong", "wrong"]
        assert Claim("x", math.nan, 1.0, 0.1).ratio(float) == math.inf
        assert Claim("x", math.inf, math.inf, 0.1).ratio(float) == 0


class TestPeople:
    def test_every_piece_of_work_at_a_small_size(self):
        rows = [
            people.building_row(3, 40),
            people.sweep_row(2),
        ]

        assert all(row.measured > 0 for row in rows)
        assert columns(figures_table("", rows))["at most"] == ["1.5", "1.3"]


class TestPeers:
    def test_every_method_at_a_small_size(self):
        rows = peers.run_peers([16])
        errors = {(row.problem, row.method): row.error for row in rows}
        assert all(np.isfinite(error) for error in errors.values())
        for problem in {row.problem for row in rows}:
            assert errors[problem, "fvi gauss3"] < errors[problem, "fvi bdf2"]
        # other packages solve the same problem
        assert errors["oscillator, order 1", "SciPy DOP853"] < 1e-5
        assert errors.get(("pendulum, order 1/2", "pycaputo trapezoidal"), 0.0) < 0.2
        assert len(columns(peers.peers_table(rows))["error"]) == len(rows)
