"""Stability of many modes, of planes, of long growth, along paths, and over configurations."""

import dataclasses
import json
import math

import numpy as np
import pytest
from letters import oscillator
from spread import spread

from fvi_cli.config import parse_config
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.stability.determinants import plane_determinants, step_determinants
from fvi_cli.integrator.stability.linearisation import linearised_along
from fvi_cli.integrator.stability.prediction import predict_stability, stability_along
from fvi_cli.integrator.stability.region import GROWTH_LEVELS, stability_map
from fvi_cli.integrator.stability.systems import MatrixPencil
from fvi_cli.mathematics.transforms.zeros import count_zeros
from fvi_cli.reports import rendered
from fvi_cli.reports.kinds.stability import COLUMNS, stability_report
from fvi_cli.studies.stability_study import (
    StabilityTable,
    distinct_regions,
    observe_growth,
    stability_maps,
    stability_rows,
)
from fvi_cli.studies.study import execute

GAUSS = Method(cq="gauss", degree=2)
NODES = Method(cq="bdf6", degree=1, sampling="nodes")


PLANE_METHODS = (
    NODES,
    Method(cq="bdf4", degree=2),
    Method(cq="bdf3", degree=3),
    Method(cq="lobatto-iiic", degree=2),
    Method(cq="lobatto-iiic", degree=3),
    GAUSS,
    Baseline(name="explicit-euler"),
    Baseline(name="gruenwald-letnikov"),
)


@pytest.mark.few(3)
@pytest.mark.parametrize("method", PLANE_METHODS, ids=lambda method: method.case)
def test_a_map_says_what_the_determinants_say_one_by_one(method):
    stiffness, damping = np.geomspace(1e-2, 1e5, 4), np.geomspace(1e-3, 1e3, 3)
    for order in (0.4, 1.6):
        found = stability_map(method, order, stiffness, damping)
        for row, mu in enumerate(damping):
            for column, k in enumerate(stiffness):
                system = MatrixPencil(
                    mass=np.eye(1), stiffness=np.array([[k]]), damping=((order, np.array([[mu]])),)
                )
                radii = [math.exp(-growth) for growth in GROWTH_LEVELS]
                alone = step_determinants([system], method, 1.0)
                counts = [count_zeros(alone, one)[0] for one in radii]
                level = next((n for n, count in enumerate(counts) if not count), len(counts))
                assert found.level[row, column] == level, (order, k, mu)
    assert found.share_stable == (1.0 if method is GAUSS else pytest.approx(0.5, abs=0.45))


@spread(few=1, p=[4, 5, 6], degree=[1, 2, 3], order=[0.3, 1.5, 1.9], growth=[1e-3, 1e-2, 0.1])
def test_counts_do_not_depend_on_where_the_points_begin(p, degree, order, growth):
    """Modes come in pairs beside the circle; the control begins with too few points."""
    random = np.random.default_rng(int(100 * order) + 10 * p + degree)
    plane = plane_determinants(
        Method(cq=f"bdf{p}", degree=degree, sampling="points"),
        order,
        10.0 ** random.uniform(-2, 4, 300),
        10.0 ** random.uniform(-3, 3, 300),
    )
    radius = math.exp(-growth)
    dense = dataclasses.replace(plane, degree=4 * plane.degree)
    assert np.array_equal(count_zeros(plane, radius), count_zeros(dense, radius))


def test_a_turn_beside_a_fast_change_is_counted():
    """Three zeros outside at 1.57 rad: half an interval turns by 6 and seems to turn by 0.3."""
    stiffness, damping = np.full(41, 5841.28), 929.889 * np.linspace(0.98, 1.02, 41)
    method = Method(cq="bdf4", degree=3, sampling="points")
    plane = plane_determinants(method, 1.9, stiffness, damping)
    dense = dataclasses.replace(plane, degree=16 * plane.degree)
    radius = math.exp(-0.1)
    assert np.array_equal(count_zeros(plane, radius), count_zeros(dense, radius))


