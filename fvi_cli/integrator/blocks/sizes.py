"""How many steps make a block, how many systems are advanced together, and what that takes."""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.integrator.blocks.convolved import Convolved, pairs

LARGEST_DENSE = 2048
"""Block times samples times coupled components, at most."""
LARGEST_COUPLED = (16, 32, 4096)
"""Samples times coupled components, at most, on few steps and on so many or more: above, the dense
matrices of a block take longer to make than single steps with a sparse factorisation."""
LARGEST_BATCH = 2**19
"""Entries of the matrices of all systems of a batch: large ones would not stay in the cache."""
BATCH_BLOCK = 16
"""Steps per block where many systems share the work on the past."""
LARGEST_SLICE = 128
"""Systems that are advanced together: more would not stay in the cache."""


def block_size(samples: int, coupled: int, batch: int, n_steps: int) -> int | None:
    """A size found to be quick by measurement; None where even small blocks would be too large.

    Parameters
    ----------
    samples, coupled
        Samples m of a step, and components e of a system.
    batch
        Number q of systems that are advanced together, at most `LARGEST_SLICE`.
    n_steps
        N.
    """
    size = samples * coupled
    few, many, long = LARGEST_COUPLED
    if coupled > 1 and size > (few if n_steps < long else many):
        return None
    block = BATCH_BLOCK if batch >= BATCH_BLOCK else 128 if size == 1 else 64
    while block > 8 and (
        block * size > LARGEST_DENSE or (batch > 1 and batch * (block * size) ** 2 > LARGEST_BATCH)
    ):
        block //= 2
    while block > 8 and 32 * block > n_steps:
        block //= 2
    return block


@dataclass(frozen=True, kw_only=True)
class BatchPlan:
    """How the steps of a batch of linear systems are done in blocks.

    Parameters
    ----------
    convolved, n_steps
        What is convolved in each system, and N.
    width
        Systems that are advanced together.
    block
        Steps of a block.
    """

    convolved: Convolved
    n_steps: int
    width: int
    block: int

    @property
    def is_damped(self) -> bool:
        """Whether anything is remembered."""
        return self.convolved.memory > 1

    @property
    def n_blocks(self) -> int:
        """Blocks of the run."""
        return -(-self.n_steps // self.block)

    @property
    def far(self) -> int:
        """Steps of a block that older ones act on: a finite memory reaches the first ones only."""
        return min(self.block, max(self.convolved.memory - 1, 0))

    @property
    def block_operations(self) -> int:
        """Multiply-adds of one system in a block among its own steps, which its matrix holds."""
        if not self.is_damped:
            return 0
        e, m = self.convolved.coupled, self.convolved.samples
        own = sum(pairs(self.block, memory) + self.block for memory in self.convolved.memories)
        return e * m * m * own

    @property
    def operations(self) -> int:
        """Multiply-adds of the memory of one system in the whole run."""
        per_block = self.block_operations + self.far * self.convolved.operations_per_step
        return self.n_blocks * per_block


def plan_batch(convolved: Convolved, batch: int, n_steps: int) -> BatchPlan | None:
    """Blocks for any number of systems; None where they would be too large.

    Parameters
    ----------
    convolved, n_steps
        As for :class:`BatchPlan`.
    batch
        Number q of systems.
    """
    n_slices = -(-batch // LARGEST_SLICE)
    width = -(-batch // n_slices)
    block = block_size(convolved.samples, convolved.coupled, width, n_steps)
    if block is None:
        return None
    return BatchPlan(convolved=convolved, n_steps=n_steps, width=width, block=block)
