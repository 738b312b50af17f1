"""The benchmarks measure, count and say what they measured; no time is asserted."""

import dataclasses
import math
import os

import numpy as np
import pytest
from cost_tables import COUNTS, GAUSS, row, table

from benchmarks import __main__ as page
from benchmarks.accuracy import accuracy_table, cost_goals
from benchmarks.adaptive import adaptive_cases, adaptive_table, measure_adaptive
from benchmarks.many import many_cases, many_table, measure_many
from benchmarks.measuring import in_own_process
from benchmarks.memory import LONG_RUN, measure_memory, memory_cases, memory_table, run_memory
from benchmarks.startup import run_startup, startup_table
from benchmarks.stepping import measure_stepping, stepping_cases, stepping_table
from benchmarks.truth import run_truth, truth_table
from benchmarks.truth.judging import Claim, Judged, RefusedError, UnjudgedError, judge
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.studies.cost import CostCase, CostTable


@pytest.fixture(autouse=True)
def measured_once(monkeypatch):
    monkeypatch.setattr("benchmarks.measuring.YARDSTICK_REPEATS", 1)
    # the heap of a process that has run many tests
    monkeypatch.setattr("gc.collect", lambda: 0)


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
            assert measured.stepping_seconds > 0 < measured.yardstick_seconds
            assert math.isnan(measured.error) if case.scene == "pendulum" else measured.error < 1e-3
            assert (measured.history_operations > 0) or case.order == 1
            assert measured.doubles_per_step > 0
            # nobody writes out the sums of Runge-Kutta methods
            assert math.isnan(measured.speed_up) == case.method.is_runge_kutta
        assert columns(stepping_table(rows))["N"] == ["2^6"] * len(rows)

    def test_a_figure_that_is_missed_is_said(self):
        case = dataclasses.replace(stepping_cases(6)[0], largest_error=0.0)
        missed = measure_stepping(case, 1)
        held = dataclasses.replace(missed, largest_error=1.0, largest_multiple=math.inf)
        slow = dataclasses.replace(held, largest_multiple=0.0)
        met = columns(stepping_table([missed, held, slow]))["met"]
        assert met == ["no", "yes", "no"]

    def test_growth_is_that_of_the_times(self):
        measured = measure_stepping(stepping_cases(15)[2], 1)
        assert math.isfinite(measured.growth_exponent)
        assert math.isnan(measured.speed_up)


class TestMany:
    def test_every_case_at_a_small_size(self):
        rows = [measure_many(case, 16, 256) for case in many_cases()]
        for measured in rows:
            assert measured.alone_seconds > 0 < measured.together_seconds
            assert measured.difference <= 1e-12
        members, swings, *_, uncoupled, dampers, _ = (r.history_operations for r in rows)
        # the past of a step is the same work, whatever pulls
        assert members == swings
        assert uncoupled == dampers
        assert columns(many_table(rows))["components"] == ["16"] * len(rows)

    def test_in_a_long_chain_only_what_is_damped_is_remembered(self):
        dampers, one_damper = (
            measure_many(case, 150, 16).history_operations for case in many_cases()[-2:]
        )
        assert one_damper < dampers / 20

    def test_a_figure_that_is_missed_is_said(self):
        measured = measure_many(many_cases()[0], 8, 64)
        rows = [dataclasses.replace(measured, largest_each=bound) for bound in (1e9, 1e-9)]
        assert columns(many_table(rows))["met"] == ["yes", "no"]


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
            whole = measure_memory(dataclasses.replace(case, n_steps=2**18))
            # tables of the recurrence, which do not grow with the steps, take a tenth of a double
            assert 4.0 <= whole.doubles_per_step < 8.2
        # control: what a history adds that keeps all samples
        direct = Method(cq="bdf4", degree=2, history="direct")
        assert added(dataclasses.replace(bdf4, method=direct), 11) > 8.0

    def test_long_runs_are_extrapolated_and_rated(self, monkeypatch):
        """From the run and one of a tenth, on a line."""
        measured = measure_memory(memory_cases(6, 1000)[-1])
        assert 1e7 < measured.process_bytes < 1e11
        assert math.isnan(measured.extrapolated_bytes)

        def on_a_line(action, case):
            return dataclasses.replace(
                measured,
                n_steps=case.n_steps,
                process_bytes=5e7 + 2.0 * case.n_steps,
                largest_doubles=case.largest_doubles,
            )

        monkeypatch.setattr("benchmarks.memory.in_own_process", on_a_line)
        rows = run_memory(10)
        assert rows[-1].extrapolated_bytes == pytest.approx(5e7 + 2.0 * LONG_RUN)
        rows.append(dataclasses.replace(rows[-1], extrapolated_bytes=1e8))
        rows.append(dataclasses.replace(rows[-1], largest_doubles=0.0))
        assert columns(memory_table(rows))["met"][-3:] == ["yes", "yes", "no"]


