"""Measured costs: what is counted, that set-up is cold, what is stored and what is refused."""

import csv
import io
import math

import pytest
from command_line import LADDER

from fvi_cli.config import parse_config
from fvi_cli.effects import inertia
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.quadrature import gauss_rule
from fvi_cli.plotting.ladders.cost import cost_figure
from fvi_cli.reports import rendered
from fvi_cli.reports.kinds.cost import cost_report
from fvi_cli.studies import cost
from fvi_cli.studies.cost import (
    clear_caches,
    cost_table,
    measure_cost,
    timed_run,
    traced_peak_bytes,
)
from fvi_cli.studies.experiment import Experiment

TEXT = (
    LADDER.replace("quick", "small").partition("method")[0]
    + """\
method:
  - {rk: gauss, degree: 2}
  - {baseline: gruenwald-letnikov}
ladder: {steps: [8, 16, 32]}
"""
)


def experiment(text: str = TEXT) -> Experiment:
    (found,) = parse_config(text, "small.yaml").experiments
    return found


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(cost, "ENOUGH_SECONDS", 0.0)
    monkeypatch.setattr(cost, "SEARCHES", 1)


def test_every_run_is_measured_and_counted():
    one = experiment()
    stored = []
    table = cost_table(one, [measure_cost(run, stored.append) for run in one.runs()])
    assert [finished.run.n_steps for finished in stored] == [8, 16, 32, 8, 16, 32]
    assert [case.method.case for case in table.cases] == ["gauss-s2-graded", "gruenwald-letnikov"]
    assert table.gamma == "1.5"
    for case in table.cases:
        for row in case.rows:
            trajectory = integrate(one.problem.scene, case.method, row.n_steps)
            assert row.history_operations == trajectory.history_operations > 0
            assert row.newton_iterations == trajectory.newton.iterations
            assert row.repeats == cost.LEAST_REPEATS
            assert 0 < row.setup_seconds < row.seconds
            assert row.stepping_seconds_min <= row.stepping_seconds_median
            assert row.storage_seconds > 0
            assert row.spread >= 0
            assert row.peak_memory_bytes > 8 * row.n_steps
            assert row.status == "ok"
    errors = [row.error for row in table.cases[0].rows]
    assert errors == sorted(errors, reverse=True)


def test_long_runs_are_timed_once(monkeypatch):
    monkeypatch.setattr(cost, "LONG_SECONDS", 0.0)
    row = measure_cost(experiment().runs()[0])
    assert row.repeats == 1
    assert math.isnan(row.spread)
    assert math.isnan(row.storage_seconds)


def test_every_timed_run_begins_cold():
    gauss_rule(3)
    assert gauss_rule.cache_info().currsize > 0
    clear_caches()
    assert gauss_rule.cache_info().currsize == 0
    seen = []

    def action() -> Trajectory:
        seen.append(gauss_rule.cache_info().currsize)
        problem = experiment().problem
        return integrate(problem.scene, Method(cq="gauss", degree=2), 4)

    for _ in range(2):
        wall, stepping = timed_run(action)
        assert wall > stepping > 0
    assert seen == [0, 0]


def test_the_peak_is_that_of_the_run():
    assert 8e6 < traced_peak_bytes(lambda: bytearray(8_000_000)) < 9e6


def test_what_is_refused_has_a_row_without_times():
    text = TEXT.replace("{rk: gauss, degree: 2}", "{bdf: 6, sampling: nodes}")
    row = measure_cost(experiment(text).runs()[0])
    assert row.status == "refused"
    assert row.repeats == row.peak_memory_bytes == 0
    assert math.isnan(row.seconds)
    assert not row.is_usable


def test_steps_without_a_solution_have_a_row_that_is_not_used():
    text = """\
name: singular
problem: {kind: bagley-torvik, stiffness: -1.0, initial: {position: 1.0}, final_time: 2.0}
method: {rk: gauss, degree: 1}
ladder: {steps: [1, 2]}
allow_unstable: true
"""
    singular, solved = (measure_cost(run) for run in experiment(text).runs())
    assert (singular.status, singular.is_usable) == ("failed", False)
    assert (solved.status, solved.repeats > 0) == ("ok", True)


def test_what_a_tolerance_comes_to_is_measured_beside_the_ladder():
    one = experiment()
    rows = [cost.measure_tolerance(one.runs()[2], tolerance) for tolerance in (1e-4, 1e-9)]
    table = cost_table(one, list(map(measure_cost, one.runs())), rows)
    assert [row.outcome for row in table.by_tolerance] == ["met", "met"]
    for row in rows:
        assert 0 <= row.error <= row.tolerance
        assert 0 < row.estimate <= row.tolerance
        assert 0 < row.seconds < math.inf
        assert row.n_steps >= 1
    sheet = rendered(cost_report("small", [table]))["small-cost-tolerances.csv"]
    lines = list(csv.DictReader(io.StringIO(sheet)))
    assert [float(line["tolerance"]) for line in lines] == [1e-4, 1e-9]
    figure = cost_figure(table)
    (drawn,) = (line for line in figure.axes[0].lines if line.get_label() == "for a tolerance")
    assert len(drawn.get_xdata()) == 2


def test_ladders_alone_have_no_file_of_tolerances():
    one = experiment()
    names = rendered(cost_report("small", [cost_table(one, list(map(measure_cost, one.runs())))]))
    assert not [name for name in names if "tolerance" in name]


LAWS = {
    "zener": "{law: zener, order: 0.6, time: 0.5, relaxed: 1.0, unrelaxed: 3.0}",
    "springpot": "{order: 0.6, coefficient: 0.5}",
    "dashpot": "{order: 1.0, coefficient: 0.5}",
}


@pytest.mark.few(1)
@pytest.mark.parametrize("damping", LAWS)
def test_a_law_has_a_memory_and_a_dashpot_has_none(damping):
    text = (
        "name: small\nproblem: {kind: structure, mass: [[2.0]], stiffness: [[1.0]], "
        f"damping: [{LAWS[damping]}], initial: {{position: [1.0]}}, final_time: 2.0}}\n"
        "method: {rk: gauss, degree: 2}\nladder: {steps: [16]}\n"
    )
    one = experiment(text)
    assert cost_table(one, list(map(measure_cost, one.runs()))).has_memory == (damping != "dashpot")


def test_every_timed_run_factorises_its_matrices(monkeypatch):
    text = (
        "name: small\nproblem: {kind: structure, mass: [[2.0, 0.5], [0.5, 1.0]], "
        "stiffness: [[2.0, -1.0], [-1.0, 2.0]], initial: {velocity: [1.0, 0.0]}, "
        "damping: [{order: 0.5, coefficient: 0.1}], final_time: 2.0}\n"
        "method: {rk: gauss, degree: 2}\nladder: {steps: [16]}\n"
    )
    (run,) = experiment(text).runs()
    factorised = []
    solver = inertia.solver
    monkeypatch.setattr(inertia, "solver", lambda form: factorised.append(form) or solver(form))
    row = measure_cost(run)
    assert len(factorised) >= row.repeats >= 5
