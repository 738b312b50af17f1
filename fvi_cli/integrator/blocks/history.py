r"""History in O(N log(N)^2): finished groups of steps are convolved into the future by FFT.

The steps are cut into groups of equal length. When b groups are done, the last :math:`2^j` of
them, :math:`2^j` the largest power of two that divides b, are convolved once into the next
:math:`2^j` (Hairer, Lubich, Schlichte, *Fast numerical solution of nonlinear Volterra
convolution equations*, SIAM J. Sci. Stat. Comput. 6, 1985). Inside a group the sum is direct.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.blocks.groups import Convolved, GroupPlan
from fvi_cli.integrator.equal_steps.weights import Channel

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

FREQUENCY_SLAB = 4096
"""Frequencies multiplied at a time, so that they stay in the cache."""


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


def convolved_of(channels: tuple[BatchedChannel, ...], samples: int, coupled: int) -> Convolved:
    """Sizes of what the channels of one batch convolve."""
    memories = tuple(one.channel.memory for one in channels)
    return Convolved(memories=memories, samples=samples, coupled=coupled)


def lag_kernel(channels: tuple[BatchedChannel, ...], first: int, last: int, samples: int) -> Array:
    r"""Force of one sample after `first` <= n < `last` steps, as matrices.

    Parameters
    ----------
    channels
        The channels of one batch.
    first, last
        Range of lags.
    samples
        Number m of samples per step.

    Returns
    -------
    Array
        :math:`\sum_D w^{(D)}_n[i, j] D[a, b]` at ``[q, n, (i, b), (j, a)]``, shape
        ``(q, last - first, m e, m e)``.
    """
    q, e, _ = channels[0].directions.shape
    size = samples * e
    kernel = np.zeros((q, last - first, samples, e, samples, e))
    for batched in channels:
        weights = batched.channel.weights[first:last]
        weights = weights[:, None, None] * np.eye(samples)
        kernel[:, : weights.shape[0]] += np.einsum(
            "nij,qab->qnibja", weights, batched.directions, optimize=False
        )
    return kernel.reshape(q, last - first, size, size)


def reversed_strip(kernel: Array, rows: int, reach: int) -> Array:
    """Force of the last `reach` samples on the next `rows` steps.

    Parameters
    ----------
    kernel
        From `lag_kernel` with lags 0 .. rows + reach - 1 at least, shape ``(q, n, k, k)``.
    rows, reach
        Number of steps ahead and of samples behind.

    Returns
    -------
    Array
        Shape ``(q, rows k, reach k)``; columns in the order of time, so that fewer samples take
        the last columns.
    """
    q, _, k, _ = kernel.shape
    strip = np.empty((q, rows, k, reach, k))
    backwards = kernel[:, ::-1]
    total = kernel.shape[1]
    for row in range(rows):
        # the column before the last has lag row + 2, the last row + 1
        start = total - 1 - (row + reach)
        strip[:, row] = backwards[:, start : start + reach].transpose(0, 2, 1, 3)
    return strip.reshape(q, rows * k, reach * k)


@dataclass(frozen=True, kw_only=True, eq=False)
class SharedStrip:
    """Force of the last steps on the next ones, by one matrix for all systems of a batch.

    The weights do not know of the systems; only the directions do. So the sums of a whole batch
    are one product of matrices.

    Parameters
    ----------
    batched
        Weights and directions.
    matrix
        From samples of `reach` steps to forces on `rows` steps, shape ``(reach m, rows m)``.
    """

    batched: BatchedChannel
    matrix: Array

    def force(self, past: Array) -> Array:
        """Force of the last samples, ``(q, e, n m)`` with n <= reach, as ``(q, e, rows m)``."""
        q, e, size = past.shape
        matrix, directions = self.matrix[self.matrix.shape[0] - size :], self.batched.directions
        if e == 1:
            sums = past[:, 0] @ matrix
            sums *= directions[:, 0]
            return np.asarray(sums[:, None])
        sums = (past.reshape(q * e, size) @ matrix).reshape(q, e, -1)
        return np.asarray(np.matmul(directions.transpose(0, 2, 1), sums))


def shared_strip(
    batched: BatchedChannel, rows: int, reach: int, samples: int, n_weights: int | None = None
) -> SharedStrip:
    """The force of the last `reach` steps on the next `rows`.

    Parameters
    ----------
    batched
        Weights and directions.
    rows, reach
        Number of steps ahead and behind.
    samples
        Number m of samples per step.
    n_weights
        Weights from this one on count as zero; None: all count.
    """
    unit = BatchedChannel(channel=batched.channel, directions=np.ones((1, 1, 1)))
    last = rows + reach
    kernel = np.zeros((1, last, samples, samples))
    used = last if n_weights is None else min(last, n_weights)
    kernel[:, :used] = lag_kernel((unit,), 0, used, samples)
    matrix = np.ascontiguousarray(reversed_strip(kernel, rows, reach)[0].T)
    return SharedStrip(batched=batched, matrix=matrix)


class GroupHistory:
    """Forces of finished groups on later ones, and the finished samples, in one buffer.

    Until its turn comes, a group's part of the buffer holds the force on it; afterwards its
    samples.

    Parameters
    ----------
    channels
        Directions and weights; those whose memory reaches no further than the next group are
        summed directly.
    samples
        Number m of samples per step.
    group
        Number of steps in a group.
    n_steps
        Number of steps that are wanted.

    Attributes
    ----------
    operations
        Multiply-adds that each system has spent so far.
    """

    def __init__(
        self, channels: tuple[BatchedChannel, ...], samples: int, group: int, n_steps: int
    ) -> None:
        q, e = (channels[0].directions.shape[:2]) if channels else (1, 1)
        self._plan = plan = GroupPlan(
            convolved=convolved_of(channels, samples, e), group=group, n_steps=n_steps
        )
        self._group = group
        self._end = plan.n_groups * group
        self._long = tuple(c for c, is_long in zip(channels, plan.is_long, strict=True) if is_long)
        short = tuple(c for c, is_short in zip(channels, plan.is_short, strict=True) if is_short)
        self._shape = (q, samples, e)
        # without channels there is nothing to keep
        self._buffer = np.zeros((q, samples, e, self._end if channels else 0))
        self._transforms: dict[int, list[ComplexArray]] = {}
        self.operations = 0
        self._tails: tuple[SharedStrip, ...] = ()
        if plan.reach:
            self._tails = tuple(
                shared_strip(batched, plan.reach, plan.reach, samples, wanted)
                for batched, wanted in (
                    *((one, None) for one in short),
                    *((one, plan.near) for one in self._long),
                )
            )

    @property
    def samples(self) -> Array:
        """The finished samples, shape ``(q, m, e, n)`` with n a multiple of the group."""
        return self._buffer

    def force_on(self, index: int) -> Array:
        """Force of all finished groups on group `index`, a copy of shape ``(q, group, m, e)``."""
        part = self._buffer[..., index * self._group : (index + 1) * self._group]
        return np.ascontiguousarray(part.transpose(0, 3, 1, 2))

    def finish(self, index: int, samples: Array) -> None:
        """Store the samples of group `index`, shape ``(q, group, m, e)``, and spread its force."""
        end = (index + 1) * self._group
        self._buffer[..., end - self._group : end] = samples.transpose(0, 2, 3, 1)
        finished = index + 1
        if finished >= self._plan.n_groups:
            return
        if self._tails:
            self._spread_short(end, samples)
        if self._long:
            self._spread_long(end, finished)
        self.operations += self._plan.operations_after(finished)

    def _spread_short(self, end: int, samples: Array) -> None:
        q, m, e = self._shape
        reach = self._plan.reach
        last = samples[:, -reach:].transpose(0, 3, 1, 2).reshape(q, e, -1)
        for tail in self._tails:
            force = tail.force(last).reshape(q, e, reach, m)
            self._buffer[..., end : end + reach] += force.transpose(0, 3, 1, 2)

    def _spread_long(self, end: int, finished: int) -> None:
        """Convolve the last samples into the next ones."""
        length, wanted, period = self._plan.spread(finished)
        past = self._buffer[..., end - length : end]
        target = self._buffer[..., end : end + wanted]
        again = end + 2 * length < self._end and wanted == length
        if not again and period not in self._transforms:
            self._spread_once(past, target, length, period)
            return
        if period not in self._transforms:
            self._transforms[period] = [
                _weights_transform(c.channel.weights, self._plan.near, period) for c in self._long
            ]
        spectrum = np.fft.rfft(past, period)
        total = np.zeros_like(spectrum)
        for batched, transform in zip(self._long, self._transforms[period], strict=True):
            _accumulate(total, transform, spectrum, batched)
        target += np.fft.irfft(total, period)[..., length : length + wanted]
        if not again:
            del self._transforms[period]

    def _spread_once(self, past: Array, target: Array, length: int, period: int) -> None:
        """The same with one transform of weights in memory at a time."""
        q, m, e = self._shape
        spectrum = np.fft.rfft(past, period)
        total = np.zeros((m, q, e, spectrum.shape[-1]), dtype=complex)
        for batched in self._long:
            transform = _weights_transform(batched.channel.weights, self._plan.near, period)
            for i in range(m):
                _multiply_add(total[i], transform, spectrum[:, i], batched.directions)
        del spectrum
        for i in range(m):
            target[:, i] += np.fft.irfft(total[i], period)[..., length : length + target.shape[-1]]


def _weights_transform(weights: Array, first: int, period: int) -> ComplexArray:
    """Transform of the weights from `first` on, at most `period`."""
    part = np.array(weights[:period])
    part[:first] = 0.0
    return np.asarray(np.fft.rfft(part, period))


def _accumulate(
    total: ComplexArray, transform: ComplexArray, spectrum: ComplexArray, batched: BatchedChannel
) -> None:
    """Add weights times samples times direction at every frequency, slab by slab."""
    for first in range(0, spectrum.shape[-1], FREQUENCY_SLAB):
        slab = slice(first, first + FREQUENCY_SLAB)
        for i in range(spectrum.shape[1]):
            _multiply_add(
                total[:, i, ..., slab],
                transform[slab],
                spectrum[:, i, ..., slab],
                batched.directions,
            )


def _multiply_add(
    total: ComplexArray, weights: ComplexArray, spectrum: ComplexArray, directions: Array
) -> None:
    """total[q, b] += weights sum_a spectrum[q, a] directions[q, a, b], frequencies last."""
    product = spectrum * weights
    if directions.shape[-1] > 1:
        product = np.matmul(directions.transpose(0, 2, 1), product)
    elif directions.size > 1 or directions[0, 0, 0] != 1.0:
        product *= directions
    total += product
