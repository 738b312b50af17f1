"""How long blocks of nonlinear steps are: as long as their iterations contract."""

from __future__ import annotations

LARGEST_BLOCK = 64
LEAST_BLOCK = 4
LARGEST_DENSE = 512
"""Steps of a block times samples times components, at most."""
LEAST_BLOCKS = 16
"""Largest blocks in a run of equal steps, at least."""
GROWING_ITERATIONS = 12
"""After a block with at most as many the next one is twice as long."""
PATIENCE = 16
"""Blocks before a size that has failed is tried again."""
REFRESH_AFTER = 150
"""Iterations beyond four per block that pay for a new linear response."""
LONGEST_WAIT = 512
"""Single steps after vain attempts, at most."""


def newton_block(size: int, n_steps: int, *, general: bool = False) -> int:
    """Steps of the largest block of so many equal steps; 0: they are done one by one.

    Parameters
    ----------
    size
        Samples of a step times components.
    n_steps
        Number of steps.
    general
        Whether the Lagrangian is a general one.
    """
    least = LEAST_BLOCKS
    if general:
        # velocities are unknowns as well, and the iteration takes longer
        size, least = 2 * size, 4 * least
    block = LARGEST_BLOCK
    while block >= LEAST_BLOCK and (block * size > LARGEST_DENSE or least * block > n_steps):
        block //= 2
    return block if block >= LEAST_BLOCK else 0


class BlockLengths:
    """Lengths of the next blocks from how those before went.

    Parameters
    ----------
    largest
        Steps of a block, at most.

    Attributes
    ----------
    is_stale
        Whether so many iterations were spent that a new linear response pays.
    """

    def __init__(self, largest: int) -> None:
        self._largest = self._size = self._ceiling = largest
        self._waiting, self._quiet, self._patience = 0, 0, LEAST_BLOCK
        self._excess = 0

    def trial(self, left: int) -> int:
        """Steps to attempt of those that are left; 0: a single step."""
        if self._waiting:
            self._waiting -= 1
            return 0
        count = self._size
        while count > left:
            count //= 2
        return count if count >= LEAST_BLOCK else 0

    def failed(self, count: int) -> None:
        """A block of so many steps did not contract."""
        self._size, self._ceiling, self._quiet = count // 2, max(count // 2, LEAST_BLOCK), PATIENCE
        if self._size < LEAST_BLOCK:
            # single steps for a while, longer after every vain attempt
            self._size, self._waiting = LEAST_BLOCK, self._patience
            self._patience = min(2 * self._patience, LONGEST_WAIT)

    def contracted(self, count: int, iterations: int) -> None:
        """A block of so many steps took these iterations."""
        self._patience = LEAST_BLOCK
        self._quiet = max(0, self._quiet - 1)
        if self._quiet == 0:
            self._ceiling = self._largest
        if iterations <= GROWING_ITERATIONS and count == self._size:
            self._size = min(2 * count, self._ceiling)
        self._excess += iterations - 4

    @property
    def is_stale(self) -> bool:
        """See the class."""
        return self._excess > REFRESH_AFTER

    def renewed(self) -> None:
        """There is a new linear response."""
        self._excess = 0
