"""Stability: zeros in a disc, determinants of steps, known facts of the methods, and maps."""

import dataclasses
import math

import numpy as np
import pytest
from letters import oscillator, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.stability.determinants import (
    LinearSystems,
    step_determinants,
)
from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.integrator.stability.region import GROWTH_LEVELS, stability_map
from fvi_cli.mathematics import zeros
from fvi_cli.mathematics.zeros import (
    count_zeros,
)


def nodes(p, degree=1):
    return Method(cq=f"bdf{p}", degree=degree, sampling="nodes")


def points(p, degree=1):
    return Method(cq=f"bdf{p}", degree=degree, sampling="points")


def coupled(seed):
    """A system of 2 to 6 components with viscous damping, and a number of steps of a length."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 7))

    def form(least, most):
        rotation = np.linalg.qr(rng.normal(size=(d, d)))[0]
        sizes = np.exp(rng.uniform(math.log(least), math.log(most), d))
        return rotation @ np.diag(sizes) @ rotation.T

    forms = np.stack([form(0.5, 2.0), form(0.2, 30.0), form(0.01, 1.0)])
    n_steps = int(np.exp(rng.uniform(math.log(30), math.log(3000))))
    return forms, n_steps, float(rng.uniform(1.0, 20.0)) / n_steps


def wrongly_counted(seeds):
    """Those whose growing modes by explicit Euler are not so many as its eigenvalues."""
    found = []
    for seed in seeds:
        forms, n_steps, h = coupled(seed)
        unit, inverse = np.eye(len(forms[0])), np.linalg.inv(forms[0])
        step = np.block(
            [
                [unit, h * unit],
                [-h * inverse @ forms[1], unit - h * inverse @ forms[2]],
            ]
        )
        moduli, radius = 1 / np.abs(np.linalg.eigvals(step)), 1 - 0.1 / n_steps
        if np.abs(moduli - radius).min() > 1e-6 / n_steps:
            system = LinearSystems(orders=(1.0,), forms=forms[None])
            steps = step_determinants(system, Baseline(name="explicit-euler"), h)
            if count_zeros(steps, radius)[0] != np.count_nonzero(moduli < radius):
                found.append(seed)
    return found


# of these, modes close to each other were overlooked or made up with fewer points
CLOSE = (12, 130, 179, 203, 269, 281, 361, 399, 403)


def test_growing_modes_of_coupled_systems_are_the_eigenvalues():
    assert wrongly_counted([*CLOSE, *range(1000, 1040)]) == []


def test_fewer_points_overlook_modes_that_are_close(monkeypatch):
    """The control: one point for each factor of 2 for all zeros together."""
    monkeypatch.setattr(zeros, "PER_FACTOR", math.inf)
    zeros._first_angles.cache_clear()
    assert wrongly_counted(CLOSE)
    zeros._first_angles.cache_clear()


@spread(
    **{"p, bound": [(1, 2.0), (2, 4.0), (3, 20 / 3), (4, 32 / 3), (5, 256 / 15), (6, 416 / 15)]},
    order=[0.4, 1.0, 1.5, 1.8],
)
def test_sawtooth_bound_of_explicit_sampling(p, bound, order):
    # mu h^(2 - gamma) gamma_p(-1)^gamma = 4 puts a mode at z = -1: the bound is a formula
    critical = (4 / bound**order) ** (1 / (2 - order))
    n = 4000
    for factor, verdict in ((0.95, "stable"), (1.05, "unstable")):
        scene = oscillator(n * critical * factor, stiffness=0.0, damping=((order, 1.0),))
        assert predict_stability(scene, nodes(p), n).verdict == verdict


@spread(p=[1, 2], order=[0.05, 0.5, 1.0, 1.3, 1.95])
def test_degree_one_at_the_points_is_stable_for_a_stable_formula(p, order):
    for stiffness in (1e-2, 1.0, 1e4, 1e8):
        for mu in (1e-2, 1.0, 1e4):
            scene = oscillator(500.0, stiffness=stiffness, damping=((order, mu),))
            prediction = predict_stability(scene, points(p), 500)
            assert prediction.verdict == "stable"
            assert prediction.growth_per_step == 0.0
    # the control: a formula that is not A-stable
    scene = oscillator(500.0, stiffness=100.0, damping=((1.5, 10.0),))
    assert predict_stability(scene, points(6), 500).verdict == "unstable"


@pytest.mark.parametrize(("stiffness", "damping"), [(1.0, ((0.5, -0.3),)), (-1.0, ((0.5, 0.5),))])
def test_nothing_is_said_of_scenes_with_a_source_of_energy(stiffness, damping):
    scene = oscillator(30.0, stiffness=stiffness, damping=damping)
    for method in (Method(cq="gauss", degree=3), points(2, 2), nodes(2)):
        prediction = predict_stability(scene, method, 3000)
        assert (prediction.verdict, prediction.growth_per_step) == ("unknown", 0.0)
        assert "source of energy" in prediction.reason


@pytest.mark.parametrize(
    ("name", "growth"), [("explicit-euler", 0.5 * math.log(1 + 0.01)), ("implicit-euler", 0.0)]
)
def test_baselines_by_a_formula(name, growth):
    scene = oscillator(1000.0, damping=())
    prediction = predict_stability(scene, Baseline(name=name), 10000)
    assert prediction.growth_per_step == pytest.approx(growth, rel=1e-6, abs=1e-12)
    assert prediction.verdict == ("unstable" if growth else "stable")


def test_undamped_modes_do_not_grow():
    for method in (Method(cq="gauss", degree=2), points(3, 2), nodes(1)):
        prediction = predict_stability(oscillator(100.0, damping=()), method, 1000)
        assert (prediction.verdict, prediction.growth_per_step) == ("stable", 0.0)


def test_units_do_not_matter():
    one = predict_stability(oscillator(10.0), nodes(6), 100)
    time, mass = 1e-9, 1e7
    other = oscillator(
        10.0 * time,
        mass=mass,
        stiffness=mass / time**2,
        damping=((1.5, mass / time**2 * time**1.5),),
    )
    two = predict_stability(other, nodes(6), 100)
    assert one.verdict == two.verdict
    assert two.growth_per_step == pytest.approx(one.growth_per_step, rel=1e-9)


def test_nothing_is_said_of_nonlinear_scenes():
    prediction = predict_stability(swing((1.5, np.eye(1)), T=100.0, x=0.0), nodes(6), 1000)
    assert (prediction.verdict, prediction.reason) == ("unknown", "the scene is nonlinear")


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
    n, n_steps = 120, 400
    scene = chain(n, ends_only=False)
    together = predict_stability(scene, method, n_steps)
    eigenvalues = 2 - 2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))
    alone = [
        predict_stability(
            oscillator(200.0, stiffness=50 * value, damping=((0.5, value),)), method, n_steps
        )
        for value in eigenvalues[:: 1 if method.degree == 1 else 20]
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
    # controls: methods that may gain energy, and a scene that is fed
    for method in (NODES, Method(cq="bdf3", degree=1), Method(cq="bdf2", degree=2)):
        unknown = predict_stability(scene, method, 100)
        assert unknown.verdict == "unknown"
        assert "100 coupled components" in unknown.reason
    (term,) = scene.damping
    fed = dataclasses.replace(
        scene, damping=(FractionalDamping(order=term.order, coefficient=-term.matrix),)
    )
    assert predict_stability(fed, GAUSS, 100).verdict == "unknown"
