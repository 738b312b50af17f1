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
SIZE, SIZE_OF_MANY = 512, 48
"""Most inputs B i e of a block (letters as in ``engine.py``): of one linear member, and of many,
whose matrices are not in the cache together. Newton applies a matrix often and takes half."""
USUAL_ITERATIONS, EXCESS_ITERATIONS = 4, 150
"""Usual iterations of a block; so many more, summed over blocks, pay for a new linearisation."""


def block_length(engine: Engine, total: int) -> int:
    """Steps of a block of a stretch of `total` equal steps, a power of 2."""
    if engine.is_single:
        return 1
    size, block = max(SIZE // engine.q, SIZE_OF_MANY), STEPS_OF_BLOCK
    if not engine.law.is_linear:
        size, block = size // 2, 2 * block
    # tables take some B^2 operations a member, and those of a batch are larger than the cache;
    # a stretch has four blocks or more, since few steps are not worth one linearisation
    pays = 4 * total if len(engine.scenes) == 1 else total / 8
    inputs = len(engine.tables.to_inputs) * engine.e * (2 if engine.law.has_rates else 1)
    while block > 1 and (block * inputs > size or block * block > pays or 4 * block > total):
        block //= 2
    return block


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
