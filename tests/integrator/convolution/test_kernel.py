"""Powers of integration on any mesh against powers of the mesh's matrix."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_powers import Array, gauss_operator, local_power, mesh_power, meshes
from spread import spread

from fvi_cli.integrator.convolution.kernel import Kernel, power_kernel
from fvi_cli.integrator.convolution.stages import StageOperator
from fvi_cli.mathematics.runge_kutta import tableau

KINDS = ("uniform", "random", "alternating", "geometric")


def kernel_for(exponents: tuple[float, ...], steps: Array, m: int) -> Kernel:
    return power_kernel(
        exponents,
        shortest_step=float(steps.min()),
        final_time=float(steps.sum()),
        stages=m,
        steps=len(steps),
    )


def apply(operator: StageOperator, kernel: Kernel, steps: Array, values: Array) -> Array:
    """All powers of a kernel on stage values, shape (N, m, d), step by step through the states."""
    local = [operator.local_block(theta) for theta in kernel.terms]
    states = np.zeros((kernel.n_states, values.shape[2]))
    result = np.empty((len(local), *values.shape))
    for n, h in enumerate(steps):
        tables = operator.step_tables(kernel, float(h))
        for k, (theta, block) in enumerate(zip(kernel.terms, local, strict=True)):
            result[k, n] = h**theta * block @ values[n] + tables.response[k] @ states
        states = tables.decay[:, None] * states + tables.intake @ values[n]
    return result


def dense(operator: StageOperator, kernel: Kernel, steps: Array) -> Array:
    size = len(steps) * operator.n_stages
    columns = np.eye(size).reshape(len(steps), operator.n_stages, size)
    return apply(operator, kernel, steps, columns).reshape(-1, size, size)


def block_error(result: Array, exact: Array, m: int) -> float:
    """Largest error of a block of steps n and l, over the largest entry of that block."""
    n = exact.shape[0] // m
    shape = (n, m, n, m)
    errors = np.abs(result - exact).reshape(shape).max(axis=(1, 3))
    sizes = np.abs(exact).reshape(shape).max(axis=(1, 3))
    lower = np.tril_indices(n)
    return float((errors[lower] / sizes[lower]).max())


@spread(m=[1, 2, 3, 5, 8, 10], theta=[-0.98, -0.5, -0.02, 0.02, 0.5, 0.98, 1 - 1e-6])
def test_local_blocks_are_powers_of_the_matrix_of_the_method(m, theta):
    exact = local_power(m, theta)
    error = np.abs(gauss_operator(m).local_block(theta) - exact).max() / np.abs(exact).max()
    assert error < 3e-14


@spread(**{"m, n": [(1, 12), (2, 7), (3, 5), (6, 3), (10, 2)]}, kind=KINDS)
def test_every_block_of_the_mesh_power_is_right(kind, m, n):
    steps = meshes(n)[kind]
    exponents = (-0.98, -0.02, 0.5, 0.98)
    kernel = kernel_for(exponents, steps, m)
    for theta, result in zip(exponents, dense(gauss_operator(m), kernel, steps), strict=True):
        assert block_error(result, mesh_power(steps, m, theta), m) < 1e-12


@spread(theta=[-0.98, -0.5, -0.02, 0.02, 0.5, 0.98], accuracy=[1e-13, 1e-10])
def test_the_accuracy_asked_for_holds_at_every_lag(theta, accuracy):
    n, operator = 10**6, gauss_operator(3)
    lags = np.unique(np.geomspace(1, n - 1, 40).astype(int))

    def blocks(final_time: float, demanded: float) -> Array:
        kernel = power_kernel(
            (theta,), shortest_step=1.0, final_time=final_time, stages=3, accuracy=demanded
        )
        step = operator.step_tables(kernel, 1.0)
        # on coefficients: differences between stages are small beside their mean
        response = operator.to_coefficients @ step.response[0]
        return (response * step.powers(lags - 1)[:, None, :]) @ step.intake @ operator.to_values

    exact = blocks(50.0 * n, 1e-15)
    errors = np.abs(blocks(float(n), accuracy) - exact)
    assert (errors[:, 0, 0] / np.abs(exact[:, 0, 0])).max() < 3 * accuracy
    assert (errors.max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))).max() < 3 * accuracy


def test_rates_that_end_too_early_are_seen():
    steps = meshes(6)["random"]
    exact = mesh_power(steps, 2, -0.5)
    kernel = kernel_for((-0.5,), steps, 2)
    short = replace(kernel, rates=kernel.rates[:-12].copy(), weights=kernel.weights[:, :-12].copy())
    assert block_error(dense(gauss_operator(2), kernel, steps)[0], exact, 2) < 1e-12
    assert block_error(dense(gauss_operator(2), short, steps)[0], exact, 2) > 1e-9


@pytest.mark.parametrize("name", ["gauss", "radau-iia", "lobatto-iiic"])
def test_all_families_agree_with_dense_resolvents(name):
    operator = StageOperator(tableau=tableau(name, 5))
    assert np.allclose(operator.to_values @ operator.to_coefficients, np.eye(5), atol=1e-14)
    kernel = power_kernel((-0.3, 0.6), shortest_step=0.01, final_time=10.0, stages=5)
    step = operator.step_tables(kernel, 0.1)
    method = operator.tableau
    for j in range(0, kernel.n_states, 7):
        z = 0.1 * kernel.rates[j]
        resolvent = np.linalg.inv(np.eye(5) + z * method.A)
        column = kernel.weights[:, [j]] * resolvent.sum(axis=1)
        sizes = np.abs(column).max(axis=1, keepdims=True)
        assert np.allclose(step.response[:, :, j] / sizes, column / sizes, rtol=0, atol=1e-12)
        assert np.allclose(step.intake[j], z * method.b @ resolvent, rtol=1e-9, atol=1e-12)
        assert step.decay[j] == pytest.approx(1 - z * method.b @ resolvent.sum(axis=1), abs=1e-11)
        assert step.change[j] == pytest.approx(-z * method.b @ resolvent.sum(axis=1), rel=1e-10)


@pytest.mark.parametrize(
    ("ratio", "steps", "accuracy", "most"),
    [
        (1e2, None, 1e-13, 90),
        (1e4, None, 1e-13, 125),
        (1e7, 300, 1e-13, 135),
        (1e4, None, 1e-10, 95),
    ],
)
def test_few_rates_are_enough(ratio, steps, accuracy, most):
    for theta in (-0.98, -0.02, 0.5, 0.98):
        kernel = power_kernel(
            (theta,), shortest_step=1.0, final_time=ratio, stages=8, steps=steps, accuracy=accuracy
        )
        assert kernel.n_states <= most


def test_kernels_are_shared_and_refuse_what_they_cannot_do():
    kernel = power_kernel([0.5], shortest_step=0.6, final_time=9.0, stages=3)
    assert kernel is power_kernel([0.5], shortest_step=0.7, final_time=10.0, stages=3)
    for bad in (
        {"exponents": [0.0]},
        {"exponents": [1.0]},
        {"exponents": []},
        {"shortest_step": 0.0},
        {"shortest_step": 2.0},
        {"stages": 0},
        {"steps": 0},
        {"accuracy": 1e-17},
    ):
        asked = {"exponents": [0.5], "shortest_step": 0.1, "final_time": 1.0, "stages": 2} | bad
        with pytest.raises(ValueError, match=r"exponent|shortest|stages|steps|accuracy"):
            power_kernel(asked.pop("exponents"), **asked)
