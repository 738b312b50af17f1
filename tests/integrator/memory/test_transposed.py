"""Transposed maps of both memories: by scalar products with the maps themselves."""

import numpy as np
from spread import spread

from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.interface import Combination, Kernels
from fvi_cli.integrator.memory.lags import Lags
from fvi_cli.integrator.method import Method

TERMS = (0.5, 0.0, -0.7)
MEMORIES = {
    "gauss3": Exponentials(
        Method(cq="gauss", degree=3), TERMS, shortest_step=0.1, final_time=10.0, steps=100
    ),
    "radau2": Exponentials(
        Method(cq="radau-iia", degree=2), TERMS, shortest_step=0.1, final_time=10.0, steps=100
    ),
    "bdf1": Lags(
        Method(cq="bdf1", sampling="nodes", degree=1), TERMS, n_steps=100, final_time=10.0
    ),
    "bdf4": Lags(Method(cq="bdf4", degree=2), TERMS, n_steps=100, final_time=10.0),
    "direct": Lags(
        Method(cq="bdf3", degree=2), TERMS, n_steps=100, final_time=10.0, writes_out=True
    ),
}


@spread(name=MEMORIES, **{"block, count": [(1, 1), (8, 8), (8, 3), (90, 77)]}, members=[1, 3])
def test_transposed_maps(name, block, count, members):
    rng = np.random.default_rng(block + members)
    memory, e = MEMORIES[name], 2
    kernels: Kernels = memory.kernels(0.1, block)
    states = rng.normal(size=(members, memory.n_states, e))
    inputs = rng.normal(size=(members, count * kernels.n_inputs, e))
    behind = rng.normal(size=states.shape)
    back, by_input = kernels.pull(behind, count)
    pairs = [behind * kernels.push(states, inputs, count), back * states, by_input * inputs]
    assert np.isclose(pairs[0].sum(), pairs[1].sum() + pairs[2].sum(), rtol=0, atol=scale(pairs))
    # the control: a map of other steps
    wrong, _ = kernels.pull(behind, count - 1 or block)
    if count > 1:
        assert not np.isclose(pairs[0].sum(), (wrong * states).sum() + pairs[2].sum(), rtol=1e-6)
    matrices = rng.normal(size=(2, members, e, e))
    matrices = matrices + matrices.swapaxes(2, 3)
    directions = [
        Combination.made(memory, [TERMS], rng.normal(size=(members, 3)), matrices[0]),
        Combination.made(memory, [TERMS[2:]], np.ones((1, 1)), matrices[1]),
    ]
    own = [states, rng.normal(size=states.shape)]
    force = kernels.past(own, directions, count)
    weights = rng.normal(size=force.shape)
    found = kernels.past_transposed(weights, directions, count)
    pairs = [weights * force, *(a * b for a, b in zip(found, own, strict=True))]
    right = sum(one.sum() for one in pairs[1:])
    assert np.isclose(pairs[0].sum(), right, rtol=0, atol=scale(pairs))


def scale(pairs: list[np.ndarray]) -> float:
    return 1e-13 * sum(float(np.abs(one).sum()) for one in pairs)
