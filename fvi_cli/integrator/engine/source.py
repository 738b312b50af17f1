"""Where steps come from: a source proposes equal steps and judges those that are solved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.meshes.mesh import Mesh


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """Equal steps: where they begin, their length, how many at most, and of how many.

    `is_fresh`: the motion may be singular at the beginning.
    """

    begin: float
    h: float
    count: int
    total: int
    is_fresh: bool


class Source(Protocol):
    """Steps one after the other."""

    def propose(self) -> Proposal | None:
        """The steps to come; None at the end."""

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """Where solved steps end; None: they are rejected."""

    def accept(self, count: int) -> float:
        """Where so many steps end that nobody can reject."""


class MeshSource:
    """The steps of a mesh; nothing is rejected."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh, self.stretch, self.done = mesh, 0, 0

    def propose(self) -> Proposal | None:
        """What is left of the stretch."""
        if self.stretch == len(self.mesh.stretches):
            return None
        one, h = self.mesh.stretches[self.stretch], self.mesh.stretches[self.stretch].step_size
        return Proposal(
            begin=one.begin + self.done * h,
            h=h,
            count=one.n_steps - self.done,
            total=one.n_steps,
            is_fresh=one.is_fresh and self.done == 0,
        )

    def judge(self, engine: Engine, state: State, steps: Steps) -> float:
        """All are taken."""
        return self.accept(steps.count)

    def accept(self, count: int) -> float:
        """The end of so many steps."""
        one = self.mesh.stretches[self.stretch]
        self.done += count
        if self.done < one.n_steps:
            return one.begin + self.done * one.step_size
        self.stretch, self.done = self.stretch + 1, 0
        return one.end
