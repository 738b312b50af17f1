"""Weights between Legendre coefficients: the same operator, rounded better."""

from __future__ import annotations

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.engine import run
from fvi_cli.integrator.integrate import prepare
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stage_basis import legendre_stages, legendre_weights
from fvi_cli.mathematics.runge_kutta import tableau
from fvi_cli.mathematics.runge_kutta_weights import runge_kutta_weights
from fvi_cli.scenes.named import linear_oscillator

FAMILIES = [("gauss", m) for m in range(1, 6)] + [("radau-iia", 3), ("lobatto-iiic", 3)]


@pytest.mark.parametrize(("name", "m"), FAMILIES)
@pytest.mark.parametrize("theta", [-0.7, 0.0, 0.5])
def test_they_are_the_weights_on_values_in_other_coordinates(
    name: str, m: int, theta: float
) -> None:
    method = tableau(name, m)
    basis = legendre_stages(method.c)
    assert np.abs(basis.to_coefficients @ np.ones(m) - np.eye(m)[0]).max() < 1e-14
    plain = runge_kutta_weights(method, theta, 300)
    ours = basis.to_values @ legendre_weights(method, theta, 300) @ basis.to_coefficients
    scale = np.abs(plain).max(axis=(1, 2), keepdims=True) + 1e-300
    assert (np.abs(ours - plain) / scale).max() < 2e-12
    wrong = basis.to_values @ legendre_weights(method, theta + 1e-6, 300) @ basis.to_coefficients
    assert (np.abs(wrong - plain) / scale).max() > 1e-8


@pytest.mark.parametrize("m", [2, 3, 4])
@pytest.mark.parametrize("theta", [-0.5, 0.5, 0.9])
def test_gauss_has_parity(m: int, theta: float) -> None:
    weights = legendre_weights(tableau("gauss", m), theta, 2000)
    signs = (-1.0) ** np.add.outer(np.arange(m), np.arange(m))
    defect = np.abs(weights - signs * weights.transpose(0, 2, 1))
    assert defect[1:].max() <= 4e-16 * np.abs(weights).max()
    assert defect[0, 0].max() <= 1e-14
    unsigned = np.abs(weights - weights.transpose(0, 2, 1))
    assert unsigned.max() > 1e-3


def exact_mean_weights(m: int, n: int) -> list[mpmath.mpf]:
    """First entries of the weights of Delta(z)^(1/2) by a contour integral with 40 digits."""
    with mpmath.workdps(40):
        xi = [1 / (2 * mpmath.sqrt(4 * k * k - 1)) for k in range(1, m)]
        matrix = mpmath.zeros(m)
        matrix[0, 0] = mpmath.mpf(1) / 2
        for k, value in enumerate(xi):
            matrix[k, k + 1], matrix[k + 1, k] = -value, value
        radius, count = mpmath.mpf("0.5"), 128
        total = [mpmath.mpf(0)] * n
        for j in range(count):
            z = radius * mpmath.expjpi(mpmath.mpf(2 * j) / count)
            symbol = matrix.copy()
            symbol[0, 0] += z / (1 - z)
            values, vectors = mpmath.eig(mpmath.inverse(symbol))
            inverse = mpmath.inverse(vectors)
            power = sum(vectors[0, i] * mpmath.sqrt(values[i]) * inverse[i, 0] for i in range(m))
            for k in range(n):
                total[k] += mpmath.re(power * z**-k) / count
        return total


@pytest.mark.parametrize("m", [2, 3])
def test_entries_of_the_mean_against_extended_precision(m: int) -> None:
    ours = legendre_weights(tableau("gauss", m), 0.5, 2**16)[:12, 0, 0]
    exact = np.array([float(w) for w in exact_mean_weights(m, 12)])
    assert np.abs(ours - exact).max() < 1.5e-15
    assert np.abs(ours[1:] / exact[1:] - 1).max() < 5e-14


@pytest.mark.parametrize("m", [2, 3])
def test_the_floor_stays_where_it_is_at_small_steps(m: int) -> None:
    """x = t^4 on [0, 1] in 2^16 steps; the control: w_0 off by 1e-13."""
    force = f"12*t**2 + {math.gamma(5) / math.gamma(3.5)!r}*t**2.5 + t**4"
    scene = linear_oscillator(
        final_time=1.0,
        damping=[FractionalDamping(order=1.5, coefficient=np.eye(1))],
        forcing=Forcing.from_text(force),
    )
    n_steps = 2**16
    problem = prepare(scene, Method(cq="gauss", degree=m), n_steps).problem
    exact = (np.arange(n_steps + 1) / n_steps) ** 4
    assert np.abs(run(problem, "fft").position[:, 0] - exact).max() < 4e-13
    channel = problem.memory.channels[0]
    weights = channel.weights.copy(order="K")
    weights[0, 0, 0] *= 1 + 1e-13
    memory = replace(problem.memory, channels=(replace(channel, weights=weights),))
    wrong = run(replace(problem, memory=memory), "fft").position[:, 0]
    assert np.abs(wrong - exact).max() > 2e-12
