"""Sources of the steps of a run, and why a step has no solution."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import Failure, StepFailedError, no_unique_solution
from fvi_cli.integrator.meshes.mesh import Mesh


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
