"""Measured costs: what is counted, that a time is that of a cold start, and what is refused."""

import math

import pytest
from command_line import LADDER, fvi

from fvi_cli.config import parse_config
from fvi_cli.integrator.integrate import integrate
from fvi_cli.mathematics.quadrature import gauss_rule
from fvi_cli.studies import cost
from fvi_cli.studies.cost import measure_cost
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
FILES = {"small.yaml": TEXT}


def experiment(text: str = TEXT) -> Experiment:
    (found,) = parse_config(text, "small.yaml").experiments
    return found


def test_every_run_is_measured_and_counted():
    one = experiment()
    rows = [measure_cost(run, repeats=3) for run in one.runs()]
    for row in rows:
        run, counted = row.finished.run, row.finished.trajectory
        trajectory = integrate(one.problem.scene, run.method, run.n_steps)
        assert counted.history_operations == trajectory.history_operations > 0
        assert counted.newton_iterations == trajectory.newton_iterations
        assert row.repeats == 3
        assert 0 < row.seconds <= row.median_seconds
        assert row.finished.status == "ok"
    errors = [row.finished.error for row in rows[:3]]
    assert errors == sorted(errors, reverse=True)


def test_every_timed_run_begins_cold(monkeypatch):
    seen = []

    def watched(*arguments):
        seen.append(gauss_rule.cache_info().currsize)
        return integrate(*arguments)

    monkeypatch.setattr(cost, "integrate", watched)
    (run, *_) = experiment().runs()
    measure_cost(run, repeats=2)
    assert gauss_rule.cache_info().currsize > 0
    assert seen == [0, 0]


def test_steps_without_a_solution_have_a_row_that_is_not_used():
    text = """\
name: singular
problem: {kind: bagley-torvik, stiffness: -1.0, initial: {position: 1.0}, final_time: 2.0}
method: {rk: gauss, degree: 1}
ladder: {steps: [1, 2]}
"""
    singular, solved = (measure_cost(run, repeats=2) for run in experiment(text).runs())
    assert (singular.finished.status, singular.is_usable) == ("failed", False)
    assert (solved.finished.status, solved.repeats) == ("ok", 2)
    assert math.isfinite(solved.seconds)


def test_the_command_writes_a_table_and_a_figure(folder):
    done = fvi("cost", "small.yaml", "--repeats", "1", code=0)
    assert "Gauss2" in done.stdout
    written = {str(path.relative_to(folder)) for path in (folder / "results").rglob("*.*")}
    assert {"results/tables/small-cost.csv", "results/tables/small-cost.md"} <= written
    assert "results/figures/small-cost.png" in written
    planned = fvi("cost", "small.yaml", "--dry-run", code=0).stdout
    assert "time Gauss2" in planned


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("sweep={problem.stiffness: [1, 2]}", "leave out sweep"),
        ("accuracy={tolerance: 1e-6}", ""),
        ("problem.exact=none", "exact: none gives no errors"),
    ],
)
def test_what_cannot_be_measured_is_refused(folder, change, reason):
    assert reason in fvi("cost", "small.yaml", "--set", change, code=2).stderr
