"""The past of backward differences as states, against the sum written out."""

from dataclasses import replace

import numpy as np
import pytest
from letters import spring
from spread import spread

from fvi_cli.integrator.convolution.lags import LagDamping, LagStep
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.bdf import difference_weights

RNG = np.random.default_rng(20240318)
ORDERS = {"one": (0.5,), "finite": (1.0,), "several": (0.3, 1.0, 1.7)}
METHODS = {
    "bdf1": Method(cq="bdf1", sampling="nodes", degree=1),
    "bdf2": Method(cq="bdf2", degree=1),
    "bdf4": Method(cq="bdf4", degree=2),
    "bdf6": Method(cq="bdf6", degree=3),
}


def damping_of(kind: str, method: Method, n: int, d: int, *, writes_out: bool = False):
    scene = spring(
        *((order, np.diag(1.0 + RNG.random(d))) for order in ORDERS[kind]),
        T=0.01 * n,
        m=np.eye(d),
        k=np.eye(d),
        x=np.zeros(d),
        v=np.zeros(d),
    )
    return LagDamping(scene, method, step_tables(method), n, writes_out=writes_out)


def literal_force(damping: LagDamping, method: Method, unknowns: np.ndarray) -> np.ndarray:
    """Force of all older steps on every one, shape ``(n, m, d)``: samples, then weights."""
    tables, n = step_tables(method), unknowns.shape[0]
    sample, h = tables.sample_basis[1:].T, 0.01
    samples = h * (sample @ unknowns)
    samples[1:] += h * ((np.eye(tables.degree)[-1:] - sample) @ unknowns[:-1])
    # the newest step is not among the older ones, but what it shares with the one before is
    own = h * (sample @ unknowns)
    force = np.zeros_like(samples)
    for one in damping.directions:
        total = np.zeros(n)
        for term, factor in zip(one.terms, one.factors, strict=True):
            order = 1.0 - term
            total += factor * h**-order * difference_weights(method.bdf_order, order, n)
        for k in range(n):
            sums = np.tensordot(total[1 : k + 1], samples[:k][::-1], 1)
            force[k] += (sums + total[0] * (samples[k] - own[k])) @ one.matrix
    return force


def by_blocks(damping: LagDamping, unknowns: np.ndarray, block: int) -> np.ndarray:
    """States between blocks of several lengths, lags inside of them."""
    at, states, force = damping.tables(0.01), damping.initial_states(), []
    done, count = 0, block
    while done < unknowns.shape[0]:
        own = unknowns[done : done + count]
        table = at.step.over(own.shape[0])
        total = np.zeros((own.shape[0], at.local[0].shape[0], own.shape[2]))
        for one in damping.directions:
            carried = (damping.combined(one, table.response) @ states).reshape(total.shape)
            for lag, kernel in enumerate(damping.combined(one, table.lags), start=1):
                carried[lag:] += kernel @ own[:-lag]
            total += carried @ one.matrix
        force.append(total)
        states = table.after(states, own.reshape(-1, own.shape[2]))
        done, count = done + count, count // 2 or block
    return np.concatenate(force)


@spread(
    kind=ORDERS, **{"n, block": [(61, 8), (300, 64), (700, 16), (7, 8), (500, 300)]}, case=METHODS
)
def test_blocks_of_any_length(kind, n, block, case):
    method, d = METHODS[case], 1 + n % 3
    damping = damping_of(kind, method, n, d)
    unknowns = RNG.normal(size=(n, method.degree, d))
    expected = literal_force(damping, method, unknowns)
    found = by_blocks(damping, unknowns, block)
    assert np.abs(found - expected).max() <= 2e-13 * np.abs(expected).max()


@spread(kind=ORDERS, case=METHODS, writes_out=[False, True])
def test_steps_one_at_a_time(kind, case, writes_out):
    n, d, method = 300, 2, METHODS[case]
    damping = damping_of(kind, method, n, d, writes_out=writes_out)
    unknowns = RNG.normal(size=(n, method.degree, d))
    expected = literal_force(damping, method, unknowns)
    at, states, worst = damping.tables(0.01), damping.initial_states(), 0.0
    for k in range(n):
        worst = max(worst, np.abs(damping.history_force(at, states) - expected[k]).max())
        damping.advance(at, states, unknowns[k])
    assert worst <= 2e-13 * np.abs(expected).max()
    if writes_out and kind != "finite":
        assert damping.n_states == n * method.degree


@pytest.mark.parametrize("lag", [1, 40, 200])
def test_one_wrong_weight_is_seen(lag):
    """The control: a weight that is a tenth of a percent off, or all that come from one rate."""
    method = METHODS["bdf2"]
    damping = damping_of("one", method, 300, 1)
    unknowns = RNG.normal(size=(300, 1, 1))
    expected = literal_force(damping, method, unknowns)
    at = damping.tables(0.01)
    wrong: LagStep = at.step
    if lag <= wrong.n_lags:
        near, kernels = wrong.near.copy(), wrong.kernels.copy()
        near[:, lag] += 1e-3 * kernels[:, lag]
        kernels[:, lag] *= 1.001
        wrong = replace(wrong, near=near, kernels=kernels)
    else:
        far = wrong.far.copy()
        far[:, np.searchsorted(wrong.rates, 1 / lag)] *= 1.001
        wrong = replace(wrong, far=far)
    damping._at = replace(at, step=wrong)
    found = by_blocks(damping, unknowns, 16)
    assert np.abs(found - expected).max() > 1e-9 * np.abs(expected).max()


@spread(kind=ORDERS, case=METHODS, steps=[1, 5, 64, 300])
def test_a_block_is_so_many_steps(kind, case, steps):
    method = METHODS[case]
    damping = damping_of(kind, method, 1000, 1)
    at, table = damping.tables(0.01), damping.tables(0.01).step.over(steps)
    driving = RNG.normal(size=(steps, method.degree, 1))
    states = RNG.normal(size=(damping.n_states, 1))
    whole = table.after(states, driving.reshape(-1, 1))
    by_matrices = states + table.change_of_all() @ states + table.intake @ driving.reshape(-1, 1)
    for one in driving:
        damping.advance(at, states, one)
    assert np.abs(whole - states).max() <= 1e-13 * np.abs(states).max()
    assert np.abs(by_matrices - states).max() <= 1e-13 * np.abs(states).max()


def test_the_states_do_not_grow_with_the_run():
    sizes = [damping_of("one", METHODS["bdf2"], n, 1).n_states for n in (2**12, 2**14)]
    # a few rates more
    assert sizes[0] < sizes[1] < sizes[0] + 8
