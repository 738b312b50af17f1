"""The history by groups for steps that are taken one at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.blocks.groups import Convolved, GroupPlan, direct_operations
from fvi_cli.integrator.blocks.history import BatchedChannel, GroupHistory
from fvi_cli.integrator.equal_steps.direct_history import DirectHistory
from fvi_cli.integrator.equal_steps.weights import Memory

Array = NDArray[np.float64]

STEPPED_GROUP = 128
"""Steps per group where they are taken one at a time."""


def stepped_operations(convolved: Convolved, n_steps: int) -> int:
    """Multiply-adds of N steps and the force at their end, taken one at a time."""
    if not convolved.memories:
        return 0
    groups, rest = divmod(n_steps + 1, STEPPED_GROUP)
    inside = groups * direct_operations(convolved, STEPPED_GROUP)
    plan = GroupPlan(convolved=convolved, group=STEPPED_GROUP, n_steps=n_steps + 1)
    return inside + direct_operations(convolved, rest) + plan.operations(n_steps // STEPPED_GROUP)


class SteppedHistory:
    """The same history for steps taken one at a time: what `DirectHistory` gives, in less work.

    Parameters
    ----------
    memory
        Weights and directions.
    n_steps
        Number N of steps; the force at the end of the last is available as well.
    dimension
        Number d of degrees of freedom.
    group
        Steps per group, summed directly among themselves.
    """

    def __init__(
        self, memory: Memory, n_steps: int, dimension: int, group: int = STEPPED_GROUP
    ) -> None:
        m = memory.sample_matrix.shape[1]
        batched = tuple(
            BatchedChannel(channel=c, directions=c.direction[None]) for c in memory.channels
        )
        self._group, self._dimension = group, dimension
        self._groups = GroupHistory(batched, m, group, n_steps + 1)
        near = tuple(replace(c, weights=c.weights[:group]) for c in memory.channels)
        self._near = replace(memory, channels=near)
        self._own = DirectHistory(self._near, group, dimension)
        self._count = 0
        self._force = np.zeros((group, m, dimension))
        self._samples = np.zeros((group, m, dimension))
        self._direct = 0

    @property
    def operations(self) -> int:
        """Multiply-adds done so far."""
        return self._direct + self._own.operations + self._groups.operations

    def known(self) -> Array:
        """Force of all finished samples on the step to come, shape ``(m, d)``."""
        return np.asarray(self._force[self._count % self._group] + self._own.known())

    def push(self, samples: Array) -> None:
        """Append the samples of a finished step, shape ``(m, d)``."""
        self._samples[self._count % self._group] = samples
        self._own.push(samples)
        self._count += 1
        if self._count % self._group == 0:
            self._direct += self._own.operations
            self._own = DirectHistory(self._near, self._group, self._dimension)
            index = self._count // self._group
            self._groups.finish(index - 1, self._samples[None])
            if index * self._group < self._groups.samples.shape[-1]:
                self._force = self._groups.force_on(index)[0]
