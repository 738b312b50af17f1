"""Stability of many modes, of planes, and over configurations."""

import csv
import dataclasses
import math

import numpy as np
import pytest
from letters import oscillator
from spread import spread

from fvi_cli.config import parse_config
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.stability.determinants import LinearSystems, step_determinants
from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.integrator.stability.region import GROWTH_LEVELS, stability_map
from fvi_cli.mathematics.zeros import count_zeros
from fvi_cli.reports import rendered
from fvi_cli.reports.kinds.stability import COLUMNS, stability_report
from fvi_cli.runner.studies import stability
from fvi_cli.studies.stability_study import distinct_regions

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


def plane_determinants(method, order, stiffness, damping):
    forms = np.stack([np.ones_like(stiffness), stiffness, damping], axis=1)[..., None, None]
    return step_determinants(LinearSystems(orders=(order,), forms=forms), method, 1.0)


@pytest.mark.few(3)
@pytest.mark.parametrize("method", PLANE_METHODS, ids=lambda method: method.case)
def test_a_map_says_what_the_determinants_say_one_by_one(method):
    stiffness, damping = np.geomspace(1e-2, 1e5, 4), np.geomspace(1e-3, 1e3, 3)
    for order in (0.4, 1.6):
        found = stability_map(method, order, stiffness, damping)
        for row, mu in enumerate(damping):
            for column, k in enumerate(stiffness):
                radii = [math.exp(-growth) for growth in GROWTH_LEVELS]
                alone = plane_determinants(method, order, np.array([k]), np.array([mu]))
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
    assert together.growth_per_step >= (1 - 1e-6) * max(one.growth_per_step for one in alone)
    assert together.verdict == "unstable"
    if method.degree == 1:
        worst = max(one.growth_per_step for one in alone)
        assert together.growth_per_step == pytest.approx(worst, rel=1e-6)


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
        assert "100 coupled components" in unknown.reason
    (term,) = scene.damping
    fed = dataclasses.replace(
        scene, damping=(FractionalDamping(order=term.order, coefficient=-term.coefficient),)
    )
    assert predict_stability(fed, GAUSS, 100).verdict == "unknown"


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


def test_a_ladder_and_its_regions():
    (table,) = stability(parse_config(STUDY, "quick.yaml"))
    verdicts = [row.prediction.verdict for row in table.rows]
    assert verdicts == ["stable", "stable", "unstable", "unstable"]
    maps = table.regions
    assert [(one.method.case.split("-")[0], one.order) for one in maps] == [
        ("bdf2", 0.5),
        ("bdf6", 0.5),
        ("bdf2", 1.5),
        ("bdf6", 1.5),
    ]


def test_methods_that_differ_in_start_have_one_region():
    methods = [
        dataclasses.replace(GAUSS, start="graded"),
        GAUSS,
        NODES,
        Baseline(name="product-integration"),
    ]
    assert distinct_regions(methods) == [methods[0], NODES]


def test_tables_hold_every_row():
    (table,) = stability(parse_config(STUDY, "quick.yaml"))
    texts = rendered(stability_report("quick", [table]))
    lines = texts["quick-stability.csv"].splitlines()
    assert lines[0] == ",".join(["experiment", *(column.name for column in COLUMNS)])
    assert len(lines) == 5
    found = csv.DictReader(lines)
    assert [row["predicted"] for row in found] == [row.prediction.verdict for row in table.rows]


def test_a_table_says_why_a_verdict_is_unknown():
    text = STUDY.replace("kind: bagley-torvik", "kind: pendulum")
    (table,) = stability(parse_config(text, "quick.yaml"))
    lines = rendered(stability_report("quick", [table]))["quick-stability.md"].splitlines()
    assert lines.count("- unknown: the scene is nonlinear") == 1
