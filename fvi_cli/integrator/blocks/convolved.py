"""What is convolved with the past of equal steps, and how many multiply-adds that takes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Convolved:
    """What is convolved in each of a number of systems.

    Parameters
    ----------
    memories
        Number M of weights of every direction of the damping.
    samples, coupled
        Samples m of a step, and components e of a system.
    near
        From this lag on weights are exponentials.
    n_rates
        Number J of these; 0 where no weight is.
    """

    memories: tuple[int, ...]
    samples: int
    coupled: int
    near: int
    n_rates: int

    @property
    def memory(self) -> int:
        """The largest number of weights; 0 without damping."""
        return max(self.memories, default=0)

    @property
    def size(self) -> int:
        """Numbers in the samples of a step."""
        return self.samples * self.coupled

    @property
    def reach(self) -> int:
        """How many of the last steps are remembered one by one."""
        return max(min(self.memory, self._most_near) - 1, 0)

    @property
    def _most_near(self) -> int:
        return self.near if self.n_rates else self.memory

    @property
    def operations_per_step(self) -> int:
        """Multiply-adds of one system from all older steps to one, and from it to the states."""
        if self.memory <= 1:
            return 0
        behind = sum(min(memory, self._most_near) - 1 for memory in self.memories)
        long = sum(memory > self.near for memory in self.memories)
        return self.size * (behind + (long + 1) * self.n_rates)


def pairs(count: int, memory: int) -> int:
    """How many earlier steps, at most M - 1 for each, the first `count` steps look back to."""
    rising = min(count, memory)
    return rising * (rising - 1) // 2 + (count - rising) * (memory - 1)


def direct_operations(convolved: Convolved, count: int) -> int:
    """Multiply-adds of every sum over the past of the first `count` steps, written out."""
    return convolved.size * sum(pairs(count, memory) for memory in convolved.memories)
