"""The history as its definition says: every sum written out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.equal_steps.weights import Memory

Array = NDArray[np.float64]


class DirectHistory:
    """The finished part of the convolution, summed directly: O(N) per step, the witness.

    Samples are kept in the order of time and weights in reverse, so that the sum of one step is
    one matrix product.
    """

    def __init__(self, memory: Memory, n_steps: int, dimension: int) -> None:
        self._channels = memory.channels
        self._samples = np.zeros((n_steps + 1, memory.sample_matrix.shape[1], dimension))
        self._reversed = [
            np.ascontiguousarray(channel.weights[::-1]) for channel in memory.channels
        ]
        self._count = 0
        self.operations = 0

    def known(self) -> Array:
        """Force of all finished samples on the step to come, shape ``(m, d)``."""
        _, m, d = self._samples.shape
        force = np.zeros((m, d))
        for channel, backwards in zip(self._channels, self._reversed, strict=True):
            length = min(self._count, channel.memory - 1)
            if length == 0:
                continue
            past = self._samples[self._count - length : self._count]
            end = channel.memory - 1
            total = (backwards[end - length : end] @ past.reshape(length, m * d)).reshape(m, d)
            self.operations += length * m * d
            force += total @ channel.direction
        return force

    def push(self, samples: Array) -> None:
        """Append the samples of a finished step, shape ``(m, d)``."""
        self._samples[self._count] = samples
        self._count += 1
