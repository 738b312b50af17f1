"""How many steps are solved at once, and single steps where a block of them has no solution."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.mathematics.arrays import Array

STEPS_OF_BLOCK = 64
"""Most steps of a block of linear scenes: twice as many are no quicker, and double the effect of
round-off near order 2. Nonlinear scenes take up to twice as many: 0.72 of the time for a
pendulum."""
SIZE_OF_LINEAR, SIZE_OF_NEWTON = 512, 256
"""Most inputs B i e of a block. Newton's iteration applies a matrix of so many rows and columns
again and again: with 512 it has 2 MB and takes twice as long where the cache holds less."""
SIZE_IN_BATCH = 24
"""Most inputs where every member has matrices of its own, which must stay in the cache."""
CACHE = 2**15  # numbers in the matrices of a batch that stay in the cache
LEAST = 4
"""Steps of the shortest block."""
LINEAR_REUSE, LINEAR_REUSE_IN_BATCH = 0.25, 8.0
"""Blocks per step of a block that pay for the tables of a linear scene: alone, in a batch."""
REUSE, REUSE_IN_BATCH = 4, 32
"""Blocks that pay for the tables of a nonlinear scene: alone, in a batch."""
USUAL_ITERATIONS, EXCESS_ITERATIONS = 4, 150
"""Usual iterations of a block; so many more, in all blocks, pay for new second derivatives."""


def block_length(engine: Engine, total: int) -> int:
    """Steps of a block of a stretch of `total` equal steps, a power of 2."""
    linear, is_batch = engine.law.is_linear, len(engine.scenes) > 1
    if engine.is_single:
        return 1
    inputs = len(engine.tables.to_inputs) * engine.e
    size = SIZE_OF_LINEAR if linear else SIZE_OF_NEWTON
    if is_batch:
        size = 2 * SIZE_IN_BATCH if linear else SIZE_IN_BATCH
    elif engine.q > 1:
        # modes of one scene: 2 to 20 take .4 to .85 of the time of blocks for batches
        size = STEPS_OF_BLOCK * (1 if engine.q * STEPS_OF_BLOCK**2 > CACHE else 2)
    inputs *= 2 if engine.law.has_rates and not is_batch else 1
    block = STEPS_OF_BLOCK if linear else 2 * STEPS_OF_BLOCK
    while block > 1 and block * inputs > size:
        block //= 2
    if linear:
        share = LINEAR_REUSE_IN_BATCH if is_batch else LINEAR_REUSE
        while block > 1 and share * block * block > total:
            block //= 2
    else:
        reuse = REUSE_IN_BATCH if is_batch else REUSE
        while block > 1 and reuse * block > total:
            block //= 2
    return block if block >= LEAST else 1


def advance(
    engine: Engine, state: State, h: float, most: int, block: int, loads: Array | None
) -> Steps:
    """Solve a block of steps, at most `most`; a block that has no solution is done step by step."""
    count = 1 if state.single else min(block, most)
    steps = engine.solve(
        state, h, count, None if loads is None else loads[:, :count], 1 if count == 1 else block
    )
    if count == 1:
        state.single = max(0, state.single - 1)
        return steps
    # overflow in later steps of a block would hide where numbers cease to be finite
    finite = math.isfinite(np.add.reduce(steps.dx[state.live, -1], axis=None))
    if not finite or np.count_nonzero(steps.failed & state.live):
        state.single, state.block = count, None
        return advance(engine, state, h, most, block, loads)
    if not engine.law.is_linear:
        state.excess += max(0, int(steps.iterations.max()) - USUAL_ITERATIONS)
        if state.excess > EXCESS_ITERATIONS:
            state.excess, state.block = 0, None
    return steps
