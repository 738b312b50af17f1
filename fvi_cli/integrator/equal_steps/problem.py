"""What equal steps need and what they give."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.equal_steps.weights import Memory
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.trajectory import NewtonRecord

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class StepProblem:
    """Everything that the steps need, ready before the first one.

    Parameters
    ----------
    scene, tables, memory
        Effects, numbers of the method, and the convolution.
    step_size, n_steps
        h and N.
    moments
        Moments of the known force, shape ``(N, s + 1, d)``; None when there is none.
    position, momentum
        Start values of the unknown, shape ``(d,)``.
    skip_first_kick
        Leave out the damping force of step 0 (the paper's algorithm, samples on the nodes).
    stop_beyond
        No more steps are needed after a position larger than this.
    keep_force
        Keep the damping force of every step, also where steps are done in blocks.
    """

    scene: Scene
    tables: StepTables
    memory: Memory
    step_size: float
    n_steps: int
    position: Array
    momentum: Array
    moments: Array | None = None
    skip_first_kick: bool = False
    stop_beyond: float = math.inf
    keep_force: bool = False

    def with_force(self, force: Array) -> StepProblem:
        """The same with a known addition to the damping force, shape ``(N + 1, m, d)``."""
        known = self.memory.known_force
        total = force if known is None else known + force
        return replace(self, memory=replace(self.memory, known_force=total))


@dataclass(frozen=True, kw_only=True, eq=False)
class Stepped:
    """What the steps gave: arrays over the finished ones.

    Parameters
    ----------
    position, momentum
        On the grid, shape ``(n + 1, d)`` after n finished steps; the momentum is that of the
        scheme.
    samples
        Positions at the sampling points relative to the start, shape ``(n, m, d)``.
    end_force
        Damping force of the samples at the left end of every step and at the end of the last,
        shape ``(n + 1, m, d)``.
    operations, newton, failure
        Work, record of Newton's iteration, and in words what stopped the steps early.
    increments
        Increments of every step, shape ``(n, s, d)``; None unless they were asked for.
    """

    position: Array
    momentum: Array
    samples: Array
    end_force: Array
    operations: int
    newton: NewtonRecord
    failure: str = ""
    increments: Array | None = None


class History(Protocol):
    """The finished part of the convolution, step by step."""

    @property
    def operations(self) -> int:
        """Multiply-adds, weight times sample, done so far."""

    def known(self) -> Array:
        """Force of all finished samples on the step to come, shape ``(m, d)``."""

    def push(self, samples: Array) -> None:
        """Append the samples of a finished step, shape ``(m, d)``."""


def noted(record: NewtonRecord, step: int, residuals: tuple[float, ...]) -> NewtonRecord:
    """The record after a step, or a block of them, with these residuals."""
    if not residuals:
        return record
    worst = len(residuals) > record.largest
    return NewtonRecord(
        iterations=record.iterations + len(residuals),
        largest=max(record.largest, len(residuals)),
        worst_step=step if worst else record.worst_step,
        worst_residuals=residuals if worst else record.worst_residuals,
    )
