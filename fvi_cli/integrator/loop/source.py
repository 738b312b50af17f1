"""Where the steps of a run come from: a mesh that is given, or sizes that are found on the way."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.mathematics.arrays import Array


class Proposal(NamedTuple):
    """Equal steps to be done next.

    Parameters
    ----------
    begin, h
        Where the first of them begins, and their length.
    n_steps
        So many, of which any number may be done.
    total
        Equal steps of the whole stretch, by which the length of blocks is chosen.
    is_fresh
        Whether the motion may be singular at `begin`: the start, or a break point.
    origin, first
        Beginning of the stretch and steps of it that are done: step k ends at
        ``origin + h (first + k)``.
    reported_every
        Points at this distance from `origin` are reported; 0: none.
    """

    begin: float
    h: float
    n_steps: int
    total: int
    is_fresh: bool
    origin: float
    first: int = 0
    reported_every: int = 1


class Source(Protocol):
    """Steps for the loop.

    Attributes
    ----------
    failure
        Why it proposes no more steps; None: all are done.
    """

    failure: Failure | None

    def propose(self) -> Proposal | None:
        """The next steps; None at the end."""

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The time at the end of solved steps that begin at `state`; None rejects them."""

    def accept(self, count: int) -> float:
        """The time at the end of so many steps that are not judged: many blocks at once."""

    def arrays(self) -> dict[str, Array]:
        """Where it is, for a checkpoint."""

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Go on from what :meth:`arrays` gave."""


class MeshSource:
    """The stretches of a mesh, one after the other; nothing is rejected."""

    failure: Failure | None = None

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._stretch = self._done = 0

    def propose(self) -> Proposal | None:
        """What is left of a stretch."""
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
        )

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The time at their end."""
        return self.accept(steps.count)

    def accept(self, count: int) -> float:
        """The time at the end of the next steps, which is given where a stretch ends."""
        one = self._mesh.stretches[self._stretch]
        self._done += count
        if self._done < one.n_steps:
            return one.begin + self._done * one.step_size
        self._stretch, self._done = self._stretch + 1, 0
        return one.end

    def arrays(self) -> dict[str, Array]:
        """Number of the stretch, and its steps that are done."""
        return {"place": np.array([self._stretch, self._done], dtype=float)}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Go on there."""
        self._stretch, self._done = (int(one) for one in arrays["place"])
