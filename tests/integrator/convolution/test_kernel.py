"""Powers of integration on any mesh against powers of the mesh's matrix."""

import itertools
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


@spread(kind=KINDS, m=[1, 3, 8, 10])
def test_powers_add_up(kind, m):
    steps = meshes(24)[kind]
    values = np.random.default_rng(1).standard_normal((24, m, 2))
    operator = gauss_operator(m)
    kernel = kernel_for((0.3, 0.45, 0.75), steps, m)
    first = apply(operator, kernel, steps, values)
    twice = apply(operator, kernel, steps, first[0])[1]
    scale = np.abs(first[2]).max(axis=(1, 2), keepdims=True)
    assert np.abs((twice - first[2]) / scale).max() < 1e-12


@spread(kind=KINDS, m=[1, 2, 5, 8])
def test_the_adjoint_is_the_power_on_the_reversed_mesh(kind, m):
    steps, operator = meshes(24)[kind], gauss_operator(m)
    random = np.random.default_rng(2)
    u, v = random.standard_normal((2, 24, m, 1))
    weights = steps[:, None, None] * operator.tableau.b[:, None]
    kernel = kernel_for((-0.6, 0.4), steps, m)
    forward = apply(operator, kernel, steps, v)
    backward = apply(operator, kernel, steps[::-1], u[::-1, ::-1])[:, ::-1, ::-1]
    for left, right in zip(forward, backward, strict=True):
        terms = weights * u * left
        assert abs((terms - weights * right * v).sum()) < 1e-12 * np.abs(terms).sum()


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


def test_blocks_are_their_steps():
    operator, h, size = gauss_operator(3), 0.05, 7
    kernel = power_kernel((-0.8, 0.25), shortest_step=h, final_time=1.0, stages=3)
    block = operator.step_tables(kernel, h).over(size)
    values = np.random.default_rng(4).standard_normal((2 * size, 3, 2))
    expected = apply(operator, kernel, np.full(2 * size, h), values)
    states = np.zeros((kernel.n_states, 2))
    for first in (0, size):
        own = values[first : first + size]
        force = (block.response @ states).reshape(2, size, 3, 2)
        for k, theta in enumerate(kernel.terms):
            lags = np.concatenate([h**theta * operator.local_block(theta)[None], block.lags[k]])
            for n, past in itertools.product(range(size), repeat=2):
                if past <= n:
                    force[k, n] += lags[n - past] @ own[past]
        assert np.allclose(force, expected[:, first : first + size], rtol=0, atol=1e-12)
        states = states + block.change[:, None] * states + block.intake @ own.reshape(-1, 2)


@spread(theta=[-0.9, -0.5, 0.5, 0.9], kind=KINDS)
def test_the_work_of_damping_is_stored_or_dissipated(kind, theta):
    steps, m = meshes(20)[kind], 4
    operator = gauss_operator(m)
    kernel = kernel_for((theta,), steps, m)
    values = np.random.default_rng(5).standard_normal((20, m, 1))
    force = apply(operator, kernel, steps, values)[0]
    energy_weights, size = kernel.energy_weights[0], np.abs(kernel.weights[0])
    states = np.zeros((kernel.n_states, 1))
    for n, h in enumerate(steps):
        tables = operator.step_tables(kernel, float(h))
        z = h * kernel.rates
        resolvents = np.linalg.inv(np.eye(m) + z[:, None, None] * operator.tableau.A)
        moving = np.einsum("jik,jk->ji", resolvents, (values[n] - states.T).T)
        resting = np.einsum(
            "jik,jk->ji",
            resolvents,
            states + h * kernel.rates[:, None] * (operator.tableau.A @ values[n])[:, 0],
        )
        following = tables.decay[:, None] * states + tables.intake @ values[n]
        lost = resting if theta > 0 else moving
        dissipated = h * size @ (lost**2 @ operator.tableau.b)
        stored = 0.5 * energy_weights @ (following**2 - states**2)[:, 0]
        work = h * operator.tableau.b @ (values[n] * force[n])[:, 0]
        assert dissipated >= 0
        assert work == pytest.approx(
            stored + dissipated, rel=0, abs=1e-11 * (dissipated + abs(work))
        )
        states = following


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
