"""Equations of a step of nonlinear systems, each iterated until it is solved for itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.trajectory import NewtonRecord
from fvi_cli.mathematics.arrays import Array

Mask = NDArray[np.bool_]

ITERATION_LIMIT = 60
TOLERANCE = 1e-16
"""Change of a position, relative to position and way, that ends the iteration."""
ROUND_OFF = 1e-14
"""Changes that round-off alone may make, on the same scale."""
SLOW = 0.25
"""From this ratio of successive changes on the linear scene is made anew."""


class Iteration:
    """Ways of a step, iterated for every system until it is solved or given up.

    Parameters
    ----------
    origin
        Positions at the beginning, shape ``(e, q)``.
    way
        First guess of the ways to the stages, shape ``(r, e, q)``.
    live
        Systems to be solved, shape ``(q,)``.
    """

    def __init__(self, origin: Array, way: Array, live: Mask) -> None:
        self.way, self.live = way, live.copy()
        self.pull = np.zeros_like(way)
        self.failed = np.zeros_like(live)
        self.changes: list[Array] = []
        self.counts = np.zeros(live.size, dtype=np.intp)
        self._origin = np.abs(origin).max(axis=0)
        self._scale = self._origin
        self._previous = np.full(live.size, np.inf)

    def take(self, pull: Array, way: Array) -> Mask:
        """Note an iteration: the forces it took, and the ways they make.

        Returns
        -------
        Array
            Systems that go on but are slow, shape ``(q,)``.
        """
        change = np.abs(way - self.way).max(axis=(0, 1))
        if not self.changes:
            self._scale = self._origin + np.abs(way).max(axis=(0, 1))
        if self.live.all():
            self.pull, self.way = pull, way
        else:
            self.pull = np.where(self.live, pull, self.pull)
            self.way = np.where(self.live, way, self.way)
        self.counts += self.live
        self.changes.append(change)
        # a first change says nothing about the rate
        is_first = np.isinf(self._previous)
        rate = np.where(is_first, 1.0, change / self._previous)
        smallest = TOLERANCE * self._scale
        solved = (change <= smallest) | (change * rate <= 0.1 * smallest)
        slow = ~(rate < SLOW) & ~is_first
        solved |= slow & (change <= ROUND_OFF * self._scale)
        lost = self.live & ~np.isfinite(change)
        self.failed |= lost
        self.live &= ~(solved | lost)
        self._previous = change
        return np.asarray(self.live & slow)

    def renewed(self, systems: NDArray[np.intp]) -> None:
        """These have another linear scene: what their changes were says nothing any more."""
        self._previous[systems] = np.inf

    def give_up(self) -> None:
        """What is not solved has failed."""
        self.failed |= self.live
        self.live[:] = False


class Notes:
    """How the iteration went, for every system."""

    def __init__(self, systems: int) -> None:
        self._total = np.zeros(systems, dtype=np.intp)
        self._largest = np.zeros(systems, dtype=np.intp)
        self._worst = np.full(systems, -1, dtype=np.intp)
        self._changes: dict[int, tuple[float, ...]] = {}

    def add(self, iteration: Iteration, step: int) -> None:
        """Count the iterations of a step."""
        counts = iteration.counts
        self._total += counts
        more = counts > self._largest
        if more.any():
            self._largest = np.maximum(self._largest, counts)
            self._worst[more] = step
            every = np.array(iteration.changes)
            for system in np.flatnonzero(more):
                self._changes[int(system)] = tuple(every[: counts[system], system].tolist())

    def of(self, system: int) -> NewtonRecord:
        """The record of a system."""
        return NewtonRecord(
            iterations=int(self._total[system]),
            largest=int(self._largest[system]),
            worst_step=int(self._worst[system]),
            worst_residuals=self._changes.get(system, ()),
        )
