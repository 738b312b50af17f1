"""The loop over the steps of a run, for all kinds of scenes and all sources of steps."""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.engine.blocks import advance, block_length
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.recurrence import DOUBLINGS, Recurrence
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.run.recorder import Recorder, Solved
from fvi_cli.integrator.run.sources import MeshSource, Proposal, Source
from fvi_cli.mathematics.arrays import Array

CHUNK, LARGEST_CHUNK = 16384, 2**17
"""Most steps whose loads are computed together, and most numbers in their positions."""


def chunk_steps(dimension: int) -> int:
    """Steps of a chunk for scenes with `dimension` degrees of freedom in all, a power of 2."""
    most = CHUNK
    while most > 16 and most * dimension > LARGEST_CHUNK:
        most //= 2
    return most


def run(engine: Engine, source: Source, state: State, recorder: Recorder) -> None:
    """Get proposals of steps, solve them, and let the source judge them.

    The state moves to the end, or to where the last scene has stopped.
    """
    chunk = chunk_steps(engine.q * engine.e)
    recurrence: Recurrence | None = None
    with np.errstate(all="ignore"):
        while len(recorder.failures) < len(engine.scenes):
            proposal = source.propose()
            if proposal is None:
                if source.failure is not None:
                    recorder.stop(source.failure)
                break
            count, h = min(proposal.n_steps, chunk), proposal.h
            if proposal.is_fresh:
                state.unknowns = state.rest = None
            state.t, block = proposal.begin, block_length(engine, proposal.total)
            loads = engine.loads(state.t, h, count, is_fresh=proposal.is_fresh)
            groups = count // block >> DOUBLINGS
            if isinstance(source, MeshSource) and Recurrence.is_quicker(
                engine, block, groups << DOUBLINGS
            ):
                if recurrence is None or (recurrence.h, recurrence.count) != (h, block):
                    recurrence = Recurrence(engine, h, block)
                done = _run_blocks(recurrence, source, state, recorder, proposal, loads, groups)
                proposal, count = proposal.behind(done), count - done
                loads = None if loads is None else loads[:, done:]
            _run_steps(engine, source, state, recorder, proposal, count, block, loads)
            if recorder.is_full:
                recorder.flush(state)
        recorder.flush(state)
        recorder.finish()


def _run_blocks(
    recurrence: Recurrence,
    source: MeshSource,
    state: State,
    recorder: Recorder,
    proposal: Proposal,
    loads: Array | None,
    groups: int,
) -> int:
    """Do blocks of the proposed steps at once; the number of steps, 0 where they overflow."""
    blocks = groups << DOUBLINGS
    n = blocks * recurrence.count
    own = None if loads is None else loads[:, :n]
    found = recurrence.run(state, blocks, own, with_unknowns=recorder.with_steps)
    if found is None:
        return 0
    state.t = source.accept(n)
    recorder.add(Solved(proposal, state.t, *found))
    return n


def _run_steps(
    engine: Engine,
    source: Source,
    state: State,
    recorder: Recorder,
    proposal: Proposal,
    count: int,
    block: int,
    loads: Array | None,
) -> None:
    """Do `count` of the proposed steps, or those before one that is rejected."""
    done = 0
    while done < count and state.live.any():
        own = None if loads is None else loads[:, done:]
        steps = advance(engine, state, proposal.h, count - done, block, own)
        recorder.count(steps)
        end = source.judge(engine, state, steps)
        if end is None:
            return
        recorder.note(state, steps)
        x, p = state.x[:, None] + steps.dx, state.p[:, None] + steps.dp
        u = steps.unknowns if recorder.with_steps else None
        recorder.add(Solved(proposal.behind(done), end, x, p, u))
        engine.accept(state, steps, end)
        done += steps.count
