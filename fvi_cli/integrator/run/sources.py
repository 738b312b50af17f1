"""Sources of the steps of a run, and solved steps as points of the scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import Failure, StepFailedError, no_unique_solution
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.mathematics.arrays import Array


class Proposal(NamedTuple):
    """Equal steps to be done next."""

    begin: float  # where the first of them begins, and their length
    h: float
    n_steps: int  # number of steps, of which any number may be done
    total: int  # steps of the whole stretch, from which the length of blocks is chosen
    is_fresh: bool  # whether the motion may be singular at `begin`: the start, or a break point
    origin: float  # begin of the stretch: step k of these ends at origin + h (first + k)
    first: int = 0  # steps of the stretch that are done
    # every so many of the steps has a point that is reported, counted from `passed` on; 0: none
    reported_every: int = 1
    passed: int = 0

    def behind(self, count: int) -> Proposal:
        """The same steps without the first ones."""
        return self._replace(first=self.first + count) if count else self


class Source(Protocol):
    """Steps for the loop."""

    failure: Failure | None  # why it proposes no more steps; None: all are done

    def propose(self) -> Proposal | None:
        """The next steps; None at the end."""

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The time at the end of solved steps that begin at `state`; None rejects them."""


class MeshSource:
    """The stretches of a mesh, one after the other; no step is rejected."""

    failure: Failure | None = None

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._stretch = self._done = 0

    def propose(self) -> Proposal | None:
        """The remaining steps of a stretch."""
        if self._stretch == len(self._mesh.stretches):
            return None
        one = self._mesh.stretches[self._stretch]
        return Proposal(
            begin=one.begin + self._done * one.step_size,
            h=one.step_size,
            n_steps=one.n_steps - self._done,
            total=one.n_steps,
            is_fresh=one.is_fresh and self._done == 0,
            origin=one.begin,
            first=self._done,
            reported_every=one.reported_every,
            passed=one.passed,
        )

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


Stops = dict[int, tuple[int, Failure]]
"""For some scenes how many of successive steps are kept, and why they stop there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """Successive steps of all scenes."""

    done: int  # steps of the run before them
    times: Array  # ends of the steps and their lengths, shape (n,)
    sizes: Array
    position: Array  # at the ends, shape (scenes, n, d)
    momentum: Array


class Solved(NamedTuple):
    """Equal steps of the members of an engine."""

    proposal: Proposal  # where they begin, and the time at the end of the last
    end: float
    position: Array  # at their ends, (q, n, e)
    momentum: Array
    unknowns: Array | None  # U, (q, n, s, e), where polynomials are kept

    @property
    def n_steps(self) -> int:
        """Number of steps."""
        return int(self.position.shape[1])


def points_of(
    engine: Engine, solved: Sequence[Solved], done: int
) -> tuple[Points, NDArray[np.bool_]]:
    """Successive steps in the coordinates of the scenes, and which of their ends are reported."""
    proposals, ends, position, momentum, _ = zip(*solved, strict=True)
    counts = [one.n_steps for one in solved]

    def spread(values: list[float] | list[int]) -> Array:
        return np.repeat(values, counts) if len(values) > 1 else np.asarray(values[0])

    def join(pieces: Sequence[Array]) -> Array:
        return np.concatenate(pieces, axis=1) if len(pieces) > 1 else pieces[0]

    last = np.cumsum(counts) - 1
    behind = [one.first - end for one, end in zip(proposals, last - counts, strict=True)]
    number = np.arange(last[-1] + 1) + spread(behind)
    sizes = spread([one.h for one in proposals])
    times = spread([one.origin for one in proposals]) + sizes * number
    times[last] = ends
    every = spread([one.reported_every for one in proposals])
    reported = np.broadcast_to(every > 0, number.shape)
    if every.max() > 1:
        number = number + spread([one.passed for one in proposals])
        reported = reported & (number % np.maximum(every, 1) == 0)
    x, p = engine.to_scene(join(position), join(momentum))
    found = Points(
        done=done,
        times=times,
        sizes=np.broadcast_to(sizes, number.shape),
        position=x,
        momentum=p,
    )
    return found, reported


def velocities_of(engine: Engine, solved: Sequence[Solved]) -> Array:
    """Velocities at the stages of successive steps, shape ``(scenes, n, r, d)``."""
    unknowns = [one.unknowns for one in solved if one.unknowns is not None]
    velocity = np.matmul(engine.tables.slopes[1:].T, np.concatenate(unknowns, axis=1))
    q, n, r, _ = velocity.shape
    found = engine.scene_positions(velocity.reshape(q, n * r, -1))
    return found.reshape(len(engine.scenes), n, r, -1)


def why_unsolved(steps: Steps, state: State, member: int = 0) -> StepFailedError:
    """Why a step of a member that begins at `state` has no solution."""
    if steps.finite is None:
        return no_unique_solution(steps.h)
    near = "[" + ", ".join(f"{value:.4g}" for value in state.x[member]) + "]"
    words = f"Newton's iteration did not converge near q = {near}; take a smaller step"
    if not steps.finite[member]:
        words = (
            "the force is not finite (no real number, or a division by zero) near "
            f"q = {near}; take a smaller step if the motion itself stays away from there"
        )
    return StepFailedError(words)
