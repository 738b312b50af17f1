"""Powers of integration on any mesh against powers of the mesh's matrix."""

import numpy as np
import pytest
from mesh_powers import Array, gauss_operator, mesh_power, meshes
from runge_kutta_symbol import tableau
from spread import spread

from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.interface import Direction
from fvi_cli.integrator.memory.kernel import power_kernel
from fvi_cli.integrator.memory.stages import stage_operator
from fvi_cli.integrator.method import Method

KINDS = ("uniform", "random", "alternating", "geometric")


def memory_for(exponents: tuple[float, ...], steps: Array, m: int) -> Exponentials:
    return Exponentials(
        Method(cq="gauss", degree=m),
        exponents,
        shortest_step=float(steps.min()),
        final_time=float(steps.sum()),
        steps=len(steps),
    )


def powers_of(memory: Exponentials) -> list[Direction]:
    """Every term of a memory."""
    one = np.ones((1, 1))
    return [
        Direction(places=np.array([[k]]), factors=one, matrix=one[None])
        for k in range(len(memory.terms))
    ]


def apply(memory: Exponentials, steps: Array, values: Array) -> Array:
    """All terms of a memory on stage values, shape (N, m, d), step by step through the states."""
    states = np.zeros((1, memory.n_states, values.shape[2]))
    result = np.empty((len(memory.terms), *values.shape))
    for n, h in enumerate(steps):
        for k, one in enumerate(powers_of(memory)):
            tables = memory.kernels(float(h), 1, (one,))
            result[k, n] = (tables.past([states], 1) + tables.present(values[None, n], 1))[0]
        states = tables.push(states, values[None, n], 1)
    return result


def dense(memory: Exponentials, steps: Array, m: int) -> Array:
    size = len(steps) * m
    columns = np.eye(size).reshape(len(steps), m, size)
    return apply(memory, steps, columns).reshape(-1, size, size)


def block_error(result: Array, exact: Array, m: int) -> float:
    """Largest error of a block of steps n and l, over the largest entry of that block."""
    n = exact.shape[0] // m
    shape = (n, m, n, m)
    errors = np.abs(result - exact).reshape(shape).max(axis=(1, 3))
    sizes = np.abs(exact).reshape(shape).max(axis=(1, 3))
    lower = np.tril_indices(n)
    return float((errors[lower] / sizes[lower]).max())


@spread(few=2, **{"m, n": [(1, 12), (2, 7), (3, 5), (6, 3), (10, 2)]}, kind=KINDS)
def test_every_block_of_the_mesh_power_is_right(kind, m, n):
    steps = meshes(n)[kind]
    exponents = (-0.98, -0.02, 0.5, 0.98)
    memory = memory_for(exponents, steps, m)
    for theta, result in zip(exponents, dense(memory, steps, m), strict=True):
        assert block_error(result, mesh_power(steps, m, theta), m) < 1e-12


@pytest.mark.parametrize("theta", [-0.98, -0.5, -0.02, 0.02, 0.5, 0.98])
def test_the_accuracy_holds_at_every_lag(theta):
    n, operator = 10**6, gauss_operator(3)
    lags = np.unique(np.geomspace(1, n - 1, 40).astype(int))
    older = lags[:, None] - 1

    def blocks(final_time: float) -> Array:
        kernel = power_kernel((theta,), shortest_step=1.0, final_time=final_time, stages=3)
        step = operator.exponentials(kernel.rates)
        # on coefficients: differences between stages are small beside their mean
        response = operator.to_coefficients @ (step.stages * kernel.weights)
        # as `powers`, of these lags alone
        powers = np.where(older % 2 == 1, step.signs, 1.0) * np.exp(older * step.log_magnitudes)
        assert np.array_equal(powers[:5], step.powers(lags[4])[lags[:5] - 1])
        return (response * powers[:, None, :]) @ step.intake @ operator.to_values

    exact = blocks(50.0 * n)
    errors = np.abs(blocks(float(n)) - exact)
    assert (errors[:, 0, 0] / np.abs(exact[:, 0, 0])).max() < 1e-13
    assert (errors.max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))).max() < 1e-13