def test_too_few_points_to_begin_with_would_be_noticed():
    random = np.random.default_rng(6)
    stiffness, damping = 10.0 ** random.uniform(-2, 4, 4000), 10.0 ** random.uniform(-3, 3, 4000)
    plane = plane_determinants(Method(cq="bdf6", degree=2), 1.5, stiffness, damping)
    few = dataclasses.replace(plane, degree=1)
    assert np.any(count_zeros(plane, math.exp(-0.1)) != count_zeros(few, math.exp(-0.1)))


def test_the_border_of_a_map_is_the_sawtooth_bound():
    # mu h^(2 - gamma) gamma_6(-1)^gamma = 4 at little stiffness
    damping = np.geomspace(1e-3, 1.0, 301)
    found = stability_map(NODES, 1.5, np.array([1e-4]), damping)
    border = damping[int((found.level[:, 0] == 0).sum())]
    assert border == pytest.approx(4 / (416 / 15) ** 1.5, rel=0.03)
    with pytest.raises(ValueError, match="stiffness: values must increase"):
        stability_map(NODES, 1.5, np.array([2.0, 1.0]), damping)


def chain(n, *, ends_only):
    stiffness = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    coupling = np.zeros((n, n))
    coupling[0, 0] += 1.0
    return oscillator(
        200.0,
        mass=np.eye(n),
        stiffness=50 * stiffness,
        damping=((0.5, coupling if ends_only else stiffness),),
    )


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "method", [Method(cq="bdf4", degree=2), NODES, Method(cq="lobatto-iiic", degree=2)]
)
def test_long_chains_are_decided_mode_by_mode(method):
    n, n_steps = 400, 400
    scene = chain(n, ends_only=False)
    together = predict_stability(scene, method, n_steps)
    eigenvalues = 2 - 2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))
    alone = [
        predict_stability(
            oscillator(200.0, stiffness=50 * value, damping=((0.5, value),)), method, n_steps
        )
        for value in eigenvalues[:: 1 if method.degree == 1 else 40]
    ]
    assert together.growth_per_step >= max(one.growth_per_step for one in alone) - 1e-9
    assert together.verdict == "unstable"
    if method.degree == 1:
        assert together.growing_modes == sum(one.growing_modes for one in alone)
        worst = max(one.growth_per_step for one in alone)
        assert together.growth_per_step == pytest.approx(worst, rel=1e-9)


def test_large_scenes_without_modes_are_decided_where_that_is_proved():
    scene = chain(100, ends_only=True)
    prediction = predict_stability(scene, GAUSS, 100)
    assert prediction.verdict == "stable"
    assert "no step of the method gains energy" in prediction.reason
    midpoint = Method(cq="bdf2", degree=1)
    assert predict_stability(scene, midpoint, 100).verdict == "stable"
    # controls: methods that may gain energy, and a scene that is fed
    for method in (NODES, Method(cq="bdf3", degree=1), Method(cq="bdf2", degree=2)):
        unknown = predict_stability(scene, method, 100)
        assert unknown.verdict == "unknown"
        assert "cannot be decoupled" in unknown.reason
    (term,) = scene.damping
    fed = dataclasses.replace(
        scene, damping=(FractionalDamping(order=term.order, coefficient=-term.coefficient),)
    )
    assert predict_stability(fed, GAUSS, 100).verdict == "unknown"


@spread(
    method=[GAUSS, Method(cq="gauss", degree=1)],
    **{"order, mu": [(1.0, -1.9), (0.5, -1.6), (1.5, -0.9)]},
)
def test_long_growth_that_is_the_truth_is_not_unstable(method, order, mu):
    # a relative error of the rate of one percent is a factor 1e3 after a growth of e^700
    scene = oscillator(400.0, damping=((order, mu),))
    for n_steps in (400, 800, 3000):
        prediction = predict_stability(scene, method, n_steps)
        assert prediction.verdict == "stable", (n_steps, prediction)
        assert prediction.exact_growth > 0


