"""Equations of a step of nonlinear systems, each iterated until it is solved for itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.results.newton_record import NewtonRecord
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import Mask, judge

ITERATION_LIMIT = 60


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
    floor
        Bound of what round-off does to the ways of some systems, ``(e, n)``, from their forces.
    """

    def __init__(
        self,
        origin: Array,
        way: Array,
        live: Mask,
        floor: Callable[[NDArray[np.intp], Array, Array], Array],
    ) -> None:
        self.way, self.live = way, live.copy()
        self.pull = np.zeros_like(way)
        self.failed = np.zeros_like(live)
        self.changes: list[Array] = []
        self.counts = np.zeros(live.size, dtype=np.intp)
        self._floor = floor
        self._origin = np.abs(origin)
        self._scale = self._origin
        self._previous = np.full(origin.shape, np.nan)

    def take(self, pull: Array, way: Array) -> Mask:
        """Note an iteration: the forces it took, and the ways they make.

        Returns
        -------
        Array
            Systems that go on but are slow, shape ``(q,)``.
        """
        change = np.abs(way - self.way).max(axis=0)
        self._scale = np.maximum(self._scale, self._origin + np.abs(way).max(axis=0))
        if self.live.all():
            self.pull, self.way = pull, way
        else:
            self.pull = np.where(self.live, pull, self.pull)
            self.way = np.where(self.live, way, self.way)
        self.counts += self.live
        self.changes.append(change.max(axis=0))

        def floor(slow: Mask) -> Array:
            found: Array = np.zeros_like(change)
            places = np.flatnonzero(slow.any(axis=0) & self.live)
            if places.size:
                found[:, places] = self._floor(places, self.pull, self.way)
            return found

        done, is_slow = judge(change, self._previous, self._scale, floor)
        lost = self.live & ~np.isfinite(change).all(axis=0)
        self.failed |= lost
        self.live &= ~(done.all(axis=0) | lost)
        self._previous = change
        return np.asarray(self.live & is_slow.any(axis=0))

    def renewed(self, systems: NDArray[np.intp]) -> None:
        """These have another linear scene: what their changes were says nothing any more."""
        self._previous[:, systems] = np.nan

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
