"""Moments, break points, baselines, Newton's iteration and what an integration reports."""

import math
from dataclasses import replace

import numpy as np
import pytest
from letters import spring
from spread import spread

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.lagrange import lobatto_basis


def loads(text: str, method: Method, h: float, n_steps: int) -> np.ndarray:
    """Load vectors of a force on equal steps from 0 on."""
    scene = spring(T=h * n_steps, forcing=text)
    found = StepLoads(scene, method, step_tables(method)).of_steps(0.0, h, n_steps, is_fresh=True)
    assert found is not None
    return found


@pytest.mark.parametrize("power", [-0.9, -0.5, 0.5, 1.5, 3.0])
def test_exact_moments_of_powers(power):
    """Against the integrals of t**(power + j), on the first, second and tenth step."""
    method = Method(cq="bdf1", degree=2, forcing_quadrature="exact")
    force, h = f"t**({power})", 0.3
    moments = loads(force, method, h, 12)[:, :, 0]
    basis = lobatto_basis(2)
    # coefficients of the basis in powers of tau
    vandermonde = np.vander(basis.control_points, increasing=True)
    coefficients = np.linalg.inv(vandermonde).T
    for k in (0, 1, 9):
        # int_0^1 tau^j (k + tau)^power: from integrals of (k + tau)^(power + i)
        integrals = [
            ((k + 1.0) ** (power + i + 1) - float(k) ** (power + i + 1)) / (power + i + 1)
            for i in range(3)
        ]
        shifted = [
            sum(math.comb(j, i) * (-k) ** (j - i) * integrals[i] for i in range(j + 1))
            for j in range(3)
        ]
        expected = h ** (power + 1) * coefficients @ np.array(shifted)
        assert moments[k] == pytest.approx(expected, rel=1e-12 if k < 2 else 1e-10, abs=1e-13)
    plain = loads(force, replace(method, forcing_quadrature="galerkin"), h, 12)[:, :, 0]
    if power != 3.0:
        assert abs(plain[0] - moments[0]).max() > 1e-6


@spread(name=["explicit-euler", "implicit-euler"], order=[0.5, 1.0, 1.5])
def test_euler_is_of_order_1(name, order):
    scene = spring((order, 0.5), T=2.0, x=1.0, v=0.3)
    fine = integrate(scene, Method(cq="gauss", degree=3, start="graded"), 128).position[-1, 0]
    errors = [
        abs(integrate(scene, Baseline(name=name), n).position[-1, 0] - fine)
        for n in (400, 800, 1600)
    ]
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(1.0, abs=0.1)


def test_euler_with_classical_damping_is_the_textbook_scheme():
    scene = spring((1.0, 0.2), T=1.0, v=1.0)
    h, x, v = 0.125, 0.0, 1.0
    y, w = 0.0, 1.0
    for _ in range(8):
        x, v = x + h * v, v + h * (-x - 0.2 * v)
        w = (w - h * y) / (1 + 0.2 * h + h * h)
        y = y + h * w
    explicit = integrate(scene, Baseline(name="explicit-euler"), 8)
    implicit = integrate(scene, Baseline(name="implicit-euler"), 8)
    assert explicit.position[-1, 0] == pytest.approx(x, abs=1e-14)
    assert implicit.position[-1, 0] == pytest.approx(y, abs=1e-14)
