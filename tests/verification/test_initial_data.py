"""Initial data and conventions: values from outside, and what must be refused."""

from dataclasses import replace

import numpy as np
import pytest
from letters import spring
from oracles.linear_response import match_scene
from spread import spread

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Baseline, Method

METHODS = [
    Method(cq="gauss", degree=3),
    Method(cq="gauss", degree=3, start="graded"),
    Method(cq="lobatto-iiic", degree=3),
    Method(cq="bdf4", degree=2, forcing_quadrature="exact"),
]


@pytest.mark.parametrize("method", [*METHODS, Method(cq="bdf2", degree=1, sampling="nodes")])
def test_polynomial_solution(method):
    """x'' + D^{3/2} x + x = 1 + t with x(0) = x'(0) = 1 has x = 1 + t."""
    scene = spring((1.5, 1.0), T=1.0, x=1.0, v=1.0, forcing="1 + t")
    trajectory = integrate(scene, method, 64)
    assert np.abs(trajectory.position[:, 0] - 1 - trajectory.time).max() < 1e-13
    wrong = spring((1.5, 1.0), T=1.0, x=1.0, v=1.0001, forcing="1 + t")
    assert np.abs(integrate(wrong, method, 64).position - trajectory.position).max() > 1e-6


@spread(
    bdf=[1, 2, 3, 4, 5, 6],
    start=[(1.0, 0.3), (-1e6, 0.0), (1e-6, 2.0)],
    n_steps=[7, 60, 600],
    size=[1, 2],
)
def test_order_1_of_riemann_liouville_is_the_rate_at_nodes_too(bdf, start, n_steps, size):
    """Riemann-Liouville and Caputo are the same operator for the order 1."""
    position, velocity = (value * np.array([1.0, -0.5])[:size] for value in start)
    coefficient = np.array([[0.4, 0.1], [0.1, 0.3]])[:size, :size]
    caputo = spring(
        (1.0, coefficient), T=0.4, m=np.eye(size), k=np.eye(size), x=position, v=velocity
    )
    method = Method(cq=f"bdf{bdf}", degree=1, sampling="nodes")
    one, other = (
        integrate(replace(caputo, derivative=kind), method, n_steps).position
        for kind in ("caputo", "riemann-liouville")
    )
    assert np.abs(one - other).max() < 1e-12 * np.abs(one).max()


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("order", "method", "lost"),
    [
        # the loads of the data are integrated by a rule of the step
        (0.3, Method(cq="bdf2", degree=1, sampling="nodes"), 2.0),
        (0.5, Method(cq="bdf3", degree=2, sampling="nodes"), 2.0),
        (1.5, Method(cq="bdf2", degree=1, sampling="nodes"), 2.0),
        (1.2, Method(cq="bdf2", degree=1), 2.0),
        (1.5, Method(cq="bdf3", degree=2), 2.0),
        (1.5, Method(cq="gauss", degree=1), 2.0),
        (1.5, Method(cq="gauss", degree=2), 2.0),
        (1.5, Method(cq="lobatto-iiic", degree=2), 2.0),
        (1.5, Baseline(name="implicit-euler"), 0.5),
        (1.9, Baseline(name="product-integration"), 1.2),
        (1.5, Baseline(name="product-integration"), 2.0),
        (1.5, Baseline(name="gruenwald-letnikov"), 1.0),
    ],
    ids=str,
)
def test_what_initial_data_cost_under_riemann_liouville(order, method, lost):
    """Slopes against the closed form; the same data cost less under Caputo."""
    measured = {}
    for derivative in ("riemann-liouville", "caputo"):
        scene = spring(
            (order, 0.7),
            T=2.0,
            x=1.0 if order < 1 else 0.0,
            v=1.0 if order > 1 else 0.0,
            derivative=derivative,
        )
        solution = match_scene(scene)
        errors = []
        # at finer ones errors of order 3.5 are those of round-off
        for n_steps in (256, 1024):
            trajectory = integrate(scene, method, n_steps)
            exact = solution.position(trajectory.time)
            errors.append(np.abs(trajectory.position - exact).max())
        measured[derivative] = np.log2(errors[0] / errors[1]) / 2
        if derivative == "riemann-liouville":
            assert measured[derivative] == pytest.approx(lost, abs=0.1)
    if lost < 1.9 and not (isinstance(method, Baseline) and lost == 1.0):
        assert measured["caputo"] > measured["riemann-liouville"] + 0.15


def test_public_data_of_the_follow_up():
    """Lobatto IIIC, classical damping (arXiv 2510.11082; data: repository khaledharizb/RKCQ)."""
    table = {
        1: (3.78281711e-2, 9.13940845e-3, 2.28712214e-3, 5.70202712e-4),
        2: (3.05875383e-4, 1.86120011e-5, 1.15820322e-6, 7.24071e-8),
        3: (3.8855294e-7, 6.27779e-9, 9.67e-11, 1.5e-12),
    }
    scene = spring(
        (1.0, 0.25 * np.eye(2)), T=30.0, m=np.eye(2), k=0.5 * np.eye(2), x=[0.8, -0.5], v=[0.4, 0.0]
    )
    for degree, row in table.items():
        for n_steps, published in zip((32, 64, 128, 256), row, strict=True):
            trajectory = integrate(scene, Method(cq="lobatto-iiic", degree=degree), n_steps)
            exact = match_scene(scene).position(trajectory.time)
            error = np.abs(trajectory.position - exact).max()
            assert error == pytest.approx(published, rel=2e-6 if published > 1e-10 else 0.1)
