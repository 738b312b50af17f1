"""How many steps make a block, and how many systems are advanced together."""

from __future__ import annotations

from dataclasses import dataclass

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


def batch_sizes(
    samples: int, coupled: int, batch: int, n_steps: int
) -> tuple[int, BlockSizes] | None:
    """Systems that are advanced together and their blocks, for any number of systems.

    Parameters as for `block_sizes`; None where the blocks would be too large.
    """
    n_slices = -(-batch // LARGEST_SLICE)
    width = -(-batch // n_slices)
    sizes = block_sizes(samples, coupled, width, n_steps)
    return None if sizes is None else (width, sizes)
