"""Many coupled components by sparse steps give what dense steps with written-out sums give."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator import engine
from fvi_cli.integrator.engine import run
from fvi_cli.integrator.integrate import integrate, prepare
from fvi_cli.integrator.large_linear import ComponentHistory, run_large_steps
from fvi_cli.integrator.memory import Channel
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stepping import Stepped, StepProblem, run_steps
from fvi_cli.scenes.chains import chain
from fvi_cli.scenes.named import linear_oscillator

TOLERANCE = 1e-12
GAUSS2 = Method(cq="gauss", degree=2)
METHODS = [
    GAUSS2,
    Method(cq="gauss", degree=3, start="series"),
    Method(cq="bdf2", sampling="nodes", degree=1),
    Method(cq="bdf3", degree=2),
    Method(cq="lobatto-iiic", degree=2),
]


def one_damper(masses: int, order: float, coefficient: float = 0.3) -> FractionalDamping:
    matrix = np.zeros((masses, masses))
    matrix[-1, -1] = coefficient
    return FractionalDamping(order=order, coefficient=matrix)


def damped_chain(
    masses: int, damping: list[FractionalDamping], forcing: str | None = None
) -> Scene:
    places = np.arange(1, masses + 1)
    return chain(
        final_time=3.0,
        masses=masses,
        damping=damping,
        initial_position=np.sin(3.0 * places),
        initial_velocity=np.cos(places),
        forcing=None
        if forcing is None
        else Forcing.from_text(*(f"{k}*{forcing}" for k in range(masses))),
    )


def difference(found: Stepped, direct: Stepped) -> float:
    assert found.failure == direct.failure
    assert found.position.shape == direct.position.shape
    pairs = [(found.position, direct.position), (found.momentum, direct.momentum)]
    if found.end_force.size:
        pairs.append((found.end_force, direct.end_force))
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


def agrees(problem: StepProblem) -> None:
    assert difference(run_large_steps(problem), run_steps(problem)) <= TOLERANCE


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.case)
@pytest.mark.parametrize("orders", [(0.5,), (1.0,), (0.3, 1.5)])
def test_one_damper_in_a_chain(method: Method, orders: tuple[float, ...]) -> None:
    coefficient = 0.3 if method.is_runge_kutta else 1e-3
    damping = [one_damper(12, order, coefficient) for order in orders]
    agrees(prepare(damped_chain(12, damping, "cos(t)"), method, 300).problem)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.case)
def test_full_matrices(method: Method) -> None:
    rng = np.random.default_rng(3)

    def positive() -> np.ndarray:
        matrix = rng.normal(size=(5, 5))
        return matrix @ matrix.T / 5 + np.eye(5)

    factor = 0.3 if method.is_runge_kutta else 1e-3
    scene = linear_oscillator(
        final_time=3.0,
        mass=positive(),
        stiffness=positive(),
        damping=[FractionalDamping(order=o, coefficient=factor * positive()) for o in (0.5, 1.4)],
        initial_position=rng.normal(size=5),
        initial_velocity=rng.normal(size=5),
    )
    agrees(prepare(scene, method, 100).problem)


def test_no_damping_and_no_potential() -> None:
    agrees(prepare(damped_chain(4, [], "sin(t)"), GAUSS2, 40).problem)
    free = replace(damped_chain(4, [one_damper(4, 0.5)]), potential=None)
    agrees(prepare(free, GAUSS2, 40).problem)


def test_the_engine_takes_it_for_large_scenes_only() -> None:
    def is_taken(scene: Scene) -> bool:
        with patch.object(engine, "run_large_steps", wraps=run_large_steps) as taken:
            run(prepare(scene, GAUSS2, 20).problem, "auto")
        return bool(taken.call_count)

    assert is_taken(damped_chain(40, [one_damper(40, 0.5)]))
    assert not is_taken(damped_chain(4, [one_damper(4, 0.5)]))
    # modes: a batch of single components
    beside = chain(final_time=1.0, masses=40, dampers=[(0.5, 0.1)], initial_position=1.0)
    assert not is_taken(beside)


def test_a_long_chain_is_what_it_is_directly() -> None:
    scene = damped_chain(150, [one_damper(150, 0.5)])
    found = integrate(scene, GAUSS2, 300)
    direct = integrate(scene, replace(GAUSS2, history="direct"), 300)
    assert found.status == direct.status == "ok"
    assert np.abs(found.position - direct.position).max() <= TOLERANCE
    assert found.energy is not None
    assert direct.energy is not None
    assert np.abs(found.energy - direct.energy).max() <= TOLERANCE * direct.energy.max()


def test_only_damped_components_are_remembered() -> None:
    """Counted: one damper in a chain costs what a single damped mass does."""
    counts = []
    for masses in (1, 30):
        problem = prepare(damped_chain(masses, [one_damper(masses, 0.5)]), GAUSS2, 600).problem
        counts.append(run_large_steps(problem).operations)
    everywhere = [FractionalDamping(order=0.5, coefficient=np.diag(0.1 + np.arange(30.0)))]
    all_of_them = run_large_steps(prepare(damped_chain(30, everywhere), GAUSS2, 600).problem)
    assert counts[1] == counts[0]
    assert all_of_them.operations == 30 * counts[0]


@pytest.mark.parametrize("n_weights", [2, 5, 40, 700])
@pytest.mark.parametrize("samples", [1, 2])
def test_history_against_the_sum_written_out(n_weights: int, samples: int) -> None:
    rng = np.random.default_rng(7)
    weights = rng.normal(size=n_weights)
    direction = np.zeros((3, 3))
    direction[0, 0] = direction[2, 2] = 1.0
    history = ComponentHistory(Channel(direction=direction, weights=weights), samples, 620)
    assert history.support.tolist() == [0, 2]
    past = rng.normal(size=(620, samples, 2))
    for k in range(620):
        reach = min(k, n_weights - 1)
        expected = np.einsum("n,nmq->mq", weights[1 : reach + 1], past[k - reach : k][::-1])
        assert np.abs(history.known() - expected).max() <= 1e-12 * max(1.0, np.abs(expected).max())
        history.push(past[k])


def test_a_wrong_weight_is_seen() -> None:
    problem = prepare(damped_chain(6, [one_damper(6, 0.5)]), GAUSS2, 300).problem
    channel = problem.memory.channels[0]
    for lag in (0, 3, 40, 270):
        weights = channel.weights.copy()
        weights[lag] *= 1.001
        wrong = replace(problem.memory, channels=(replace(channel, weights=weights),))
        found = run_large_steps(replace(problem, memory=wrong))
        assert difference(found, run_steps(problem)) > 100 * TOLERANCE


def test_a_run_that_diverges_says_so() -> None:
    scene = damped_chain(20, [one_damper(20, 1.5, 1e6)])
    method = Method(cq="bdf2", sampling="nodes", degree=1)
    problem = prepare(scene, method, 600).problem
    found, direct = run_large_steps(problem), run_steps(problem)
    assert found.failure == direct.failure != ""
    assert found.position.shape == direct.position.shape
    stopped = run_large_steps(replace(problem, stop_beyond=1e3))
    assert stopped.position.shape[0] < found.position.shape[0]


def test_sparse_matrices_are_factorised_as_such() -> None:
    problem = prepare(damped_chain(60, [one_damper(60, 0.5)]), GAUSS2, 4).problem
    full = FractionalDamping(order=0.5, coefficient=0.1 + np.eye(60))
    other = prepare(damped_chain(60, [full]), GAUSS2, 4).problem
    with patch.object(np.linalg, "inv", wraps=np.linalg.inv) as dense:
        run_large_steps(problem)
        assert dense.call_count == 0
        run_large_steps(other)
    assert dense.call_count == 1
