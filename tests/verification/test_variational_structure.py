"""What makes the scheme variational."""

import numpy as np
import pytest
from adjoint_equation import integrate_advanced
from letters import spring
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.bdf import left_operator
from fvi_cli.scenes.data import pendulum
from fvi_cli.scenes.structures import linear_oscillator

DAMPED = [FractionalDamping(order=0.6, coefficient=0.7)]


def scene_of(kind: str, forcing: Forcing | None = None) -> Scene:
    make = pendulum if kind == "pendulum" else linear_oscillator
    return make(
        final_time=3.0,
        damping=DAMPED,
        initial_velocity=1.0,
        derivative="riemann-liouville",
        forcing=forcing,
    )


@spread(kind=["oscillator", "pendulum"], sampling=["nodes", "points"], degree=[1, 2, 3])
def test_y_is_x_in_reversed_time(kind, sampling, degree):
    scene = scene_of(kind)
    method = Method(cq="bdf3", sampling=sampling, degree=degree)
    x = integrate(scene, method, 24).position
    y = integrate_advanced(scene, method, 24, np.zeros(1), -scene.initial_velocity)
    assert np.abs(y - x[::-1]).max() < 2e-12
    wrong = integrate_advanced(scene, method, 24, np.zeros(1), scene.initial_velocity)
    assert np.abs(wrong - x[::-1]).max() > 0.1


@pytest.mark.parametrize("sampling", ["nodes", "points"])
def test_y_is_x_in_reversed_time_with_mirrored_forcing(sampling):
    method = Method(cq="bdf2", sampling=sampling, degree=2)
    scene = scene_of("oscillator", Forcing.from_text("sin(2*t) + t"))
    mirrored = scene_of("oscillator", Forcing.from_text("sin(2*(3-t)) + 3 - t"))
    x = integrate(scene, method, 24).position
    y = integrate_advanced(mirrored, method, 24, np.zeros(1), -scene.initial_velocity)
    assert np.abs(y - x[::-1]).max() < 2e-12
    same = integrate_advanced(scene, method, 24, np.zeros(1), -scene.initial_velocity)
    assert np.abs(same - x[::-1]).max() > 1e-3


@pytest.mark.parametrize("sampling", ["nodes", "points"])
def test_derivative_of_the_action_is_the_sum_of_both_residuals(sampling):
    """dS[x, y](eta, eta) for equal variations, by numerical differentiation of the action.

    The residuals follow from J_-^{2 alpha} x and J_+^{2 alpha} y; the action has only J^alpha:
    this is where the semigroup property and integration by parts enter.
    """
    alpha, mu, n, degree = 0.3, 0.7, 6, 2
    method = Method(cq="bdf2", sampling=sampling, degree=degree)
    tables = step_tables(method)
    h = 0.25
    rng = np.random.default_rng(5)
    # values on the control points of all steps, shared ends
    x, y, eta = (rng.normal(size=n * degree + 1) for _ in range(3))
    eta[0] = eta[-1] = 0.0
    index = np.arange(n)[:, None] * degree + np.arange(degree + 1)

    def conservative(q: np.ndarray) -> float:
        points, speeds = q[index] @ tables.basis, q[index] @ tables.slopes / h
        return float(h * (0.5 * speeds**2 - (1 - np.cos(points))).sum(axis=0) @ tables.weights)

    # the paper samples on the nodes, each of weight 1
    on_nodes = sampling == "nodes"
    sample_basis = np.eye(degree + 1)[:, :1] if on_nodes else tables.sample_basis
    sample_weights = np.ones(1) if on_nodes else tables.weights

    def samples(q: np.ndarray) -> np.ndarray:
        inside = q[index] @ sample_basis
        return np.vstack([inside, q[-1:][None]]) if sampling == "nodes" else inside

    def action(x: np.ndarray, y: np.ndarray) -> float:
        left = left_operator(2, alpha, h, samples(x))
        # the advanced operator is the retarded one with time reversed
        right = left_operator(2, alpha, h, samples(y)[::-1])[::-1]
        damping = (left * right).sum(axis=0) @ sample_weights
        return conservative(x) + conservative(y) - mu * h * float(damping)

    eps = 1e-5
    numeric = (action(x + eps * eta, y + eps * eta) - action(x - eps * eta, y - eps * eta)) / (
        2 * eps
    )
    forces = left_operator(2, 2 * alpha, h, samples(x))
    forces = forces + left_operator(2, 2 * alpha, h, samples(y)[::-1])[::-1]
    damping = mu * h * float((forces * samples(eta)).sum(axis=0) @ sample_weights)

    def slope(q: np.ndarray) -> float:
        points, speeds = q[index] @ tables.basis, q[index] @ tables.slopes / h
        moved, faster = eta[index] @ tables.basis, eta[index] @ tables.slopes / h
        return float(h * (speeds * faster - np.sin(points) * moved).sum(axis=0) @ tables.weights)

    assert numeric == pytest.approx(slope(x) + slope(y) - damping, rel=1e-8)
    assert numeric != pytest.approx(slope(x) + slope(y), rel=1e-3)


def test_momentum_on_nodes_is_of_order_2():
    """p_k - (h/2) F_k; the momentum before the kick is of order 1 only.

    Measured from t = 1 on: the kick at 0 that the scheme leaves out is of order 1 on the first
    steps.
    """
    scene = spring((1.0, 0.2), T=16.0, v=1.0)
    w = np.sqrt(0.99)
    defects, plain = [], []
    for n_steps in (256, 512, 1024):
        trajectory = integrate(scene, Method(cq="bdf2", sampling="nodes", degree=1), n_steps)
        t = trajectory.time
        exact = np.exp(-t / 10) * (np.cos(w * t) - 0.1 * np.sin(w * t) / w)
        late = t >= 1
        defect = (trajectory.momentum[:, 0] - exact)[late]
        kick = 0.5 * trajectory.step_size * 0.2 * exact[late]
        defects.append(np.abs(defect).max())
        plain.append(np.abs(defect + kick).max())
    assert np.log2(defects[1] / defects[2]) == pytest.approx(2.0, abs=0.1)
    assert np.log2(plain[1] / plain[2]) == pytest.approx(1.0, abs=0.1)
