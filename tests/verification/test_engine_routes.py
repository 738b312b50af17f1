"""The engine's routes give what one step after the other gives."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from letters import spring, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.memory import lags
from fvi_cli.integrator.method import Method, RuleSpecification
from fvi_cli.integrator.run.on_mesh import path_from

TOLERANCE = 1e-12

LINEAR_METHODS = [
    *(Method(cq=f"bdf{p}", sampling="nodes", degree=1 + p % 2) for p in range(1, 7)),
    *(Method(cq=f"bdf{p}", degree=1 + p % 3) for p in range(1, 7)),
    Method(cq="bdf3", degree=2, quadrature=RuleSpecification(rule="lobatto", points=4)),
]


def difference(scene: Scene, method: Method, n_steps: int) -> float:
    """Largest relative difference of positions and momenta to the sum written out."""
    direct = integrate(scene, replace(method, history="direct"), n_steps)
    blocks = integrate(scene, replace(method, history="exponentials"), n_steps)
    assert (direct.status, direct.message) == (blocks.status, blocks.message)
    assert blocks.position.shape == direct.position.shape
    pairs = [(direct.position, blocks.position), (direct.momentum, blocks.momentum)]
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
        assert difference(scene, method, n_steps) <= TOLERANCE


def test_many_groups_agree():
    method = Method(cq="bdf3", degree=2)
    scene = oscillator((0.3, 1.5), "caputo", SMALL)
    assert difference(scene, method, 2500) <= TOLERANCE


def with_a_wrong_weight(monkeypatch: pytest.MonkeyPatch, lag: int) -> None:
    """Let the states' route, and it alone, take a weight that is a tenth of a percent off."""
    right = lags.Lags.kernels

    def wrong(self: lags.Lags, h: float, count: int) -> lags.LagKernels:
        found = right(self, h, count)
        if not self._rates.size:
            return found
        local, later, response = (one.copy() for one in (found.local, found.lags, found.response))
        if lag == 0:
            local *= 1.001
        if 0 < lag < count:
            later[:, lag - 1] *= 1.001
        m, s = local.shape[1:]
        for step in range(count):
            place = self.n_lags + step - lag
            if lag and 0 <= place < self.n_lags:
                own = response[:, step * m : (step + 1) * m, place * s : (place + 1) * s]
                own += 1e-3 * self.at_lags(np.array([lag]))[:, 0]
        return replace(found, local=local, lags=later, response=response)

    monkeypatch.setattr(lags.Lags, "kernels", wrong)


@pytest.mark.parametrize("lag", [0, 1, 40])
def test_one_wrong_weight_is_seen(lag, monkeypatch):
    methods = Method(cq="bdf2", degree=2), Method(cq="bdf2", sampling="nodes", degree=1)
    # a sample at the beginning of a step has nothing of the step itself
    chosen = methods if lag else methods[:1]
    scene = oscillator((0.5,), "caputo", 0.5)
    for method in chosen:
        assert difference(scene, method, 600) <= TOLERANCE
    with_a_wrong_weight(monkeypatch, lag)
    for method in chosen:
        assert difference(scene, method, 600) > 100 * TOLERANCE


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
            assert difference(scene, method, n_steps) <= TOLERANCE


def test_a_chain_too_large_for_dense_blocks_takes_steps_with_the_fast_history():
    d, n_steps = 300, 260
    stiffness = 2.0 * np.eye(d) - np.eye(d, k=1) - np.eye(d, k=-1)
    mixed = np.diag(1.0 + np.arange(d) / d)
    scene = spring(
        (0.5, 0.1 * mixed), T=2.0, m=np.eye(d), k=stiffness, x=np.sin(np.arange(d)), v=np.zeros(d)
    )
    assert difference(scene, Method(cq="bdf2", degree=1), n_steps) <= TOLERANCE


@pytest.mark.parametrize("sampling", ["nodes", "points"])
def test_starting_weights_and_mixed_orders_with_a_start_velocity(sampling):
    scene = oscillator((0.5, 1.5), "caputo", 1e-3)
    method = Method(cq="bdf2", degree=2, sampling=sampling, forcing_quadrature="exact")
    assert difference(scene, method, 200) <= TOLERANCE
    assert difference(scene, replace(method, start="weights"), 200) <= TOLERANCE


