"""The loop over the steps of a run, for all kinds of scenes and all sources of steps."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from fvi_cli.integrator.engine.blocks import advance, block_length
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.recurrence import DOUBLINGS, Recurrence
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.meshes.forces import StepPath
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch
from fvi_cli.integrator.run.recorder import Recorder, Solved
from fvi_cli.mathematics.arrays import Array, Mask

CHUNK_OCTAVES, LARGEST_CHUNK = 14, 2**17
"""Most steps whose loads are computed together, as a power of 2, and most numbers in these."""


class Source(ABC):
    """Steps for the loop."""

    n_steps = 0  # number of the steps that are reported
    reported: Mask | None = None  # which points are; None: all
    failure = ""  # why it proposes no more steps; empty: all are done
    pushes: Sequence[Array] = ()  # by impacts on the momentum, (d,) at every point

    @abstractmethod
    def propose(self, engine: Engine, state: State) -> Stretch | None:
        """The next steps; None at the end."""

    def accepts(self, engine: Engine, state: State, steps: Steps) -> bool:
        """Whether solved steps that begin at `state` are part of the run."""
        return True

    def path(self, engine: Engine, state: State, steps: Steps) -> StepPath:
        """The polynomial of a single step of one scene."""
        position = engine.scene_positions(state.x[:, None])[0, 0]
        unknowns = engine.scene_positions(steps.unknowns[:, 0])[0]
        return StepPath(begin=state.t, size=steps.h, position=position, unknowns=unknowns)


class MeshSource(Source):
    """The stretches of a mesh, one after the other; no step is rejected."""

    def __init__(self, mesh: Mesh) -> None:
        self.n_steps, self.reported = mesh.n_reported, mesh.reported
        self._stretches = iter(mesh.stretches)

    def propose(self, engine: Engine, state: State) -> Stretch | None:
        """The next stretch."""
        return next(self._stretches, None)


def march(engine: Engine, source: Source, recorder: Recorder) -> None:
    """Get proposals of steps, solve them, and let the source judge them and the recorder keep them.

    It ends where the source does, or where the last scene has stopped.
    """
    # a power of 2, as blocks are
    octaves = int(math.log2(LARGEST_CHUNK / (engine.q * engine.e)))
    state, chunk = engine.start(), 1 << max(4, min(octaves, CHUNK_OCTAVES))
    recurrence: Recurrence | None = None
    with np.errstate(all="ignore"):
        while not recorder.is_over and (stretch := source.propose(engine, state)) is not None:
            h, block = stretch.step_size, block_length(engine, stretch.n_steps)
            done, is_accepted = 0, True
            if stretch.is_fresh:
                state.unknowns = state.rest = None
            while is_accepted and done < stretch.n_steps and not recorder.is_over:
                state.t, count = stretch.time_after(done), min(stretch.n_steps - done, chunk)
                loads = engine.loads(state.t, h, count, is_fresh=stretch.is_fresh and not done)
                blocks = (count // block >> DOUBLINGS) << DOUBLINGS  # groups of 2^DOUBLINGS
                solved = None
                if Recurrence.is_quicker(engine, block, blocks):
                    if recurrence is None or (recurrence.h, recurrence.count) != (h, block):
                        recurrence = Recurrence(engine, h, block)
                    given = None if loads is None else loads[:, : blocks * block]
                    solved = recurrence.run(state, blocks, given, with_unknowns=recorder.with_steps)
                if solved is not None:
                    count = blocks * block
                    recorder.add(Solved(stretch, done, *solved))
                else:
                    part = stretch, done, count, block
                    is_accepted = _run_steps(engine, source, recorder, state, loads, *part)
                done += count
                if recorder.is_full:
                    recorder.flush(state)
        recorder.finish(state, source.failure)


def _run_steps(
    engine: Engine,
    source: Source,
    recorder: Recorder,
    state: State,
    loads: Array | None,
    stretch: Stretch,
    done: int,
    count: int,
    block: int,
) -> bool:
    """Do `count` of the steps of a stretch; false where the source rejects one."""
    first, last = done, done + count
    while done < last and state.live.any():
        rest = None if loads is None else loads[:, done - first :]
        steps = advance(engine, state, stretch.step_size, last - done, block, rest)
        recorder.count(steps)
        if not source.accepts(engine, state, steps):
            return False
        recorder.note(state, steps)
        x, p = state.x[:, None] + steps.dx, state.p[:, None] + steps.dp
        u = steps.unknowns if recorder.with_steps else None
        recorder.add(Solved(stretch, done, x, p, u))
        done += steps.count
        engine.accept(state, steps, stretch.time_after(done))
    return True
