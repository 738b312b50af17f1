"""History by FFT doubling against the sum written out."""

import numpy as np
import pytest
from spread import spread

from fvi_cli.integrator.blocks.history import (
    BatchedChannel,
    GroupHistory,
    lag_kernel,
    reversed_strip,
)
from fvi_cli.integrator.blocks.stepped_history import SteppedHistory
from fvi_cli.integrator.equal_steps.direct_history import DirectHistory
from fvi_cli.integrator.equal_steps.weights import Channel, Memory

RNG = np.random.default_rng(20240318)


def decaying(n: int, shape: tuple[int, ...]) -> np.ndarray:
    """Weights like those of a fractional derivative, with random signs and sizes."""
    size = (1.0 + np.arange(n)) ** -1.3
    return size.reshape(-1, *[1] * len(shape)) * RNG.normal(size=(n, *shape))


def literal_force(channels: list[Channel], samples: np.ndarray) -> np.ndarray:
    """Force of all older samples on every step, shape as the samples ``(n, m, d)``."""
    force = np.zeros_like(samples)
    for channel in channels:
        for k in range(samples.shape[0]):
            for lag in range(1, min(k + 1, channel.memory)):
                w = channel.weights[lag]
                past = samples[k - lag]
                force[k] += w * past @ channel.direction
    return force


def random_channels(kind: str, n: int, d: int) -> list[Channel]:
    def direction() -> np.ndarray:
        matrix = RNG.normal(size=(d, d))
        return matrix + matrix.T

    if kind == "scalar":
        return [Channel(direction=direction(), weights=decaying(n, ()))]
    if kind == "finite":
        return [Channel(direction=direction(), weights=decaying(5, ()))]
    return [
        Channel(direction=direction(), weights=decaying(n, ())),
        Channel(direction=direction(), weights=decaying(4, ())),
        Channel(direction=direction(), weights=decaying(n, ())),
    ]


KINDS = ("scalar", "finite", "several")


@spread(kind=KINDS, **{"n, group": [(64, 8), (61, 8), (7, 8), (96, 16), (130, 16)]}, d=[1, 3])
def test_steps_one_at_a_time(kind, n, group, d):
    m = 2
    channels = random_channels(kind, n + 1, d)
    samples = RNG.normal(size=(n + 1, m, d))
    memory = Memory(
        channels=tuple(channels),
        sample_matrix=np.zeros((2, m)),
        carry_matrix=np.zeros((2, m)),
        first_offset=np.zeros((m, d)),
        offset=np.zeros((m, d)),
        force_weights=np.zeros((3, m)),
    )
    expected = literal_force(channels, samples)
    for history in (SteppedHistory(memory, n, d, group), DirectHistory(memory, n, d)):
        worst = 0.0
        for k in range(n + 1):
            worst = max(worst, float(np.abs(history.known() - expected[k]).max()))
            if k < n:
                history.push(samples[k])
        assert worst <= 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("kind", KINDS)
def test_one_wrong_weight_is_seen(kind):
    """The control: the last weight that matters, changed by a tenth of a percent."""
    n, group, m = 64, 8, 2
    channels = random_channels(kind, n, 1)
    samples = RNG.normal(size=(1, n, m, 1))
    expected = literal_force(channels, samples[0])

    def by_groups(used: list[Channel]) -> np.ndarray:
        batched = tuple(BatchedChannel(channel=c, directions=c.direction[None]) for c in used)
        history = GroupHistory(batched, m, group, n)
        kernel = lag_kernel(batched, 0, group, m)
        result = np.zeros((n, m))
        for index in range(n // group):
            own = samples[:, index * group : (index + 1) * group]
            force = history.force_on(index)[0, :, :, 0]
            for row in range(1, group):
                strip = reversed_strip(kernel, 1, row)[0] if row < group else None
                force[row] += strip @ own[0, :row].ravel()
            result[index * group : (index + 1) * group] = force
            history.finish(index, own)
        return result[:, :, None]

    scale = np.abs(expected).max()
    assert np.abs(by_groups(channels) - expected).max() <= 1e-13 * scale
    weights = channels[0].weights.copy()
    weights[min(40, channels[0].memory - 1)] *= 1.001
    wrong = Channel(direction=channels[0].direction, weights=weights)
    assert np.abs(by_groups([wrong, *channels[1:]]) - expected).max() > 1e-9 * scale


def test_operations_grow_like_n_log_n_squared():
    """Counted, not timed: against the direct sum, which quadruples."""
    counts = []
    for n in (2**10, 2**12, 2**14):
        channel = Channel(direction=np.eye(1), weights=decaying(n + 1, ()))
        history = GroupHistory(
            (BatchedChannel(channel=channel, directions=np.eye(1)[None]),), 1, 64, n
        )
        for index in range(n // 64):
            history.finish(index, np.zeros((1, 64, 1, 1)))
        counts.append(history.operations)
    assert counts[2] < 6.5 * counts[1] < 6.5**2 * counts[0]
    assert counts[2] < 2**27 / 8


def test_a_finite_memory_costs_no_transform():
    counts = []
    for n in (256, 512):
        channel = Channel(direction=np.eye(1), weights=decaying(4, ()))
        history = GroupHistory(
            (BatchedChannel(channel=channel, directions=np.eye(1)[None]),), 1, 32, n
        )
        for index in range(n // 32):
            history.finish(index, np.zeros((1, 32, 1, 1)))
        counts.append(history.operations)
    assert counts == [7 * 9, 15 * 9]
