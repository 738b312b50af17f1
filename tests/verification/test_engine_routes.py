"""The engine's routes give what one step after the other gives."""

from dataclasses import replace

import numpy as np
import pytest
from letters import spring, swing
from spread import spread

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.equal_steps.problem import StepProblem
from fvi_cli.integrator.equal_steps.routes import run
from fvi_cli.integrator.equal_steps.run import prepare
from fvi_cli.integrator.equal_steps.stepping import run_steps
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method, RuleSpecification

TOLERANCE = 1e-12

LINEAR_METHODS = [
    *(Method(cq=f"bdf{p}", sampling="nodes", degree=1 + p % 2) for p in range(1, 7)),
    *(Method(cq=f"bdf{p}", degree=1 + p % 3) for p in range(1, 7)),
    Method(cq="bdf3", degree=2, quadrature=RuleSpecification(rule="lobatto", points=4)),
]


def difference(problem: StepProblem, other: StepProblem | None = None) -> float:
    """Largest relative difference of positions, momenta and forces between the two routes."""
    direct = run_steps(problem)
    blocks = run(other or problem, "exponentials")
    assert direct.failure == blocks.failure
    assert blocks.position.shape == direct.position.shape
    pairs = [(direct.position, blocks.position), (direct.momentum, blocks.momentum)]
    if problem.skip_first_kick and problem.memory.channels:
        pairs.append((direct.end_force, blocks.end_force))
    return max(float(np.abs(a - b).max() / np.abs(a).max()) for a, b in pairs)


def oscillator(orders: tuple[float, ...], derivative: str, coefficient: float) -> Scene:
    regular = derivative == "caputo" or max(orders) < 1
    return spring(
        *((order, coefficient * (index + 1)) for index, order in enumerate(orders)),
        T=3.0,
        k=2.0,
        x=0.7 if regular else 0.0,
        v=0.4,
        forcing="cos(t)",
        derivative=derivative,
    )


SMALL = 1e-3
"""A coefficient with which all methods are stable on these steps."""


@spread(orders=[(0.3,), (1.0,), (1.5,), (0.5, 1.0), (0.3, 1.5)], method=LINEAR_METHODS)
def test_linear_blocks(method, orders):
    for derivative, n_steps in (("caputo", 333), ("riemann-liouville", 64), ("caputo", 5)):
        scene = oscillator(orders, derivative, SMALL)
        assert difference(prepare(scene, method, n_steps).problem) <= TOLERANCE


def test_many_groups_agree():
    method = Method(cq="bdf3", degree=2)
    scene = oscillator((0.3, 1.5), "caputo", SMALL)
    assert difference(prepare(scene, method, 2500).problem) <= TOLERANCE


def wrong_weight(problem: StepProblem, lag: int) -> StepProblem:
    channel = problem.memory.channels[0]
    weights = channel.weights.copy(order="K")
    weights[lag] *= 1.0 + 1e-3
    memory = replace(problem.memory, channels=(replace(channel, weights=weights),))
    return replace(problem, memory=memory)


@pytest.mark.parametrize("lag", [0, 1, 40])
def test_one_wrong_weight_is_seen(lag):
    for method in (Method(cq="bdf2", degree=2), Method(cq="bdf2", sampling="nodes", degree=1)):
        problem = prepare(oscillator((0.5,), "caputo", 0.5), method, 600).problem
        assert difference(problem) <= TOLERANCE
        assert difference(problem, wrong_weight(problem, lag)) > 100 * TOLERANCE


def positive(rng: np.random.Generator, d: int) -> np.ndarray:
    matrix = rng.normal(size=(d, d))
    return matrix @ matrix.T / d + np.eye(d)


@spread(
    kind=["modal", "general", "uncoupled"],
    method=[Method(cq="bdf2", sampling="nodes", degree=1), Method(cq="bdf3", degree=2)],
)
def test_three_degrees_of_freedom(kind, method):
    rng = np.random.default_rng(5)
    mass, stiffness = positive(rng, 3), positive(rng, 3)
    if kind == "uncoupled":
        mass, stiffness = np.diag(np.diagonal(mass)), np.diag(np.diagonal(stiffness))
    directions = [positive(rng, 3), positive(rng, 3)] if kind == "general" else [mass, stiffness]
    for orders in ((0.5, 1.5), (1.0, 0.3), (1.0, 1.0)):
        scene = spring(
            *((order, 0.01 * matrix) for order, matrix in zip(orders, directions, strict=True)),
            T=3.0,
            m=mass,
            k=stiffness,
            x=[1.0, 0.2, 0.3],
            v=[0.1, 0.2, -0.3],
            forcing=Forcing.from_text("cos(t)", "t", "1"),
        )
        for n_steps in (128, 310):
            assert difference(prepare(scene, method, n_steps).problem) <= TOLERANCE


