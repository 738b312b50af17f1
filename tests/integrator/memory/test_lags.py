"""The past of backward differences as states, against the sum written out."""

import numpy as np
import pytest
from spread import spread

from fvi_cli.integrator.memory.interface import Combination
from fvi_cli.integrator.memory.lags import Lags
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.bdf import difference_weights

RNG = np.random.default_rng(20240318)
H = 0.01
ORDERS = {"one": (0.5,), "finite": (1.0,), "several": (0.3, 1.0, 1.7)}
METHODS = {
    "bdf1": Method(cq="bdf1", sampling="nodes", degree=1),
    "bdf2": Method(cq="bdf2", degree=1),
    "bdf4": Method(cq="bdf4", degree=2),
    "bdf6": Method(cq="bdf6", degree=3),
}


def memory_of(kind: str, method: Method, n: int, *, writes_out: bool = False) -> Lags:
    exponents = [1.0 - order for order in ORDERS[kind]]
    return Lags(method, exponents, n_steps=n, final_time=H * n, writes_out=writes_out)


def directions_of(memory: Lags, members: int, d: int) -> list[Combination]:
    """All terms along one matrix, and the last one along another, of every member."""
    rows = len(memory.terms)
    first, second = (rows_ + np.swapaxes(rows_, 1, 2) for rows_ in RNG.random((2, members, d, d)))
    factors = RNG.random((members, rows))
    return [
        Combination.made(memory, [memory.terms], factors, first),
        Combination.made(memory, [memory.terms[-1:]], factors[:, :1], second),
    ]


def literal_force(
    memory: Lags, method: Method, directions: list[Combination], unknowns: np.ndarray
) -> np.ndarray:
    """Force of all older steps on every one, ``(q, n, m, d)``: samples, then weights."""
    tables, n = step_tables(method), unknowns.shape[1]
    sample = tables.sample_basis[1:].T
    own = H * (sample @ unknowns)
    samples = own.copy()
    samples[:, 1:] += H * ((np.eye(tables.degree)[-1:] - sample) @ unknowns[:, :-1])
    force = np.zeros_like(samples)
    for one in directions:
        for place, factor in zip(one.places[0], one.factors.T, strict=True):
            order = 1.0 - memory.terms[place]
            weights = H**-order * difference_weights(method.bdf_order, order, n)
            for k in range(n):
                # the newest step is not among the older ones, but what it shares with the one
                # before is
                sums = np.tensordot(weights[1 : k + 1], samples[:, :k][:, ::-1], (0, 1))
                past = sums + weights[0] * (samples[:, k] - own[:, k])
                force[:, k] += (factor[:, None, None] * past) @ one.matrices
    return force


def by_blocks(
    memory: Lags, directions: list[Combination], unknowns: np.ndarray, block: int
) -> np.ndarray:
    """States between blocks of several lengths, lags inside of them."""
    q, n, s, d = unknowns.shape
    states, force, tables = np.zeros((q, memory.n_states, d)), [], memory.kernels(H, block)
    done, count = 0, block
    while done < n:
        own = unknowns[:, done : done + count]
        taken = own.shape[1]
        total = tables.past([states] * len(directions), directions, taken)
        total = total.reshape(q, taken, -1, d)
        for one in directions:
            lags = one.combine(tables.lags)
            for lag in range(1, taken):
                total[:, lag:] += np.matmul(
                    lags[:, lag - 1, None] @ own[:, :-lag], one.matrices[:, None]
                )
        force.append(total)
        states = tables.push(states, own.reshape(q, taken * s, d), taken)
        done, count = done + taken, count // 2 or block
    return np.concatenate(force, axis=1)


@spread(
    kind=ORDERS, **{"n, block": [(61, 8), (300, 64), (700, 16), (7, 8), (500, 300)]}, case=METHODS
)
def test_blocks_of_any_length(kind, n, block, case):
    method, d = METHODS[case], 1 + n % 3
    memory = memory_of(kind, method, n)
    directions = directions_of(memory, 2, d)
    unknowns = RNG.normal(size=(2, n, method.degree, d))
    expected = literal_force(memory, method, directions, unknowns)
    found = by_blocks(memory, directions, unknowns, block)
    assert np.abs(found - expected).max() <= 2e-13 * np.abs(expected).max()


@spread(kind=ORDERS, case=METHODS, writes_out=[False, True])
def test_steps_one_at_a_time(kind, case, writes_out):
    n, method = 300, METHODS[case]
    memory = memory_of(kind, method, n, writes_out=writes_out)
    directions = directions_of(memory, 1, 2)
    unknowns = RNG.normal(size=(1, n, method.degree, 2))
    expected = literal_force(memory, method, directions, unknowns)
    found = by_blocks(memory, directions, unknowns, 1)
    assert np.abs(found - expected).max() <= 2e-13 * np.abs(expected).max()
    if writes_out and kind != "finite":
        assert memory.n_states == n * method.degree


@pytest.mark.parametrize("lag", [1, 40, 200])
def test_one_wrong_weight_is_seen(lag):
    """The control: a weight that is a tenth of a percent off, or all that come from one rate."""
    method = METHODS["bdf2"]
    memory = memory_of("one", method, 300)
    directions = directions_of(memory, 1, 1)
    unknowns = RNG.normal(size=(1, 300, 1, 1))
    expected = literal_force(memory, method, directions, unknowns)
    kernels, near, far = (one.copy() for one in memory._weights)
    if lag <= memory.n_lags:
        near[:, lag] += 1e-3 * kernels[:, lag]
        kernels[:, lag] *= 1.001
    else:
        far[:, np.searchsorted(memory._rates, 1 / lag)] *= 1.001
    memory._weights = kernels, near, far
    found = by_blocks(memory, directions, unknowns, 16)
    assert np.abs(found - expected).max() > 1e-9 * np.abs(expected).max()


@spread(kind=ORDERS, case=METHODS, steps=[1, 5, 64, 300])
def test_a_block_is_so_many_steps(kind, case, steps):
    method = METHODS[case]
    memory = memory_of(kind, method, 1000)
    single, block = memory.kernels(H, 1), memory.kernels(H, 300)
    inputs = RNG.normal(size=(2, steps * method.degree, 1))
    begin = states = RNG.normal(size=(2, memory.n_states, 1))
    whole = block.push(states, inputs, steps)
    undriven = states + block.change_of_all(steps) @ states
    for one in np.split(inputs, steps, axis=1):
        states = single.push(states, one, 1)
    assert np.abs(whole - states).max() <= 1e-13 * np.abs(states).max()
    without = block.push(begin, np.zeros_like(inputs), steps)
    assert np.abs(undriven - without).max() <= 1e-13 * np.abs(begin).max()


def test_the_states_do_not_grow_with_the_run():
    sizes = [memory_of("one", METHODS["bdf2"], n).n_states for n in (2**12, 2**14)]
    # a few rates more
    assert sizes[0] < sizes[1] < sizes[0] + 8
