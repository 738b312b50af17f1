"""The loop over the steps of a run, for all kinds of scenes and all sources of steps."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from fvi_cli.integrator.engine.blocks import advance, block_length
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.recurrence import DOUBLINGS, Recurrence
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch
from fvi_cli.integrator.run.recorder import Recorder, Solved
from fvi_cli.mathematics.arrays import Array

CHUNK_OCTAVES, LARGEST_CHUNK = 14, 2**17
"""Most steps whose loads are computed together, as a power of 2, and most numbers in these."""


class Proposal(NamedTuple):
    """The steps of a stretch that are not done yet; the loop does any number of them next."""

    stretch: Stretch
    done: int = 0  # number of steps of the stretch that are done


class Source(Protocol):
    """Steps for the loop."""

    n_steps: int  # number of the steps that are reported
    failure: str  # why it proposes no more steps; empty: all are done
    rejected: int  # number of rejected steps
    pushes: list[Array]  # by impacts on the momentum, (d,) at every point; empty without surfaces

    def propose(self, engine: Engine, state: State) -> Proposal | None:
        """The next steps; None at the end."""

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The time at the end of solved steps that begin at `state`; None rejects them."""


class MeshSource:
    """The stretches of a mesh, one after the other; no step is rejected."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh, self.n_steps, self.failure, self.rejected = mesh, mesh.n_reported, "", 0
        self.pushes: list[Array] = []
        self._stretch = self._done = 0

    def propose(self, engine: Engine, state: State) -> Proposal | None:
        """The remaining steps of a stretch."""
        if self._stretch == len(self._mesh.stretches):
            return None
        return Proposal(self._mesh.stretches[self._stretch], self._done)

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The time at the end of the steps."""
        return self.accept(steps.count)

    def accept(self, count: int) -> float:
        """Accept the next steps; the time at their end, which is exact where a stretch ends."""
        one = self._mesh.stretches[self._stretch]
        self._done += count
        if self._done < one.n_steps:
            return one.begin + self._done * one.step_size
        self._stretch, self._done = self._stretch + 1, 0
        return one.end


def march(engine: Engine, source: Source, recorder: Recorder) -> None:
    """Get proposals of steps, solve them, and let the source judge them and the recorder keep them.

    It ends where the source does, or where the last scene has stopped.
    """
    # a power of 2, as blocks are
    octaves = int(math.log2(LARGEST_CHUNK / (engine.q * engine.e)))
    state, chunk = engine.start(), 1 << max(4, min(octaves, CHUNK_OCTAVES))
    recurrence: Recurrence | None = None
    with np.errstate(all="ignore"):
        while len(recorder.failures) < len(engine.scenes):
            proposal = source.propose(engine, state)
            if proposal is None:
                break
            stretch, done = proposal
            h, count = stretch.step_size, min(stretch.n_steps - done, chunk)
            state.t, is_fresh = stretch.begin + done * h, stretch.is_fresh and not done
            if is_fresh:
                state.unknowns = state.rest = None
            loads = engine.loads(state.t, h, count, is_fresh=is_fresh)
            block = block_length(engine, stretch.n_steps)
            blocks = (count // block >> DOUBLINGS) << DOUBLINGS  # whole groups of 2^DOUBLINGS
            solved = None
            if isinstance(source, MeshSource) and Recurrence.is_quicker(engine, block, blocks):
                if recurrence is None or (recurrence.h, recurrence.count) != (h, block):
                    recurrence = Recurrence(engine, h, block)
                given = None if loads is None else loads[:, : blocks * block]
                solved = recurrence.run(state, blocks, given, with_unknowns=recorder.with_steps)
                if solved is not None:
                    state.t = source.accept(blocks * block)
                    recorder.add(Solved(stretch, done, state.t, *solved))
            if solved is None:
                _run_steps(engine, source, state, recorder, proposal, count, block, loads)
            if recorder.is_full:
                recorder.flush(state)
        recorder.finish(state, source.failure)


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
    (stretch, first), done = proposal, 0
    while done < count and state.live.any():
        rest = None if loads is None else loads[:, done:]
        steps = advance(engine, state, stretch.step_size, count - done, block, rest)
        recorder.count(steps)
        end = source.judge(engine, state, steps)
        if end is None:
            return
        recorder.note(state, steps)
        x, p = state.x[:, None] + steps.dx, state.p[:, None] + steps.dp
        u = steps.unknowns if recorder.with_steps else None
        recorder.add(Solved(stretch, first + done, end, x, p, u))
        engine.accept(state, steps, end)
        done += steps.count
