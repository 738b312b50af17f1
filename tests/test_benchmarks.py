"""The benchmarks measure, count and say what they measured; no time is asserted."""

import dataclasses
import math
import os

import numpy as np
import pytest
from written_out import every_lag_written_out

import fvi_cli as fvi
from benchmarks import __main__ as page
from benchmarks import peers, people
from benchmarks.accuracy import cost_goals
from benchmarks.measuring import in_own_process
from benchmarks.memory import measure_memory, memory_cases
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


class TestStepping:
    def test_every_case_at_a_small_size(self):
        cases = stepping_cases(6)
        rows = [measure_stepping(case, 1) for case in cases]
        for case, measured in zip(cases, rows, strict=True):
            assert measured.n_steps == 2**case.exponent
            # a difference of two times, which may have either sign where others compute as well
            assert math.isfinite(measured.stepping_seconds)
            assert measured.yardstick_seconds > 0
            assert math.isnan(measured.error) if case.scene == "pendulum" else measured.error < 1e-3
            assert (measured.history_operations > 0) or case.order == 1
            assert measured.doubles_per_step > 0
        assert columns(stepping_table(rows))["N"] == ["2^6"] * len(rows)


class TestMemory:
    def test_the_whole_trajectory_is_all_there_is(self):
        """Time, position, momentum, energy are four doubles; parts are put together once."""

        def added(case, exponent):
            shorter, longer = (
                measure_memory(dataclasses.replace(case, n_steps=2**power)).doubles_per_step
                for power in (exponent, exponent + 1)
            )
            return 2 * longer - shorter

        bdf4, gauss2, _, _ = memory_cases(15)
        assert gauss2.name.endswith("Gauss2")
        for case in (bdf4, gauss2):
            whole = measure_memory(dataclasses.replace(case, n_steps=2**20))
            # tables of the recurrence, which do not grow with the steps, take a third of a double
            assert 4.0 <= whole.doubles_per_step < 8.4
        # control: what a history adds that keeps all samples
        with every_lag_written_out():
            assert added(bdf4, 11) > 8.0


@pytest.mark.processes
def test_the_page_has_the_sections_that_are_asked_for(tmp_path, capsys, monkeypatch):
    few = stepping_cases(6)[:1]
    monkeypatch.setattr("benchmarks.stepping.stepping_cases", lambda exponent: few)
    (pendulum,) = fvi.cost(fvi.load("cost-pendulum", overrides=["ladder.steps=[20]"]), repeats=1)
    monkeypatch.setattr(page, "run_accuracy", lambda: cost_goals([pendulum], 1e-2))
    page.main(["stepping", "accuracy", "--exponent", "6", "--output", str(tmp_path)])
    text = (tmp_path / "benchmark.md").read_text(encoding="utf-8")
    assert "Made by `python -m benchmarks --exponent 6`" in text
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        "## Time and error",
        "## What accuracy costs",
    ]
    assert text in capsys.readouterr().out
    with pytest.raises(SystemExit):
        page.main(["no-such-section", "--output", str(tmp_path)])


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
            people.bifurcation_row(2),
            people.ensemble_row(2),
        ]
        assert all(row.ratio > 0 for row in rows)
        assert columns(people.people_table(rows))["goal"] == ["1.5", "1.3", "2", "2"]


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