def test_growth_that_is_not_the_truth_is_unstable_beside_one_that_is():
    # the sawtooth mode of explicit sampling, in a scene that is fed by a term of another order
    scene = oscillator(200.0, damping=((1.5, 1.0), (0.3, -1.2)))
    calm = predict_stability(scene, GAUSS, 200)
    assert calm.exact_growth > 0
    assert calm.verdict == "stable"
    assert predict_stability(scene, NODES, 200).verdict == "unstable"
    # a mode of the right kind, but a rate that is wrong by far more than a quarter
    slow = oscillator(2000.0, damping=((1.0, -0.002),))
    euler = predict_stability(slow, Baseline(name="explicit-euler"), 4000)
    assert 0 < euler.exact_growth < euler.growth_per_step / 1.25
    assert euler.verdict == "unstable"


LIGHTER = """
problem:
  kind: lagrangian
  coordinates: [x]
  lagrangian: (1 + x**2)*vx**2/2 - 5*x**2
  damping: [{order: 1.5, coefficient: 1.0, acts_on: [x]}]
  initial: {position: 3.0, velocity: 0.0}
  final_time: 4.0
method: [{bdf: 6, sampling: nodes}, {rk: gauss, degree: 2, start: none}]
ladder: {steps: [100]}
"""


def test_a_path_that_leads_into_instability_is_warned_about():
    # heavy at the start, ten times lighter, and so more damped, where x = 0
    runs = parse_config(LIGHTER, "lighter.yaml").experiments[0].runs()
    nodes, gauss = (execute(run) for run in runs)
    scene = nodes.run.problem.scene
    assert predict_stability(scene, NODES, 100).linearised_verdict == "stable"
    (remark,) = [r for r in nodes.trajectory.remarks if r.startswith("stability:")]
    assert "linearised on the path at t = " in remark
    assert nodes.predicted == "unknown"
    assert not any(r.startswith("stability:") for r in gauss.trajectory.remarks)
    time, worst = stability_along(scene, NODES, 100, gauss.trajectory)
    assert (worst.verdict, time > 0) == ("unstable", True)


def test_linearisations_lie_between_the_softest_and_the_stiffest():
    text = """
problem: {kind: pendulum, initial: {position: 3.0, velocity: 0.0}, final_time: 10.0}
ladder: {steps: [100]}
"""
    (run,) = parse_config(text, "swing.yaml").experiments[0].runs()
    scene = run.problem.scene
    path = integrate(scene, run.method, 100)
    found = [near.potential.stiffness[0, 0] for _, near in linearised_along(scene, path)]
    assert found == sorted(found)
    assert found[0] == pytest.approx(np.cos(path.position).min(), abs=1e-2)
    assert found[-1] == pytest.approx(np.cos(path.position).max(), abs=1e-2)
    assert linearised_along(oscillator(1.0), path) == []


STUDY = """
name: quick
problem:
  kind: bagley-torvik
  damping: [{order: 1.5, coefficient: 1.0}]
  final_time: 1.0
method: {bdf: [2, 6], sampling: nodes, degree: 1}
ladder: {steps: [16, 256]}
stability:
  region:
    orders: [0.5, 1.5]
    stiffness: {from: 0.01, to: 100, number: 5, spacing: log}
    damping: [0.01, 1.0, 100.0]
"""


