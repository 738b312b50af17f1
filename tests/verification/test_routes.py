"""Two routes to one number: the integrator against the algorithm written literally."""

import numpy as np
from letters import spring
from paper_problems import bagley_torvik_three_quarters, damped_oscillator
from spread import spread

from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method, RuleSpecification
from fvi_cli.mathematics.bdf import convolution_weights
from fvi_cli.mathematics.lagrange import lobatto_basis


def literal_galerkin(order, mu, k, v0, force, final_time, n_steps, method):
    """One dense system per step in positions x_k^0..x_k^s and the momentum, from x = 0."""
    h, degree = final_time / n_steps, method.degree
    w = mu * h ** (-order) * convolution_weights(method.bdf_order, order, n_steps + 1)
    nodes, weights = np.polynomial.legendre.leggauss(degree)
    c, b = (nodes + 1) / 2, weights / 2
    basis = lobatto_basis(degree)
    value, slope = basis.values(c), basis.derivatives(c)
    matrix = (slope * b) @ slope.T / h - h * k * (value * b) @ value.T
    # what the damping sees of a step, and where it acts: at its beginning, or at the Gauss points
    seen, acts = np.eye(degree + 1)[:, :1], np.eye(degree + 1)[:, :1]
    if method.sampling == "points":
        seen, acts = value, value * b
        # with the sample of the step itself
        matrix = matrix - h * w[0] * acts @ seen.T
    x, p = np.zeros(n_steps + 1), v0
    samples = np.zeros((n_steps, seen.shape[1]))
    for j in range(n_steps):
        load = h * (value * b) @ force((j + c) * h)
        past = w[1 : j + 1] @ samples[:j][::-1]
        if method.sampling == "nodes":
            past = past + w[0] * x[j]
        # D L_d + load - kick = -p in row 0, 0 inside, and the next momentum in the last one
        known = load - h * acts @ past + matrix[:, 0] * x[j]
        right = -known[:-1]
        right[0] -= p
        inner = np.linalg.solve(matrix[:-1, 1:], right)
        x[j + 1] = inner[-1]
        p = matrix[-1, 1:] @ inner + known[-1]
        samples[j] = seen.T @ np.concatenate([[x[j]], inner])
    return x


@spread(degree=[1, 2, 3, 4], bdf_order=[1, 2, 3], sampling=["nodes", "points"])
def test_any_degree_is_the_algorithm_of_the_paper(degree, bdf_order, sampling):
    method = Method(cq=f"bdf{bdf_order}", sampling=sampling, degree=degree)
    forced, free = bagley_torvik_three_quarters().scene, damped_oscillator().scene
    for scene, given in (
        (forced, (1.5, 1.0, 1.0, 0.0, lambda t: forced.forcing(t)[..., 0], 1.0)),
        (free, (1.0, 0.2, 1.0, 1.2, np.zeros_like, 16.0)),
    ):
        ours = integrate(scene, method, 64).position[:, 0]
        theirs = literal_galerkin(*given, 64, method)
        assert np.abs(ours - theirs).max() <= 1e-12
    wrong = literal_galerkin(1.0, 0.2001, *given[2:], 64, method)
    assert np.abs(ours - wrong).max() > 1e-8


def test_degrees_of_freedom_of_a_rotated_system_are_those_of_its_modes():
    """Two uncoupled oscillators seen in rotated coordinates."""
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    stiffness, mu = np.array([1.0, 9.0]), np.array([0.3, 0.6])
    position, velocity = np.array([1.0, -0.5]), np.array([0.2, 0.4])
    method = Method(cq="bdf2", degree=2)
    coupled = spring(
        (0.5, turn @ np.diag(mu) @ turn.T),
        (1.5, 0.1 * np.eye(2)),
        T=4.0,
        m=np.eye(2),
        k=turn @ np.diag(stiffness) @ turn.T,
        x=turn @ position,
        v=turn @ velocity,
        forcing=Forcing.from_text("cos(t)", "0"),
    )
    ours = integrate(coupled, method, 50).position @ turn
    for index in range(2):
        force = f"{turn[0, index]!r}*cos(t)".replace("np.float64", "")
        alone = spring(
            (0.5, mu[index]),
            (1.5, 0.1),
            T=4.0,
            k=stiffness[index],
            x=position[index],
            v=velocity[index],
            forcing=force,
        )
        theirs = integrate(alone, method, 50).position[:, 0]
        assert np.abs(ours[:, index] - theirs).max() < 1e-12


@spread(sampling=["nodes", "points"], derivative=["caputo", "riemann-liouville"])
def test_terms_of_one_order_add_up(sampling, derivative):
    """Two terms cost and do what their sum does."""
    method = Method(cq="bdf3", sampling=sampling, degree=2)
    common = {"final_time": 3.0, "initial_velocity": 1.0, "derivative": derivative}
    two = spring(*((0.7, c) for c in (0.25, 0.5)), **common)
    one = spring((0.7, 0.75), **common)
    a, b = integrate(two, method, 40), integrate(one, method, 40)
    assert np.abs(a.position - b.position).max() < 1e-14
    assert a.history_operations == b.history_operations > 0


def test_quadrature_with_more_points_than_needed():
    problem = bagley_torvik_three_quarters()
    exact = problem.exact(np.linspace(0, 1, 65))
    for rule in (
        RuleSpecification(rule="gauss", points=4),
        RuleSpecification(rule="lobatto", points=4),
    ):
        method = Method(cq="bdf2", sampling="nodes", degree=2, quadrature=rule)
        assert np.abs(integrate(problem.scene, method, 64).position - exact).max() < 1e-3
