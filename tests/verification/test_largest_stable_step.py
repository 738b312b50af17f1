"""No step below the largest stable one grows: random scenes, all backward differences and rules."""

import math

import numpy as np
import pytest
from letters import spring
from oracles.stability import LARGEST_FACTOR, STEPS, Oscillator, Steps, grows, run
from spread import few_of

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method, RuleSpecification
from fvi_cli.integrator.stability import limits
from fvi_cli.integrator.stability.limits import SPACING, largest_stable_step
from fvi_cli.integrator.stability.prediction import predict_stability

WINDOWS = [
    (Oscillator(stiffness=1.5, order=1.55, coefficient=0.008),
     Steps(bdf=5, at_nodes=False, degree=1, rule="gauss", points=1), 1.6, 2.5),
    (Oscillator(stiffness=7.01, order=0.265, coefficient=0.0188),
     Steps(bdf=3, at_nodes=False, degree=3, rule="lobatto", points=4), 1.185, 2.26),
]  # fmt: skip


def drawn(seed: int) -> tuple[Oscillator, Steps, float]:
    """A scene, a method, and the largest step that is looked at; methods take turns."""
    rng = np.random.default_rng(seed)
    degree = int(rng.integers(1, 4))
    rule = ("gauss", "lobatto")[seed // 12 % 2]
    steps = Steps(
        bdf=1 + seed % 6,
        at_nodes=seed // 6 % 2 == 0,
        degree=degree,
        rule=rule,
        points=degree + (rule == "lobatto") + int(rng.integers(0, 2)),
    )
    order, unit = rng.uniform(0.05, 1.95), 10.0 ** rng.uniform(-3, 3)
    scene = Oscillator(
        stiffness=unit**2 * rng.uniform(0.1, 10),
        order=order,
        coefficient=10.0 ** rng.uniform(-3, 1) * unit ** (2 - order),
    )
    return scene, steps, 10.0 ** rng.uniform(0, 1) / unit


def method_of(steps: Steps) -> Method:
    return Method(
        cq=f"bdf{steps.bdf}",
        degree=steps.degree,
        sampling="nodes" if steps.at_nodes else "points",
        quadrature=RuleSpecification(rule=steps.rule, points=steps.points),
    )


def claimed_limit(scene: Oscillator, steps: Steps, largest: float) -> float:
    """The largest step, up to one, from which on runs of 20,000 steps are said to be stable."""
    own = spring((scene.order, scene.coefficient), T=STEPS * largest, m=1.0, k=scene.stiffness)
    return largest_stable_step(own, method_of(steps), fewest=STEPS) or 0.0


def growing_steps(seed: int, number: int) -> list[float]:
    """Steps below the claimed limit at which a run grows after all."""
    scene, steps, largest = drawn(seed)
    limit = claimed_limit(scene, steps, largest)
    if not limit:
        return []
    rng = np.random.default_rng(seed)
    parts = np.concatenate([rng.uniform(0.1, 1, number), 10 ** rng.uniform(-3, 0, number // 4)])
    return [h for h in (limit * parts).tolist() if grows(scene, steps, h, STEPS * largest / h)]


# every formula once in a block; 300 scenes in all
@few_of(1, 50, "block")
def test_no_step_below_the_largest_stable_one_grows(block, request):
    number = 80 if request.node.get_closest_marker("slow") else 12
    found = {seed: growing_steps(seed, number) for seed in range(6 * block, 6 * block + 6)}
    assert not {seed: steps for seed, steps in found.items() if steps}


def growth_of_a_run(scene: Oscillator, steps: Steps, h: float) -> float:
    """The largest position of the last quarter of a run over that of its first quarter."""
    own = spring(
        (scene.order, scene.coefficient), T=STEPS * h, m=1.0, k=scene.stiffness, x=1.0, v=0.0
    )
    x = np.abs(integrate(own, method_of(steps), STEPS).position[:, 0])
    # fewer where a run that blows up was given up
    return float(x[-x.size // 4 :].max() / x[: x.size // 4].max())


@few_of(1, 50, "block")
def test_runs_of_claimed_steps_do_not_grow(block):
    found = {}
    for seed in range(6 * block, 6 * block + 6):
        scene, steps, largest = drawn(seed)
        limit = claimed_limit(scene, steps, largest)
        parts = [1.0, *np.random.default_rng(seed).uniform(0.3, 1.0, 2).tolist()]
        growth = [growth_of_a_run(scene, steps, limit * part) for part in parts if limit]
        found |= {seed: growth} if growth and not max(growth) < LARGEST_FACTOR else {}
    assert not found


def test_a_run_inside_a_window_grows():
    # the control; the other window's mode grows from round-off: only its roots show it
    scene, steps, growing, _ = WINDOWS[0]
    assert not growth_of_a_run(scene, steps, growing) < LARGEST_FACTOR


@pytest.mark.parametrize(("scene", "steps", "growing", "largest"), WINDOWS)
def test_windows_of_instability_are_not_jumped_over(scene, steps, growing, largest, monkeypatch):
    assert grows(scene, steps, growing)
    assert claimed_limit(scene, steps, largest) < growing
    # the control: halves of one step alone
    halves = np.array([STEPS * 2**k for k in range(12)])
    monkeypatch.setattr(limits, "numbers_of_steps", lambda *_, **__: halves)
    assert claimed_limit(scene, steps, largest) > growing


def test_a_claimed_limit_is_where_growth_begins():
    # not only safe: a little above the limit something grows
    checked = 0
    for seed in range(12):
        scene, steps, largest = drawn(seed)
        limit = claimed_limit(scene, steps, largest)
        if 0 < limit < 0.99 * largest:
            checked += 1
            wider = limit * np.linspace(1.0, 1.0 + 4 * SPACING, 9)
            assert any(grows(scene, steps, h, STEPS * largest / h) for h in wider.tolist()), seed
    assert checked >= 3


@pytest.mark.parametrize(("scene", "steps", "growing"), [one[:3] for one in WINDOWS])
def test_three_routes_to_growth_agree(scene, steps, growing):
    # roots, the convolution written out, and the engine
    method = method_of(steps)
    data = {"m": 1.0, "k": scene.stiffness, "x": 1.0, "v": 0.0}
    own = spring((scene.order, scene.coefficient), T=STEPS * growing, **data)
    expected = predict_stability(own, method, STEPS).growth_per_step
    # so that all stay below where a run is given up
    n = int(14 / expected)
    own = spring((scene.order, scene.coefficient), T=n * growing, **data)
    mine, engine = run(scene, steps, growing, n), integrate(own, method, n).position[:, 0]
    early = slice(0, 40)
    assert np.abs(mine[early] - engine[early]).max() < 1e-9
    rates = [
        math.log(np.abs(x[-n // 4 :]).max() / np.abs(x[: n // 4]).max()) / (0.75 * n)
        for x in (mine, engine)
    ]
    assert rates == pytest.approx([expected, expected], rel=0.2)
    assert expected * STEPS > math.log(LARGEST_FACTOR)
