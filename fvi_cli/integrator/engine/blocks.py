"""Choose how many steps are solved at once; take single steps where a block has no solution."""

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
"""Most inputs B i e of a block (letters as in ``engine.py``). Newton applies a matrix of so many
rows and columns often: with 512 it has 2 MB, and takes twice as long where the cache holds less."""
SIZE_IN_BATCH = 24
"""Most inputs where every member has matrices of its own, which must stay in the cache."""
CACHE = 2**15  # most entries, one per member and pair of steps, of matrices that stay in the cache
LEAST = 4
"""Steps of the shortest block."""
LINEAR_REUSE, LINEAR_REUSE_IN_BATCH = 0.25, 8.0
"""Fewest blocks that pay for the tables of a linear scene, over B: alone, in a batch."""
REUSE, REUSE_IN_BATCH = 4, 32
"""Fewest blocks that pay for the tables of a nonlinear scene: alone, in a batch."""
USUAL_ITERATIONS, EXCESS_ITERATIONS = 4, 150
"""Usual iterations of a block; so many more, summed over blocks, pay for a new linearisation."""


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
        # modes of one scene: with 2 to 20 this takes .4 to .85 of the time that batches' sizes take
        size = STEPS_OF_BLOCK * (1 if engine.q * STEPS_OF_BLOCK**2 > CACHE else 2)
    inputs *= 2 if engine.law.has_rates and not is_batch else 1
    block = STEPS_OF_BLOCK if linear else 2 * STEPS_OF_BLOCK
    while block > 1 and block * inputs > size:
        block //= 2
    if linear:
        reuse = LINEAR_REUSE_IN_BATCH if is_batch else LINEAR_REUSE
        while block > 1 and (reuse * block) * block > total:
            block //= 2
    else:
        reuse = REUSE_IN_BATCH if is_batch else REUSE
        while block > 1 and reuse * block > total:
            block //= 2
    return block if block >= LEAST else 1


def advance(
    engine: Engine, state: State, h: float, most: int, block: int, loads: Array | None
) -> Steps:
    """Solve a block of steps, at most `most`; a block without a solution is solved step by step."""
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
