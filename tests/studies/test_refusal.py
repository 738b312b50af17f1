"""Runs that are predicted to blow up are refused, unless they are wanted; others stop early."""

import math

import numpy as np
import pytest

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.scenes.registry import build_problem
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.order import order_table
from fvi_cli.studies.study import execute, prediction_of, study

NODES = Method(cq="bdf6", degree=1, sampling="nodes")


def experiment(*, kind="bagley-torvik", method=NODES, steps=(4, 256), allow=False, **changes):
    specification = {
        "kind": kind,
        "damping": [{"order": 1.5, "coefficient": 1.0}],
        "initial": {"position": 1.0, "velocity": 0.0},
        "final_time": 1.0,
        **changes,
    }
    return Experiment(
        name="quick",
        problem=build_problem(specification),
        problem_specification=specification,
        methods=(method,),
        steps=steps,
        allow_unstable=allow,
    )


def test_a_run_that_would_blow_up_is_refused_with_advice():
    calm, refused = study(experiment())
    assert (calm.predicted, calm.status) == ("stable", "ok")
    assert (refused.predicted, refused.status) == ("unstable", "refused")
    assert refused.trajectory.status == "refused"
    assert refused.trajectory.position.tolist() == [[1.0]]
    assert math.isnan(refused.error)
    message = refused.trajectory.message
    assert "unstable" in message
    assert "per step" in message
    assert "gauss of degree 1 is stable" in message
    # the step that is named is stable, and a larger one is not
    n_steps = int(message.split("(N = ")[1].split(")")[0])
    scene = refused.run.experiment.problem.scene
    assert predict_stability(scene, NODES, n_steps).verdict == "stable"
    assert predict_stability(scene, NODES, n_steps * 99 // 100).verdict == "unstable"
    # the method that is named runs
    gauss = experiment(method=Method(cq="gauss", degree=1, start="graded"), steps=(256,))
    assert next(study(gauss)).status == "ok"


def test_the_table_keeps_the_row():
    quick = experiment()
    rows = order_table(quick, study(quick)).cases[0].rows
    assert [row.status for row in rows] == ["ok", "refused"]
    assert [row.predicted for row in rows] == ["stable", "unstable"]
    assert [row.used_in_fit for row in rows] == [True, False]
    assert "unstable" in rows[1].message


def test_a_wanted_run_is_computed():
    finished = execute(experiment(allow=True).runs()[1])
    assert (finished.predicted, finished.status) == ("unstable", "diverged")
    assert finished.trajectory.status == "ok"
    assert finished.trajectory.time.size == 257
    assert finished.error > 10 * finished.measured.largest


@pytest.mark.parametrize("n_steps", [600, 6000])
def test_true_growth_is_not_stopped(n_steps):
    # exp(0.1 t) over t = 600: a factor 1e26, and the truth
    negative = experiment(
        method=Method(cq="gauss", degree=3),
        steps=(n_steps,),
        damping=[{"order": 1.0, "coefficient": -0.2}],
        final_time=600.0,
    )
    finished = execute(negative.runs()[0])
    assert (finished.predicted, finished.status) == ("stable", "ok")
    assert np.abs(finished.trajectory.position).max() > 1e24


def test_from_rest_under_a_force():
    forced = experiment(
        initial={"position": 0.0, "velocity": 0.0}, forcing="t**2", allow=True, steps=(256,)
    )
    stopped = execute(forced.runs()[0])
    assert stopped.status == "diverged"
    calm = integrate(forced.problem.scene, Method(cq="gauss", degree=2), 256)
    assert calm.status == "ok"


def test_nonlinear_scenes_are_warned_about_and_computed():
    swinging = experiment(kind="pendulum", steps=(256,))
    run = swinging.runs()[0]
    assert prediction_of(run).linearised_verdict == "unstable"
    finished = execute(run)
    assert finished.predicted == "unknown"
    assert finished.status != "refused"
    assert any("linearised at the start" in remark for remark in finished.trajectory.remarks)
    calm = experiment(kind="pendulum", method=Method(cq="gauss", degree=2), steps=(64,))
    assert not any("linearised" in remark for remark in execute(calm.runs()[0]).trajectory.remarks)


def test_growth_that_is_let_through_is_warned_about():
    # on steps that shrink: refused, let through with a warning, calm
    seen = []
    method = Method(cq="bdf4", degree=1, sampling="nodes")
    for n_steps in (8, 16, 24, 32, 40, 48, 56, 64, 72, 74, 76, 78, 80, 96):
        run = experiment(method=method, steps=(n_steps,)).runs()[0]
        prediction = prediction_of(run)
        factor = np.exp(prediction.growth_per_step * n_steps)
        remarks = [one for one in execute(run).trajectory.remarks if one.startswith("stability")]
        seen.append("refused" if prediction.verdict == "unstable" else "warned" if remarks else "")
        assert seen[-1] == ("refused" if factor > 1e3 else "warned" if factor >= 10 else ""), factor
        if seen[-1] == "warned":
            assert f"over the run by {factor:.4g} more" in remarks[0]
    assert set(seen) == {"refused", "warned", ""}
