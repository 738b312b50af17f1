r"""The past of equal steps: the last ones one by one, all older ones as exponentials.

Behind `near` lags the weights are :math:`w_n = \sum_j c_j e^{-n y_j}`
(:mod:`fvi_cli.integrator.convolution.backward_differences`), so that J numbers for every sample of
a step stand for the whole past,

.. math:: S_j = \sum_{n \geq 1} e^{-n y_j} U_{k - n}, \qquad
          F_k = \sum_{n < \text{near}} \Bigl(w_n - \sum_j c_j e^{-n y_j}\Bigr) U_{k - n}
                + \sum_j c_j S_j .
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.blocks.convolved import Convolved
from fvi_cli.integrator.equal_steps.weights import Channel, Memory

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchedChannel:
    """A channel for a batch of independent systems of e coupled components each.

    Parameters
    ----------
    channel
        Weights (and the direction in the scene's coordinates).
    directions
        The direction in the coordinates of the batch, shape ``(q, e, e)``.
    """

    channel: Channel
    directions: Array


def convolved_of(channels: tuple[Channel, ...], samples: int, coupled: int) -> Convolved:
    """Sizes of what channels convolve."""
    tail = channels[0].tail if channels else None
    return Convolved(
        memories=tuple(one.memory for one in channels),
        samples=samples,
        coupled=coupled,
        near=tail.near if tail else 1,
        n_rates=tail.rates.size if tail else 0,
    )


def lag_kernel(channels: tuple[BatchedChannel, ...], block: int, samples: int) -> Array:
    r"""Force of one sample after 0 <= n < `block` steps, as matrices.

    Parameters
    ----------
    channels
        The channels of one batch.
    block
        Number of lags.
    samples
        Number m of samples per step.

    Returns
    -------
    Array
        :math:`\sum_D w^{(D)}_n[i, j] D[a, b]` at ``[q, n, (i, b), (j, a)]``, shape
        ``(q, block, m e, m e)``.
    """
    q, e, _ = channels[0].directions.shape
    size = samples * e
    kernel = np.zeros((q, block, samples, e, samples, e))
    for batched in channels:
        weights = batched.channel.weights[:block]
        weights = weights[:, None, None] * np.eye(samples)
        kernel[:, : weights.shape[0]] += np.einsum(
            "nij,qab->qnibja", weights, batched.directions, optimize=False
        )
    return kernel.reshape(q, block, size, size)


class BlockHistory:
    """Force of all finished steps on those to come, block by block, in a batch of systems.

    Parameters
    ----------
    channels
        Weights and directions; none without damping.
    samples
        Number m of samples per step.
    block
        Most steps of a block.

    Attributes
    ----------
    operations
        Multiply-adds that each system has spent so far.
    """

    def __init__(self, channels: tuple[BatchedChannel, ...], samples: int, block: int) -> None:
        q, e = channels[0].directions.shape[:2] if channels else (1, 1)
        plan = convolved_of(tuple(one.channel for one in channels), samples, e)
        self._shape, self._reach = (q, e, samples), plan.reach
        self._per_step = plan.operations_per_step
        self._rates = channels[0].channel.tail.rates if channels else np.zeros(0)
        # columns: the last steps in the order of time, and the states
        self._past = np.zeros((q * e * samples, self._reach + self._rates.size))
        self._ahead = [
            (_ahead(one.channel, self._reach, block), one.directions) for one in channels
        ]
        # from the samples of a block to the states behind it, the last rows for fewer steps
        self._into = np.exp(-np.outer(np.arange(block, 0, -1), self._rates))
        self.operations = 0

    def force(self, count: int) -> Array:
        """Force of all finished steps on the next `count`, shape ``(q, count, m, e)``."""
        q, e, m = self._shape
        total = np.zeros((q, e, m * count))
        for matrix, directions in self._ahead:
            sums = (self._past @ matrix[:, :count]).reshape(q, e, m * count)
            if e == 1:
                total += directions * sums
            else:
                total += np.matmul(directions.transpose(0, 2, 1), sums)
        return total.reshape(q, e, m, count).transpose(0, 3, 2, 1)

    def push(self, samples: Array) -> None:
        """Append the samples of the next steps, shape ``(q, count, m, e)``."""
        q, e, m = self._shape
        count, reach = samples.shape[1], self._reach
        own = samples.transpose(0, 3, 2, 1).reshape(q * e * m, count)
        kept = max(reach - count, 0)
        self._past[:, :kept] = self._past[:, reach - kept : reach].copy()
        self._past[:, kept:reach] = own[:, max(count - reach, 0) :]
        if self._rates.size:
            states = self._past[:, reach:]
            into = self._into[self._into.shape[0] - count :]
            states *= into[0]
            states += own @ into
        self.operations += count * self._per_step


def _ahead(channel: Channel, reach: int, block: int) -> Array:
    """From what is remembered to the sums for the next steps, ``(reach + J, block)``."""
    tail = channel.tail
    exponentials = tail.factors[0, :, None] * np.exp(-np.outer(tail.rates, np.arange(block)))
    near = np.zeros(reach + block)
    lags = np.arange(1, min(reach + 1, channel.memory))
    near[lags] = channel.weights[lags]
    if tail.rates.size:
        last = np.arange(1, reach + 1)
        near[last] -= np.exp(-np.outer(last, tail.rates)) @ tail.factors[0]
    # the last column of the past is one step behind the first of those to come
    lag = np.arange(reach, 0, -1)[:, None] + np.arange(block)
    return np.concatenate([near[lag], exponentials])


class SteppedHistory:
    """The same for steps taken one at a time: what `DirectHistory` gives, in less work.

    Parameters
    ----------
    memory
        Weights and directions.
    """

    def __init__(self, memory: Memory) -> None:
        channels = tuple(
            BatchedChannel(channel=one, directions=one.direction[None]) for one in memory.channels
        )
        self._history = BlockHistory(channels, memory.sample_matrix.shape[1], 1)

    @property
    def operations(self) -> int:
        """Multiply-adds done so far."""
        return self._history.operations

    def known(self) -> Array:
        """Force of all finished samples on the step to come, shape ``(m, d)``."""
        return np.asarray(self._history.force(1)[0, 0])

    def push(self, samples: Array) -> None:
        """Append the samples of a finished step, shape ``(m, d)``."""
        self._history.push(samples[None, None])