class TestAccuracy:
    def pendulum(self, seconds: float) -> CostTable:
        rows = tuple(row(n, 10.0 * n**-6.0, seconds) for n in COUNTS)
        return table(
            CostCase(method=GAUSS, rows=rows),
            CostCase(
                method=Baseline(name="gruenwald-letnikov"),
                rows=tuple(row(n, 1e-3 / n, 1e-4 * n) for n in COUNTS),
            ),
            name="cost-pendulum",
        )

    def test_ratios_are_read_off_the_curves(self):
        theirs, other = cost_goals([self.pendulum(1e-3)], 1e-2)
        # 1e-3 / N = 1e-9 at N = 1e6: 100 s
        assert theirs.measured == pytest.approx(100 / 1e-3)
        assert theirs.is_met
        assert "extrapolated" in theirs.how
        assert other.measured == pytest.approx(1e4 * 1e-4 / 1e-3)

    def test_what_is_too_slow_is_not_met(self):
        assert not cost_goals([self.pendulum(0.1)], 1e-2)[0].is_met

    def test_the_transform_is_the_yardstick(self):
        rows = (row(100, 1e-8, 1e-3), row(200, 1e-10, 4e-2))
        step = table(CostCase(method=GAUSS, rows=rows), name="cost-step-forced")
        stepping, whole = cost_goals([step], 1e-2)
        assert stepping.measured == pytest.approx(3.0)
        assert whole.measured == pytest.approx(4.0)
        assert not stepping.is_met
        assert whole.is_met

    def test_nothing_reached_is_not_met(self):
        step = table(CostCase(method=GAUSS, rows=(row(100, 1e-3, 1e-3),)), name="cost-step-forced")
        assert not any(goal.is_met for goal in cost_goals([step], 1e-2))

    def test_the_oscillator_is_compared_on_the_same_grid(self):
        ours = CostCase(method=GAUSS, rows=(row(10, 1e-10, 1.0), row(20, 1e-12, 3.0)))
        others = [
            CostCase(
                method=Baseline(name="dop853", tolerance=tolerance),
                rows=(row(10, tolerance, 0.5), row(20, tolerance, 0.5)),
            )
            for tolerance in (1e-8, 1e-10)
        ]
        (goal,) = cost_goals([table(ours, *others, name="cost-damped-oscillator")], 1e-2)
        assert goal.measured == pytest.approx(6.0)
        assert not goal.is_met
        assert columns(accuracy_table([goal]))["met"] == ["no"]


@pytest.mark.processes
def test_the_page_has_the_sections_that_are_asked_for(tmp_path, capsys, monkeypatch):
    few = stepping_cases(6)[:1]
    monkeypatch.setattr("benchmarks.stepping.stepping_cases", lambda exponent: few)
    monkeypatch.setattr(
        page, "run_accuracy", lambda: cost_goals([TestAccuracy().pendulum(1e-3)], 1e-2)
    )
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
def test_commands_are_measured_beside_their_imports():
    rows = run_startup(1)
    assert len(rows) == 4
    assert all(row.seconds > 0 for row in rows)
    taken = iter((0.2, 0.3, 0.25, 0.29, 0.4, 0.2, 0.35, 0.5))
    *_, check = rows = run_startup(2, lambda arguments: next(taken))
    assert [row.seconds for row in rows] == [0.2, 0.2, 0.25, 0.29]
    assert check.multiple == pytest.approx(1.45)
    assert "first: yes" in startup_table(rows)
    slow = dataclasses.replace(check, multiple=1.6)
    assert "first: no" in startup_table([*rows, slow])


@pytest.mark.processes
def test_a_process_of_its_own_has_one_core():
    assert in_own_process(os.getenv, "OMP_NUM_THREADS") == "1"
    assert in_own_process(os.getpid) != os.getpid()


class TestAdaptive:
    def test_figures_are_met_but_for_time(self):
        cases = {case.name: case for case in adaptive_cases()}
        measured = measure_adaptive(cases["mu = 20, gamma = 1.5, k = 30"], 1)
        assert measured.is_met
        assert measured.seconds > 0 < measured.yardstick_seconds
        missed = dataclasses.replace(
            measured, case=dataclasses.replace(measured.case, most_steps=1)
        )
        assert columns(adaptive_table([measured, missed]))["met"] == ["yes", "no"]


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

    @pytest.mark.parametrize(("verdict", "code"), [("right", 0), ("refused", 0), ("wrong", 1)])
    def test_exit_code_and_page(self, tmp_path, monkeypatch, capsys, verdict, code):
        row = Judged(kind="modes", verdict=verdict, ratio=0.5, numbers=3, words=())
        seen = []
        monkeypatch.setattr(page, "run_truth", lambda n, seed: seen.append((n, seed)) or [row])
        assert page.main(["truth", "--per-mille", "100", "--output", str(tmp_path)]) == code
        ((per_mille, seed),) = seen
        assert per_mille == 100
        assert f"seed {seed}" in capsys.readouterr().out
        text = (tmp_path / "truth.md").read_text(encoding="utf-8")
        assert f"truth --per-mille 100 --seed {seed}" in text
        assert columns(text)["tried"] == ["1", "1"]
