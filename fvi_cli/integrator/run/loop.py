"""The loop over the steps of a run, for all kinds of scenes and all sources of steps."""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.engine.blocks import advance, block_for
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.recurrence import Recurrence
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.run.points import MeshSource, Proposal, Solved, Source
from fvi_cli.integrator.run.recorder import Recorder

CHUNK = 16384
"""Steps whose loads are computed together, at most."""

LARGEST_CHUNK = 2**17
"""Most numbers in the positions of these steps."""


def chunk_steps(dimension: int) -> int:
    """Steps of a chunk for scenes with `dimension` degrees of freedom in all.

    A power of 2, as blocks are, so that blocks do not depend on the number of scenes.
    """
    most = CHUNK
    while most > 16 and most * dimension > LARGEST_CHUNK:
        most //= 2
    return most


def run(
    engine: Engine,
    source: Source,
    *,
    state: State | None = None,
    recorder: Recorder | None = None,
) -> State:
    """Get proposals of steps, solve them, and let the source judge them.

    The state, by default the start of the scenes, moves to the end, or to
    where the last scene has stopped, and is returned. The recorder keeps points and steps; its
    `live` says which scenes continue.
    """
    state = engine.start() if state is None else state
    recorder = Recorder(engine) if recorder is None else recorder
    chunk = chunk_steps(engine.q * engine.e)
    recurrences: dict[tuple[float, int], Recurrence] = {}
    with np.errstate(all="ignore"):
        while len(recorder.failures) < len(engine.scenes):
            proposal = source.propose()
            if proposal is None:
                if source.failure is not None:
                    recorder.stop(source.failure)
                break
            count = min(proposal.n_steps, chunk)
            _steps(engine, source, state, recorder, proposal, count, recurrences)
            if recorder.is_full:
                recorder.flush(state)
        recorder.flush(state)
        recorder.finish()
    return state


def _steps(
    engine: Engine,
    source: Source,
    state: State,
    recorder: Recorder,
    proposal: Proposal,
    count: int,
    recurrences: dict[tuple[float, int], Recurrence],
) -> None:
    """Do `count` of the proposed steps, or those before one that is rejected."""
    if proposal.is_fresh:
        state.unknowns = state.rest = None
    state.t, h = proposal.begin, proposal.h
    loads = engine.loads(state.t, h, count, is_fresh=proposal.is_fresh)
    block, done, overflows = block_for(engine, proposal.total), 0, False
    while done < count:
        at, ahead = proposal, count - done
        if done:
            at = proposal._replace(first=proposal.first + done)
        own = None if loads is None else loads[:, done:]
        blocks = 0 if overflows else ahead // block
        is_long = block > 1 and Recurrence.is_quicker(engine, block, blocks, proposal.total)
        if is_long and isinstance(source, MeshSource):
            n, before = blocks * block, state.copy()
            key = (h, block)
            if key not in recurrences:
                # graded meshes have many sizes
                recurrences.clear()
                recurrences[key] = Recurrence(engine, h, block)
            x, p, inputs = recurrences[key].run(
                state,
                blocks,
                None if own is None else own[:, :n],
                with_inputs=recorder.with_steps,
            )
            if len(engine.scenes) == 1 and not np.isfinite(x[:, -1]).all():
                vars(state).update(vars(before))
                overflows = True
                continue
            state.t = source.accept(n)
            if inputs is not None:
                inputs = inputs.reshape(1, n, -1, engine.e)
            recorder.add(Solved(at, state.t, x, p, inputs))
            done += n
            continue
        if overflows:
            # overflow in later steps of a block would hide where numbers cease to be finite
            steps = engine.solve(state, h, 1, None if own is None else own[:, :1])
        else:
            steps = advance(engine, state, h, ahead, proposal.total, own)
            if engine.law.is_linear and len(engine.scenes) == 1 and steps.count > 1:
                overflows = not np.isfinite(steps.dx[:, -1]).all()
                if overflows:
                    continue
        end = source.judge(engine, state, steps)
        if end is None:
            recorder.count(steps)
            return
        recorder.note(state, steps)
        inputs = None
        if recorder.with_steps:
            inputs = steps.inputs.reshape(engine.q, steps.count, -1, engine.e)
        x, p = state.x[:, None] + steps.dx, state.p[:, None] + steps.dp
        recorder.add(Solved(at, end, x, p, inputs))
        engine.accept(state, steps, end)
        done += steps.count
        if steps.has_failed and not state.live.any():
            return
