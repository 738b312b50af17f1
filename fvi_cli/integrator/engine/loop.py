"""The loop: ask for steps, solve as many as are best taken at once, have them judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.blocks import advance, block_for
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.recorder import Recorder
from fvi_cli.integrator.engine.recurrence import Recurrence
from fvi_cli.integrator.engine.source import MeshSource, Source
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array

CHUNK = 4096
"""Steps whose loads are made together."""


def run(
    engine: Engine,
    source: Source,
    *,
    state: State,
    recorder: Recorder,
    after: Callable[[State], None] | None = None,
) -> None:
    """Take all steps of a source from `state` on; the state moves to their end."""
    recurrences: dict[tuple[float, int], Recurrence] = {}
    with np.errstate(all="ignore"):
        while (asked := source.propose()) is not None and state.live.any():
            if asked.is_fresh:
                state.unknowns = state.rest = None
            chunk, h = min(asked.count, CHUNK), asked.h
            state.t = asked.begin
            loads = engine.loads(asked.begin, h, chunk, is_fresh=asked.is_fresh)
            block, done = block_for(engine, asked.total), 0
            while done < chunk:
                own = None if loads is None else loads[:, done:]
                blocks = (chunk - done) // block
                if Recurrence.pays(engine, block, blocks, asked.total):
                    key = (h, block)
                    if key not in recurrences:
                        recurrences = {key: Recurrence(engine, h, block)}
                    ahead = None if own is None else own[:, : blocks * block]
                    x, p, _ = recurrences[key].run(state, blocks, ahead)
                    recorder.add(state.t, h, x, p)
                    state.t = source.accept(blocks * block)
                    done += blocks * block
                    continue
                steps = advance(engine, state, h, chunk - done, asked.total, own)
                end = source.judge(engine, state, steps)
                if end is None:
                    break
                recorder.add(state.t, h, state.x[:, None] + steps.dx, state.p[:, None] + steps.dp)
                engine.accept(state, steps, end)
                done += steps.count
                if after is not None:
                    after(state)
                if not state.live.any():
                    break


def integrate(
    scenes: Sequence[Scene], method: Method, mesh: Mesh, *, most: int | None = None
) -> tuple[Array, Array, Array]:
    """All scenes on a mesh: times, positions and momenta ``(S, n + 1, d)``."""
    engine = Engine(
        scenes,
        method,
        shortest_step=mesh.shortest_step,
        steps=mesh.equivalent_steps,
        n_steps=mesh.n_steps,
        most=most,
    )
    state = engine.start()
    recorder = Recorder(state)
    run(engine, MeshSource(mesh), state=state, recorder=recorder)
    return recorder.finish(engine)
