"""How long blocks of equal steps may be, by the size of their matrices."""

from __future__ import annotations

from fvi_cli.integrator.engine.law import Law

STEPS_OF_LINEAR, STEPS_OF_NEWTON = 64, 64
"""Twice as many take as long for linear scenes, and double what round-off does near order 2."""
SIZE_OF_LINEAR, SIZE_OF_NEWTON = 1024, 512
"""Inputs of a block at most: B i e."""
SIZE_IN_BATCH = 24
"""The same where every member has matrices of its own, which must stay in the cache."""
CACHE = 2**15


def longest_block(law: Law, members: int, inputs: int) -> int:
    """Steps of the longest block of members with so many inputs of a step."""
    size = inputs
    if law.is_linear:
        most, largest = STEPS_OF_LINEAR, SIZE_OF_LINEAR
    else:
        most, largest = STEPS_OF_NEWTON, SIZE_OF_NEWTON
        size *= 2 if law.has_rates else 1
    if members > 1:
        is_large = members * SIZE_IN_BATCH**2 > CACHE
        largest = min(largest, SIZE_IN_BATCH if is_large else 2 * SIZE_IN_BATCH)
    while most > 1 and most * size > largest:
        most //= 2
    return most


def longest_in_batch(inputs: int, *, is_linear: bool) -> int:
    """The same for a member of a batch with so many inputs of a step, whatever others are in it."""
    most, size = STEPS_OF_NEWTON, SIZE_IN_BATCH
    if is_linear:
        most, size = STEPS_OF_LINEAR, 2 * SIZE_IN_BATCH
    while most > 1 and most * inputs > size:
        most //= 2
    return most