NONLINEAR_METHODS = [Method(cq="bdf3", degree=2), Method(cq="bdf2", sampling="nodes", degree=1)]


@spread(method=NONLINEAR_METHODS, orders=[(0.5,), (1.0,), (1.5, 0.5)])
def test_newton_on_whole_blocks(method, orders):
    scene = swing(*((order, 0.05) for order in orders), T=20.0, x=1.0, v=0.3, forcing="0.1*cos(t)")
    for n_steps in (12, 90, 300):
        assert difference(scene, method, n_steps) <= TOLERANCE
    finished = integrate(scene, method, n_steps).newton
    assert 0 < finished.iterations < n_steps
    assert finished.largest == len(finished.worst_residuals)
    assert finished.worst_residuals[-1] < 1e-9 * finished.worst_residuals[0]


def test_newton_sees_one_wrong_weight(monkeypatch):
    scene = swing((0.5, 0.5), T=5.0, x=1.0)
    with_a_wrong_weight(monkeypatch, 50)
    assert difference(scene, Method(cq="bdf2", degree=2), 300) > 100 * TOLERANCE


def test_steps_too_long_for_any_block_fall_back_to_single_steps():
    """A stiff pendulum over a few turns per step: the frozen response does not contract."""
    scene = swing((0.5, 0.3), T=20.0, omega=6.0, x=2.0)
    assert difference(scene, Method(cq="bdf2", degree=2), 64) <= 1e-9


def test_auto_writes_out_the_sums_of_a_few_steps_only():
    scene = oscillator((0.5,), "caputo", 0.5)
    method = Method(cq="bdf2", degree=2)
    for n_steps, same in ((8, "direct"), (100, "exponentials")):
        chosen = integrate(scene, method, n_steps)
        other = integrate(scene, replace(method, history=same), n_steps)
        assert np.array_equal(chosen.position, other.position)
        assert chosen.history_operations == other.history_operations


def test_growth_beyond_the_range_of_numbers_stops_with_what_is_finished():
    scene = spring((1.5, 1.0), T=66.0, v=1.0)
    method = Method(cq="bdf6", sampling="nodes", degree=1)
    paths = [
        path_from(scene, replace(method, history=one), 1000, np.zeros(1), np.ones(1))
        for one in ("direct", "exponentials")
    ]
    # intermediate sums overflow a little sooner or later
    lengths = [one.shape[0] for one in paths]
    assert max(lengths) < 1001
    assert abs(lengths[0] - lengths[1]) <= 8
    common = min(lengths) - 9
    ratio = paths[1][1:common] / paths[0][1:common]
    assert np.abs(ratio - 1).max() < 1e-6


@pytest.mark.parametrize("method", [Method(cq="bdf2", degree=1), Method(cq="bdf4", degree=2)])
def test_sparse_matrices_give_what_dense_ones_give(method):
    d = 40
    chain = scipy.sparse.diags_array(
        [-np.ones(d - 1), 2 * np.ones(d), -np.ones(d - 1)], offsets=[-1, 0, 1]
    )
    mixed = chain + scipy.sparse.diags_array(np.linspace(0, 1, d))

    def scene(form) -> Scene:
        return Scene(
            inertia=Inertia(mass=form(scipy.sparse.eye_array(d))),
            potential=QuadraticPotential(stiffness=form(100 * chain)),
            damping=(
                FractionalDamping(order=0.5, coefficient=form(0.3 * mixed)),
                FractionalDamping(order=1.5, coefficient=form(0.02 * chain)),
            ),
            initial_position=np.sin(np.arange(d)),
            initial_velocity=np.cos(np.arange(d)),
            final_time=2.0,
        )

    sparse = integrate(scene(scipy.sparse.csr_array), method, 100)
    dense = integrate(scene(lambda one: one.toarray()), method, 100)
    assert np.abs(sparse.position - dense.position).max() <= TOLERANCE
    assert np.ptp(dense.position) > 1.0
