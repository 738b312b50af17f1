"""How many steps are solved at once, and shorter pieces where a block does not contract.

The number of steps of a block changes last digits: it depends on the scene, the method and the
number of equal steps alone, never on a clock or on other members.
"""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.mathematics.arrays import Array, Places

LEAST = 4
"""Steps of the shortest block."""
LINEAR_REUSE, LINEAR_REUSE_IN_BATCH = 0.25, 8.0
"""Blocks per step of a block that pay for the tables of a linear scene: alone, in a batch."""
REUSE, REUSE_IN_BATCH = 8, 32
"""Blocks that pay for the tables of a nonlinear scene: alone, in a batch."""
BLOCKS_BEFORE_RETRY = 16
"""Number of blocks until a longer one is tried again."""
USUAL_ITERATIONS, EXCESS_ITERATIONS = 4, 150
"""Usual iterations of a block; so many more, in all blocks, pay for new second derivatives."""
FEW_ITERATIONS = 12
"""If a block takes no more iterations than this, a longer one is tried."""
STATE_OF_BLOCKS = ("longest", "wait", "excess", "stale")


def block_for(engine: Engine, left: int) -> int:
    """Steps of a block for `left` equal steps: enough blocks must follow to pay for the tables."""
    block = engine.most
    if engine.law.is_linear:
        share = LINEAR_REUSE_IN_BATCH if engine.is_batch else LINEAR_REUSE
        while block > 1 and share * block * block > left:
            block //= 2
    else:
        reuse = REUSE_IN_BATCH if engine.is_batch else REUSE
        while block > 1 and reuse * block > left:
            block //= 2
    return block if block >= LEAST else 1


def advance(
    engine: Engine, state: State, h: float, most: int, total: int, loads: Array | None
) -> Steps:
    """Solve the best number of steps at once, at most `most`; `total` is that of the stretch."""
    largest = block_for(engine, total)
    count = largest
    while count > most:
        count = most if engine.law.is_linear else count // 2
    if count < LEAST and not engine.law.is_linear:
        count = 1
    own = None if loads is None else loads[:, :count]
    return take(engine, state, h, count, own, largest if count > 1 else 1)


def take(
    engine: Engine, state: State, h: float, count: int, loads: Array | None, most: int
) -> Steps:
    """Solve `count` steps; members whose blocks do not contract take shorter pieces."""
    if engine.law.is_linear or count == 1:
        return engine.solve(state, h, count, loads, most)
    short = state.longest < count
    if short.all():
        return _in_pieces(engine, state, h, count, loads, most)
    if short.any():
        long = np.flatnonzero(~short)
        own = state.of(long)
        part = take(engine.of(long), own, h, count, _of(loads, long), most)
        _put(state, long, own)
        found = part.among(long, engine.q)
    else:
        found = engine.solve(state, h, count, loads, most)
        _note(state, found, count)
        short = found.failed
        if not short.any():
            return found
    places = np.flatnonzero(short)
    own = state.of(places)
    pieces = _in_pieces(engine.of(places), own, h, count, _of(loads, places), most)
    _put(state, places, own)
    if len(places) == engine.q:
        return pieces
    found.put(places, pieces)
    return found


def _note(state: State, found: Steps, count: int) -> None:
    """Update from a block which length to take, and when to linearise again."""
    well = ~found.failed
    state.excess = state.excess + np.where(well, found.iterations - USUAL_ITERATIONS, 0)
    state.stale = state.stale | (state.excess > EXCESS_ITERATIONS) | found.failed
    state.excess = np.where(state.stale, 0, state.excess)
    state.wait = np.where(well, np.maximum(state.wait - 1, 0), BLOCKS_BEFORE_RETRY)
    grows = (
        well & (state.wait == 0) & (found.iterations <= FEW_ITERATIONS) & (count == state.longest)
    )
    shorter = np.where(well, state.longest, count // 2)
    state.longest = np.where(grows, 2 * state.longest, shorter)


def _in_pieces(
    engine: Engine, state: State, h: float, count: int, loads: Array | None, most: int
) -> Steps:
    """As `take`, in halves; in the state only lengths and linearisations of blocks change."""
    half = count // 2 if count // 2 >= LEAST else 1
    own, parts, done = state.copy(), [], 0
    while done < count:
        k = min(half, count - done)
        ahead = None if loads is None else loads[:, done : done + k]
        found = take(engine, own, h, k, ahead, most if k > 1 else 1)
        parts.append(found)
        engine.accept(own, found, own.t + k * h)
        done += k
        if k == 1:
            own.wait = np.maximum(own.wait - 1, 0)
            own.longest = np.where(own.wait == 0, np.maximum(own.longest, LEAST), own.longest)
    for name in (*STATE_OF_BLOCKS, "block"):
        setattr(state, name, getattr(own, name))
    return Steps.join(parts)


def _put(state: State, places: Places, own: State) -> None:
    """Copy the lengths and linearisations of blocks of some members from `own`."""
    for name in STATE_OF_BLOCKS:
        mine = getattr(state, name).copy()
        mine[places] = getattr(own, name)
        setattr(state, name, mine)
    if state.block is not None and own.block is not None:
        state.block = state.block.copy()
        state.block.put(places, own.block)


def _of(loads: Array | None, places: Places) -> Array | None:
    return None if loads is None else loads[places]