def test_rates_that_end_too_early_are_seen():
    steps = meshes(6)["random"]
    exact = mesh_power(steps, 2, -0.5)
    memory = memory_for((-0.5,), steps, 2)
    assert block_error(dense(memory, steps, 2)[0], exact, 2) < 1e-12
    memory.weights = np.where(np.arange(memory.n_states) < memory.n_states - 12, memory.weights, 0)
    assert block_error(dense(memory, steps, 2)[0], exact, 2) > 1e-9


@spread(kind=KINDS, m=[1, 2, 5, 8])
def test_the_adjoint_is_the_power_on_the_reversed_mesh(kind, m):
    steps, method = meshes(24)[kind], tableau("gauss", m)
    random = np.random.default_rng(2)
    u, v = random.standard_normal((2, 24, m, 1))
    weights = steps[:, None, None] * method.b[:, None]
    memory = memory_for((-0.6, 0.4), steps, m)
    forward = apply(memory, steps, v)
    backward = apply(memory, steps[::-1], u[::-1, ::-1])[:, ::-1, ::-1]
    for left, right in zip(forward, backward, strict=True):
        terms = weights * u * left
        assert abs((terms - weights * right * v).sum()) < 1e-12 * np.abs(terms).sum()


@pytest.mark.parametrize("name", ["gauss", "lobatto-iiic"])
def test_all_families_agree_with_dense_resolvents(name):
    operator = stage_operator(name, 5)
    assert np.allclose(operator.to_values @ operator.to_coefficients, np.eye(5), atol=1e-14)
    rates = power_kernel((-0.3, 0.6), shortest_step=0.01, final_time=10.0, stages=5).rates
    step = operator.exponentials(0.1 * rates)
    method = tableau(name, 5)
    for j in range(0, rates.size, 7):
        z = 0.1 * rates[j]
        resolvent = np.linalg.inv(np.eye(5) + z * method.A)
        column = resolvent.sum(axis=1)
        size = np.abs(column).max()
        assert np.allclose(step.stages[:, j] / size, column / size, rtol=0, atol=1e-12)
        assert np.allclose(step.intake[j], z * method.b @ resolvent, rtol=1e-9, atol=1e-12)
        decay = 1 - z * method.b @ resolvent.sum(axis=1)
        assert step.powers(2)[1, j] == pytest.approx(decay, abs=1e-11)
        assert step.changes(1)[j] == pytest.approx(decay - 1, rel=1e-10)
        assert step.changes(2)[j] == pytest.approx(decay**2 - 1, rel=1e-10)


@spread(theta=[-0.9, -0.5, 0.5, 0.9], kind=KINDS)
def test_the_work_of_damping_is_stored_or_dissipated(kind, theta):
    steps, m = meshes(20)[kind], 4
    method = tableau("gauss", m)
    memory = memory_for((theta,), steps, m)
    kernel = memory.kernel
    values = np.random.default_rng(5).standard_normal((20, m, 1))
    force = apply(memory, steps, values)[0]
    energy_weights, size = kernel.energy_weights[0], np.abs(kernel.weights[0])
    states = np.zeros((kernel.rates.size, 1))
    for n, h in enumerate(steps):
        z = h * kernel.rates
        resolvents = np.linalg.inv(np.eye(m) + z[:, None, None] * method.A)
        moving = np.einsum("jik,jk->ji", resolvents, (values[n] - states.T).T)
        resting = np.einsum(
            "jik,jk->ji",
            resolvents,
            states + h * kernel.rates[:, None] * (method.A @ values[n])[:, 0],
        )
        following = memory.kernels(float(h), 1, ()).push(states[None], values[None, n], 1)[0]
        lost = resting if theta > 0 else moving
        dissipated = h * size @ (lost**2 @ method.b)
        stored = 0.5 * energy_weights @ (following**2 - states**2)[:, 0]
        work = h * method.b @ (values[n] * force[n])[:, 0]
        assert dissipated >= 0
        assert work == pytest.approx(
            stored + dissipated, rel=0, abs=1e-11 * (dissipated + abs(work))
        )
        states = following
