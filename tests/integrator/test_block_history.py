"""The past of equal steps in blocks against the sum written out."""

from dataclasses import replace

import numpy as np
import pytest
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.blocks.history import BatchedChannel, BlockHistory, SteppedHistory
from fvi_cli.integrator.equal_steps.direct_history import DirectHistory
from fvi_cli.integrator.equal_steps.weights import Channel, Memory, build_channels
from fvi_cli.integrator.method import Method

RNG = np.random.default_rng(20240318)
ORDERS = {"one": (0.5,), "finite": (1.0,), "several": (0.3, 1.0, 1.7)}
M = 2


def channels_of(kind: str, bdf_order: int, n: int, d: int) -> tuple[Channel, ...]:
    damping = []
    for order in ORDERS[kind]:
        matrix = RNG.normal(size=(d, d))
        damping.append(FractionalDamping(order=order, coefficient=matrix @ matrix.T))
    method = Method(cq=f"bdf{bdf_order}", degree=1)
    return build_channels(method, 0.01, n, tuple(damping))


def literal_force(channels: tuple[Channel, ...], samples: np.ndarray) -> np.ndarray:
    """Force of all older samples on every step, shape as the samples ``(n, m, d)``."""
    force = np.zeros_like(samples)
    for channel in channels:
        for k in range(1, samples.shape[0]):
            reach = min(k, channel.memory - 1)
            sums = np.tensordot(channel.weights[1 : reach + 1], samples[k - reach : k][::-1], 1)
            force[k] += sums @ channel.direction
    return force


def by_blocks(channels: tuple[Channel, ...], samples: np.ndarray, block: int) -> np.ndarray:
    """Only what is between blocks; blocks of several lengths."""
    batched = tuple(BatchedChannel(channel=c, directions=c.direction[None]) for c in channels)
    history, force, done, count = BlockHistory(batched, M, block), [], 0, block
    while done < samples.shape[0]:
        own = samples[done : done + count]
        force.append(history.force(own.shape[0])[0] + literal_force(channels, own))
        history.push(own[None])
        done, count = done + count, count // 2 or block
    return np.concatenate(force)


@spread(kind=ORDERS, **{"n, block": [(61, 8), (300, 64), (700, 16), (7, 8)]}, bdf_order=[1, 2, 6])
def test_blocks_of_any_length(kind, n, block, bdf_order):
    d = 1 + n % 3
    channels = channels_of(kind, bdf_order, n + 1, d)
    samples = RNG.normal(size=(n, M, d))
    expected = literal_force(channels, samples)
    found = by_blocks(channels, samples, block)
    assert np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()


@spread(kind=ORDERS, n=[64, 300], d=[1, 3])
def test_steps_one_at_a_time(kind, n, d):
    channels = channels_of(kind, 5, n + 1, d)
    samples = RNG.normal(size=(n + 1, M, d))
    memory = Memory(
        channels=channels,
        sample_matrix=np.zeros((2, M)),
        carry_matrix=np.zeros((2, M)),
        first_offset=np.zeros((M, d)),
        offset=np.zeros((M, d)),
        force_weights=np.zeros((3, M)),
    )
    expected = literal_force(channels, samples)
    for history in (SteppedHistory(memory), DirectHistory(memory, n, d)):
        worst = 0.0
        for k in range(n + 1):
            worst = max(worst, float(np.abs(history.known() - expected[k]).max()))
            if k < n:
                history.push(samples[k])
        assert worst <= 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("lag", [1, 40, 200])
def test_one_wrong_weight_is_seen(lag):
    """The control: a weight that is a tenth of a percent off, or all that come from one rate."""
    (channel,) = channels_of("one", 2, 301, 1)
    samples = RNG.normal(size=(300, M, 1))
    expected = literal_force((channel,), samples)
    if lag < channel.tail.near:
        weights = channel.weights.copy()
        weights[lag] *= 1.001
        wrong = replace(channel, weights=weights)
    else:
        factors = channel.tail.factors.copy()
        factors[0, np.searchsorted(channel.tail.rates, 1 / lag)] *= 1.001
        wrong = replace(channel, tail=replace(channel.tail, factors=factors))
    found = by_blocks((wrong,), samples, 16)
    assert np.abs(found - expected).max() > 1e-9 * np.abs(expected).max()


def test_work_and_memory_of_a_step_do_not_grow():
    """Counted, not timed."""
    counts = []
    for n in (2**12, 2**14):
        channels = channels_of("one", 2, n + 1, 1)
        batched = tuple(BatchedChannel(channel=c, directions=c.direction[None]) for c in channels)
        history = BlockHistory(batched, 1, 64)
        for _ in range(n // 64):
            history.push(np.zeros((1, 64, 1, 1)))
        counts.append(history.operations)
    # a few rates more
    assert 4 * counts[0] < counts[1] < 4.5 * counts[0]
