"""Order fits on errors that are known."""

import math

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.registry import build_problem
from fvi_cli.studies.experiment import Experiment, FinishedRun, Observed
from fvi_cli.studies.norms import error_norm
from fvi_cli.studies.order import order_table
from fvi_cli.studies.reference import Reference
from fvi_cli.studies.study import assessed, execute, prediction_of

SPECIFICATION = {
    "kind": "bagley-torvik",
    "damping": [{"order": 0.5, "coefficient": 1.0}],
    "forcing": "6*t + 6/gamma(3.5)*t**2.5 + t**3",
    "final_time": 1.0,
    "exact": "t**3",
}
METHOD = Method(cq="bdf2", degree=1, sampling="nodes")


def experiment(steps: tuple[int, ...] = (4, 8, 16, 32), **keywords: object) -> Experiment:
    values = {
        "name": "sample",
        "problem": build_problem(SPECIFICATION),
        "problem_specification": SPECIFICATION,
        "methods": (METHOD,),
        "steps": steps,
        **keywords,
    }
    return Experiment(**values)


def made_up(errors: list[float], statuses: list[Observed] | None = None) -> list[FinishedRun]:
    own = experiment(tuple(4 * 2**j for j in range(len(errors))))
    trajectory = Trajectory(time=np.zeros(1), position=np.zeros((1, 1)), n_steps=4, step_size=0.25)
    return [
        FinishedRun(run=run, trajectory=trajectory, error=e, floor=1e-14, status=s)
        for run, e, s in zip(own.runs(), errors, statuses or ["ok"] * len(errors), strict=True)
    ]


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 6.0])
def test_slope_of_a_pure_power_is_its_order(order):
    runs = made_up([0.3 * 2.0 ** (-order * j) for j in range(5)])
    (case,) = order_table(runs[0].run.experiment, runs).cases
    assert case.slope == pytest.approx(order, abs=1e-12)
    pairs = [case.pairwise_order(index) for index in range(len(case.rows))]
    assert math.isnan(pairs[0])
    assert pairs[1:] == pytest.approx([order] * 4, abs=1e-12)


def test_only_observed_trouble_leaves_the_fit_and_no_row_is_dropped():
    statuses: list[Observed] = ["diverged", "ok", "failed", "ok", "refused", "ok", "floor"]
    errors = [1e30, 1 / 4, math.nan, 1 / 64, math.nan, 1 / 1024, 1e-16]
    runs = made_up(errors, statuses)
    (case,) = order_table(runs[0].run.experiment, runs).cases
    assert [row.status for row in case.rows] == statuses
    assert [row.used_in_fit for row in case.rows] == [s == "ok" for s in statuses]
    assert case.slope == pytest.approx(2, abs=1e-12)
    # no two of the used rows are neighbours
    assert all(math.isnan(case.pairwise_order(index)) for index in range(len(runs)))


def test_norms():
    position = np.array([[0.0, 0.0], [1.0, -3.0], [0.5, 1.0]])
    exact = np.zeros((3, 2))
    assert error_norm(position, exact, 0.5, "max") == 3.0
    assert error_norm(position, exact, 0.5, "final") == 1.0
    assert error_norm(position, exact, 0.5, "l2") == pytest.approx(np.sqrt(0.5 * 11.25))
    # scales that overflow when squared
    assert error_norm(1e200 * position, exact, 0.5, "l2") == pytest.approx(
        1e200 * np.sqrt(0.5 * 11.25)
    )
    assert math.isnan(error_norm(np.array([[np.nan]]), np.zeros((1, 1)), 1.0, "max"))
    with pytest.raises(ValueError, match="shapes differ"):
        error_norm(position, exact[:2], 0.5, "max")
    with pytest.raises(ValueError, match="not one of max, final, l2"):
        error_norm(position, exact, 0.5, "mean")


def test_runs_are_in_order_and_have_their_orders():
    own = experiment(methods=(METHOD, Baseline(name="implicit-euler")))
    first = list(map(execute, own.runs()))
    assert [(r.run.method.case, r.run.n_steps) for r in first] == [
        (m.case, n) for m in own.methods for n in own.steps
    ]
    table = order_table(own, first)
    assert table.cases[0].slope == pytest.approx(2, abs=0.1)
    assert table.cases[1].slope == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("sweep", [{}, {"sweep": {"problem.stiffness": [1.0, 4.0]}}])
def test_a_study_of_a_tolerance_yields_what_its_searches_come_to(sweep):
    config = fvi.load(
        {
            "name": "asked",
            "problem": {
                "kind": "damped-oscillator",
                "damping": [{"order": 0.5, "coefficient": 0.2}],
                "initial": {"position": 1.0},
                "final_time": 3.0,
            },
            "accuracy": {"tolerance": 1e-6},
            **sweep,
        }
    )
    (one,) = config.experiments
    found = list(map(execute, one.runs()))
    assert len(found) == len(one.members or [None])
    assert all(each.status == "ok" and 0 < each.error <= 1e-6 for each in found)
    (outcome,) = fvi.run(config)
    assert [each.error for each in outcome.finished] == [each.error for each in found]


def test_claims_and_expected_failures_are_looked_up_by_case_or_its_beginning():
    own = experiment(claims={"bdf2": 1.9}, expect={"bdf2-nodes-s1": "unstable"})
    assert own.claim(METHOD) == 1.9
    assert own.expects_failure(METHOD)
    other = Method(cq="bdf3", degree=1, sampling="nodes")
    assert math.isnan(own.claim(other))
    assert not own.expects_failure(other)


def pendulum(**keywords: object) -> dict[str, object]:
    return {
        "kind": "pendulum",
        "damping": [{"order": 0.5, "coefficient": 0.3}],
        "initial": {"position": 1.0, "velocity": 0.0},
        "final_time": 4.0,
        **keywords,
    }


def test_a_reference_that_fails_costs_the_errors_but_not_the_runs():
    """Negative damping that blows up before the end: runs are kept, their errors are unknown."""
    specification = pendulum(
        damping=[{"order": 1.5, "coefficient": -60.0}], final_time=40.0, omega=3.0
    )
    own = Experiment(
        name="runaway",
        problem=build_problem(specification),
        problem_specification=specification,
        methods=(Method(cq="gauss", degree=1),),
        steps=(4, 8),
    )
    runs = list(map(execute, own.runs()))
    assert len(runs) == 2
    assert all(math.isnan(run.error) and "reference run" in run.reference for run in runs)
    assert all(not row.used_in_fit for row in order_table(own, runs).cases[0].rows)


@pytest.mark.parametrize(("error", "is_poor"), [(2.6, True), (1e-9, False)])
def test_errors_below_that_of_the_reference_are_at_its_floor(error, is_poor):
    run = experiment(steps=(8,)).runs()[0]
    trajectory = execute(run).trajectory
    reference = Reference(
        values=lambda times: times[:, None] ** 3, error=error, source="reference run"
    )
    finished = assessed(run, trajectory, prediction_of(run), reference)
    assert finished.status == ("floor" if is_poor else "ok")
