"""How many steps make a block, how many systems are advanced together, and what that takes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from fvi_cli.integrator.blocks.groups import Convolved, GroupPlan, pairs

LARGEST_DENSE = 2048
"""Block times samples times coupled components, at most."""
LARGEST_COUPLED = (16, 32, 4096)
"""Samples times coupled components, at most, on few steps and on so many or more: above, the dense
matrices of a block take longer to make than single steps with a sparse factorisation."""
LARGEST_BATCH = 2**19
"""Entries of the matrices of all systems of a batch: large ones would not stay in the cache."""
LARGEST_STRIP = 2**20
"""Entries of the matrix that sums up a group's earlier blocks."""
BATCH_BLOCK, BATCH_GROUP = 16, 256
"""Steps per block and per group where many systems share the work of a group's sums."""
LARGEST_SLICE = 128
"""Systems that are advanced together: more would not stay in the cache."""


@dataclass(frozen=True, kw_only=True)
class BlockSizes:
    """Steps per block, and blocks per group (a group's sums are direct)."""

    block: int
    blocks: int

    @property
    def group(self) -> int:
        """Steps per group."""
        return self.block * self.blocks


def block_sizes(samples: int, coupled: int, batch: int, n_steps: int) -> BlockSizes | None:
    """Sizes found to be quick by measurement; None where even small blocks would be too large.

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
    blocks = 8 if size == 1 else 4
    if batch * coupled >= BATCH_BLOCK:
        blocks = max(blocks, BATCH_GROUP // block)
        while blocks > 1 and 8 * block * blocks > n_steps:
            blocks //= 2
    while blocks > 1 and (block * samples) ** 2 * blocks > LARGEST_STRIP:
        blocks //= 2
    return BlockSizes(block=block, blocks=blocks)


@dataclass(frozen=True, kw_only=True)
class BatchPlan:
    """How the steps of a batch of linear systems are done in blocks.

    Parameters
    ----------
    convolved, n_steps
        What is convolved in each system, and N.
    width
        Systems that are advanced together.
    sizes
        Their blocks.
    with_end
        Whether the damping force at the end of the last step is wanted as well.
    """

    convolved: Convolved
    n_steps: int
    width: int
    sizes: BlockSizes
    with_end: bool

    @property
    def is_damped(self) -> bool:
        """Whether anything is remembered."""
        return self.convolved.memory > 1

    @property
    def n_blocks(self) -> int:
        """Blocks of the run; one more may give the force at the end."""
        n_steps, block = self.n_steps, self.sizes.block
        more = self.with_end and n_steps % block == 0 and not self.ends_with_group
        return -(-n_steps // block) + more

    @property
    def ends_with_group(self) -> bool:
        """Whether the force at the end would be that of finished groups alone."""
        return self.n_steps % self.sizes.group == 0

    @property
    def far(self) -> int:
        """Steps of a block that older ones act on: a finite memory reaches the first ones only."""
        return min(self.sizes.block, max(self.convolved.memory - 1, 0))

    def reach(self, place: int) -> int:
        """Steps of its group that act on the block at a place of the group."""
        return min(place * self.sizes.block, self.convolved.memory - 1) if self.is_damped else 0

    @cached_property
    def block_operations(self) -> tuple[int, ...]:
        """Multiply-adds of one system in the blocks of a group: older steps of it, and its own."""
        if not self.is_damped:
            return (0,) * self.sizes.blocks
        e, m, block = self.convolved.coupled, self.convolved.samples, self.sizes.block
        memories = self.convolved.memories
        # what a block sums over its own steps stands in its matrix
        own = sum(pairs(block, memory) + block for memory in memories)
        strip = len(memories) * self.far
        return tuple(
            e * m * m * (own + strip * self.reach(place)) for place in range(self.sizes.blocks)
        )

    @property
    def end_operations(self) -> int:
        """The same for the force at the end where that is one of finished groups alone."""
        if not (self.with_end and self.is_damped and self.ends_with_group):
            return 0
        reached = (min(memory, self.n_steps + 1) - 1 for memory in self.convolved.memories)
        return self.convolved.coupled * sum(reached)

    @property
    def operations(self) -> int:
        """Multiply-adds of the memory of one system in the whole run."""
        if not self.is_damped:
            return 0
        whole, rest = divmod(self.n_blocks, self.sizes.blocks)
        groups = GroupPlan(convolved=self.convolved, group=self.sizes.group, n_steps=self.n_steps)
        inside = whole * sum(self.block_operations) + sum(self.block_operations[:rest])
        return inside + self.end_operations + groups.operations(whole)


def plan_batch(
    convolved: Convolved, batch: int, n_steps: int, *, with_end: bool = False
) -> BatchPlan | None:
    """Blocks for any number of systems; None where they would be too large.

    Parameters
    ----------
    convolved, n_steps, with_end
        As for :class:`BatchPlan`.
    batch
        Number q of systems.
    """
    n_slices = -(-batch // LARGEST_SLICE)
    width = -(-batch // n_slices)
    sizes = block_sizes(convolved.samples, convolved.coupled, width, n_steps)
    if sizes is None:
        return None
    return BatchPlan(
        convolved=convolved, n_steps=n_steps, width=width, sizes=sizes, with_end=with_end
    )