def test_what_is_predicted_over_a_ladder_is_observed():
    (experiment,) = parse_config(STUDY, "quick.yaml").experiments
    rows = list(stability_rows(experiment, with_observation=True))
    assert [row.verdict for row in rows] == ["stable", "stable", "unstable", "unstable"]
    assert [row.observation.verdict for row in rows] == [row.verdict for row in rows]
    assert all(row.observation.agrees for row in rows)
    for row in rows[2:]:
        measured = row.observation.growth_per_step
        assert measured == pytest.approx(row.prediction.growth_per_step, rel=1e-2)
    assert rows[0].lasting_step == pytest.approx(0.25, rel=0.01)
    assert rows[2].lasting_step < rows[2].largest_stable_step < 1 / 256
    maps = stability_maps(experiment)
    assert [(one.method.case.split("-")[0], one.order) for one in maps] == [
        ("bdf2", 0.5),
        ("bdf6", 0.5),
        ("bdf2", 1.5),
        ("bdf6", 1.5),
    ]
    assert next(stability_rows(experiment, with_observation=False)).observation is None


def test_a_wrong_prediction_would_be_seen():
    # the control: what BDF6 does is not what is predicted of BDF5
    scene = oscillator(1.0, stiffness=0.1, damping=((1.5, 0.5),))
    n_steps = 140
    other = Method(cq="bdf5", degree=1, sampling="nodes")
    six, five = observe_growth(scene, NODES, n_steps), observe_growth(scene, other, n_steps)
    assert (six.verdict, six.agrees) == ("unstable", True)
    assert dataclasses.replace(six, predicted="stable").agrees is False
    assert five.agrees is True
    assert dataclasses.replace(six, predicted="unknown").agrees is None


def test_true_growth_is_observed_as_stable():
    scene = oscillator(20.0, damping=((1.0, -0.5),))
    seen = observe_growth(scene, GAUSS, 200)
    assert (seen.verdict, seen.agrees) == ("stable", True)
    assert seen.growth_per_step == pytest.approx(0.025, rel=0.02)


def test_methods_that_differ_in_start_have_one_region():
    methods = [
        GAUSS,
        dataclasses.replace(GAUSS, start="graded"),
        NODES,
        Baseline(name="product-integration"),
    ]
    assert distinct_regions(methods) == [GAUSS, NODES]


def test_tables_hold_every_row():
    (experiment,) = parse_config(STUDY, "quick.yaml").experiments
    rows = tuple(stability_rows(experiment, with_observation=False))
    table = StabilityTable(experiment=experiment, rows=rows)
    texts = rendered(stability_report("quick", [table]))
    lines = texts["quick-stability.csv"].splitlines()
    assert lines[0] == ",".join(column.name for column in COLUMNS)
    assert len(lines) == 5
    found = json.loads(texts["quick-stability.json"])["sheets"]["runs"]["rows"]
    assert [row["predicted"] for row in found] == [row.verdict for row in rows]
    assert found[0]["observed_growth_per_step"] is None


@pytest.mark.parametrize(
    ("kind", "is_nonlinear"), [("pendulum", True), ("damped-oscillator", False)]
)
def test_a_nonlinear_scene_is_judged_by_its_linearisation_which_is_said(kind, is_nonlinear):
    text = (
        f"name: a\nproblem: {{kind: {kind}, damping: [{{order: 0.5, coefficient: 0.3}}], "
        "initial: {position: 1.0}, final_time: 6}\nmethod: gauss3\nladder: {steps: [6]}\n"
    )
    (experiment,) = parse_config(text, "a").experiments
    rows = tuple(stability_rows(experiment, with_observation=False))
    table = StabilityTable(experiment=experiment, rows=rows)
    words = rendered(stability_report("a", [table]))["a-stability.md"]
    assert ("linearisation at the start" in words) == is_nonlinear


@pytest.mark.parametrize("method", [Method(cq="gauss", degree=1), Baseline(name="implicit-euler")])
def test_steps_without_a_solution_cannot_be_observed(method):
    """Singular with steps of 2 (midpoint rule) and 1 (implicit Euler) on x'' = x."""
    scene = oscillator(2.0, stiffness=-1.0, damping=())
    singular = 1 if isinstance(method, Method) else 2
    assert observe_growth(scene, method, singular) is None
    assert predict_stability(scene, method, singular).verdict == "unstable"
    seen = observe_growth(scene, method, 8)
    assert seen.agrees
