"""What becomes of finished groups of steps, and how many multiply-adds that takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

LARGEST_NEAR = 192
"""Lags below this, over the numbers in a sample, are summed directly: a transform of all weights
would round each of them as if it were as large as the first."""


@dataclass(frozen=True, kw_only=True)
class Convolved:
    """What is convolved in each of a number of systems.

    Parameters
    ----------
    memories
        Number M of weights of every direction of the damping.
    samples, coupled
        Samples m of a step, and components e of a system.
    """

    memories: tuple[int, ...]
    samples: int
    coupled: int

    @property
    def memory(self) -> int:
        """The largest number of weights; 0 without damping."""
        return max(self.memories, default=0)

    @property
    def size(self) -> int:
        """Numbers in the samples of a step."""
        return self.samples * self.coupled


def pairs(count: int, memory: int) -> int:
    """How many earlier steps, at most M - 1 for each, the first `count` steps look back to."""
    rising = min(count, memory)
    return rising * (rising - 1) // 2 + (count - rising) * (memory - 1)


def direct_operations(convolved: Convolved, count: int) -> int:
    """Multiply-adds of every sum over the past of the first `count` steps, written out."""
    return convolved.size * sum(pairs(count, memory) for memory in convolved.memories)


@dataclass(frozen=True, kw_only=True)
class GroupPlan:
    """How finished groups are convolved into later ones.

    Parameters
    ----------
    convolved
        What is.
    group, n_steps
        Steps of a group, and how many are wanted in all.
    """

    convolved: Convolved
    group: int
    n_steps: int

    @cached_property
    def n_groups(self) -> int:
        """Number of groups, the last one perhaps not whole."""
        return -(-self.n_steps // self.group)

    @cached_property
    def is_long(self) -> tuple[bool, ...]:
        """Which sequences of weights reach further than the next group: by transforms."""
        return tuple(memory - 1 > self.group for memory in self.convolved.memories)

    @cached_property
    def is_short(self) -> tuple[bool, ...]:
        """Which reach into the next group only: directly."""
        return tuple(1 < memory <= self.group + 1 for memory in self.convolved.memories)

    @cached_property
    def near(self) -> int:
        """Lags below this are summed directly."""
        if not any(self.is_long):
            return 1
        return min(self.group, max(1, LARGEST_NEAR // self.convolved.size))

    @cached_property
    def reach(self) -> int:
        """Steps before and behind the end of a group that are connected directly."""
        if self.n_groups <= 1 or not (any(self.is_short) or self.near > 1):
            return 0
        sequences = zip(self.convolved.memories, self.is_short, strict=True)
        return max([self.near, *(memory for memory, is_short in sequences if is_short)]) - 1

    def spread(self, finished: int) -> tuple[int, int, int]:
        """What the transforms after so many finished groups do.

        Returns
        -------
        tuple of int
            From how many steps they go, on how many, and their length.
        """
        power = finished & -finished
        length = power * self.group
        wanted = min(power, self.n_groups - finished) * self.group
        # what wraps around falls on the first `length` entries, which are not used
        period = 2 * length if wanted == length else even_fast_length(length + wanted)
        return length, wanted, period

    def operations_after(self, finished: int) -> int:
        """Multiply-adds, of one system, of what is done once so many groups are finished."""
        if finished >= self.n_groups:
            return 0
        e, m = self.convolved.coupled, self.convolved.samples
        n_long = sum(self.is_long)
        total = (sum(self.is_short) + n_long) * e * (self.reach * m) ** 2
        if n_long:
            _, _, period = self.spread(finished)
            # 5/4 n log2(n) for a real transform, 4 for a complex product
            total += 2 * m * e * int(1.25 * period * math.log2(period))
            total += 4 * n_long * m * e * e * (period // 2 + 1)
        return total

    def operations(self, finished: int) -> int:
        """The same from the first group to as many finished ones."""
        spreading = min(finished, self.n_groups - 1)
        total, power = 0, 1
        while power <= spreading:
            # odd multiples of a power of two are alike, but the last, where the run may end
            count = (spreading // power + 1) // 2
            total += (count - 1) * self.operations_after(power)
            total += self.operations_after((2 * count - 1) * power)
            power *= 2
        return total


def even_fast_length(at_least: int) -> int:
    """The smallest even 2^a 3^b >= `at_least` with b <= 2: lengths whose transforms are quick."""
    candidates = []
    for factor in (1, 3, 9):
        power = 2
        while power * factor < at_least:
            power *= 2
        candidates.append(power * factor)
    return min(candidates)