def test_a_chain_too_large_for_dense_blocks_takes_steps_with_the_fast_history():
    d, n_steps = 300, 260
    stiffness = 2.0 * np.eye(d) - np.eye(d, k=1) - np.eye(d, k=-1)
    mixed = np.diag(1.0 + np.arange(d) / d)
    scene = spring(
        (0.5, 0.1 * mixed), T=2.0, m=np.eye(d), k=stiffness, x=np.sin(np.arange(d)), v=np.zeros(d)
    )
    problem = prepare(scene, Method(cq="bdf2", degree=1), n_steps).problem
    assert difference(problem) <= TOLERANCE


@pytest.mark.parametrize("sampling", ["nodes", "points"])
def test_added_force_and_known_parts(sampling):
    """Starting weights, exact moments, and mixed orders with v0."""
    scene = oscillator((0.5, 1.5), "caputo", 1e-3)
    rng = np.random.default_rng(3)
    method = Method(cq="bdf2", degree=2, sampling=sampling, forcing_quadrature="exact")
    problem = prepare(scene, method, 200).problem
    samples = problem.tables.sample_points.size
    assert problem.memory.known_force is not None
    added = problem.with_force(rng.normal(size=(201, samples, 1)))
    assert difference(added) <= TOLERANCE
    corrected = replace(method, start="weights", history="exponentials")
    both = [
        integrate(scene, replace(corrected, history=h), 200) for h in ("exponentials", "direct")
    ]
    assert np.abs(both[0].position - both[1].position).max() <= TOLERANCE
    assert np.abs(both[0].momentum - both[1].momentum).max() <= TOLERANCE


NONLINEAR_METHODS = [Method(cq="bdf3", degree=2), Method(cq="bdf2", sampling="nodes", degree=1)]


@spread(method=NONLINEAR_METHODS, orders=[(0.5,), (1.0,), (1.5, 0.5)])
def test_newton_on_whole_blocks(method, orders):
    scene = swing(*((order, 0.05) for order in orders), T=20.0, x=1.0, v=0.3, forcing="0.1*cos(t)")
    for n_steps in (12, 90, 300):
        problem = prepare(scene, method, n_steps).problem
        assert difference(problem) <= TOLERANCE
    finished = run(problem, "exponentials").newton
    assert 0 < finished.iterations < n_steps
    assert finished.largest == len(finished.worst_residuals)
    assert finished.worst_residuals[-1] < 1e-9 * finished.worst_residuals[0]


def test_newton_sees_one_wrong_weight():
    scene = swing((0.5, 0.5), T=5.0, x=1.0)
    problem = prepare(scene, Method(cq="bdf2", degree=2), 300).problem
    assert difference(problem, wrong_weight(problem, 50)) > 100 * TOLERANCE


def test_steps_too_long_for_any_block_fall_back_to_single_steps():
    """A stiff pendulum over a few turns per step: the frozen response does not contract."""
    scene = swing((0.5, 0.3), T=20.0, omega=6.0, x=2.0)
    problem = prepare(scene, Method(cq="bdf2", degree=2), 64).problem
    assert difference(problem) <= 1e-9


def test_growth_beyond_the_range_of_numbers_stops_with_what_is_finished():
    scene = spring((1.5, 1.0), T=66.0, v=1.0)
    problem = prepare(scene, Method(cq="bdf6", sampling="nodes", degree=1), 1000).problem
    direct, blocks = run_steps(problem), run(problem, "exponentials")
    assert "not finite after step" in direct.failure
    assert "not finite after step" in blocks.failure
    # intermediate sums overflow a little sooner or later
    assert abs(direct.position.shape[0] - blocks.position.shape[0]) <= 8
    common = min(direct.position.shape[0], blocks.position.shape[0]) - 9
    ratio = blocks.position[1:common] / direct.position[1:common]
    assert np.abs(ratio - 1).max() < 1e-6


def test_auto_takes_the_direct_sum_for_a_few_steps_only():
    scene = oscillator((0.5,), "caputo", 0.5)
    method = Method(cq="bdf2", degree=2)
    for n_steps, same in ((8, "direct"), (100, "exponentials")):
        problem = prepare(scene, method, n_steps).problem
        chosen = run(problem, "auto")
        assert np.array_equal(chosen.position, run(problem, same).position)
        assert chosen.operations == run(problem, same).operations
