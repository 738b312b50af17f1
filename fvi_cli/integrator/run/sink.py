"""What is kept of a run while it goes on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array

_LAST = ("last_time", "last_position", "last_momentum")
"""Names of the last reported point, which is kept at the end of a run."""


class Sink:
    """Reported points, thinned, and where wanted every step with its stage velocities.

    Parameters
    ----------
    every
        Keep every n-th reported point, the first and the last.
    with_steps
        Keep all points of the mesh and the velocities at the stages.
    """

    def __init__(self, *, every: int, with_steps: bool) -> None:
        self._every, self.with_steps = every, with_steps
        self._reported = 0
        self._times: list[Array] = []
        self._positions: list[Array] = []
        self._momenta: list[Array] = []
        self._last: tuple[Array, Array, Array] | None = None
        self._is_last_kept = True
        self._mesh: list[Array] = []
        self._mesh_positions: list[Array] = []
        self._mesh_momenta: list[Array] = []
        self._sizes: list[Array] = []
        self._velocities: list[Array] = []

    @property
    def reported(self) -> int:
        """Number of reported points so far, the start of the run not counted."""
        return self._reported

    def go_on(self, reported: int, dimension: int) -> None:
        """Begin behind a checkpoint with so many reported points before it."""
        self._reported = reported
        # a part may well keep none of its points
        self._positions.append(np.zeros((0, dimension)))
        self._momenta.append(np.zeros((0, dimension)))

    def kept(self) -> dict[str, Array]:
        """Everything that is kept so far, by name, for a checkpoint."""
        found = {name: _joined(pieces) for name, pieces in self._lists().items() if pieces}
        if self._last is not None:
            found.update(zip(_LAST, self._last, strict=True))
        return found

    def restore(self, kept: Mapping[str, Array], *, reported: int) -> None:
        """Go on behind a checkpoint, with the points that were kept before it."""
        self._reported = reported
        for name, pieces in self._lists().items():
            pieces[:] = [kept[name]] if name in kept else []
        if all(name in kept for name in _LAST):
            time, position, momentum = (kept[name] for name in _LAST)
            self._last = (time, position, momentum)
            self._is_last_kept = bool(self._times) and bool(self._times[-1][-1] == time[0])

    def _lists(self) -> dict[str, list[Array]]:
        return {
            "times": self._times,
            "positions": self._positions,
            "momenta": self._momenta,
            "mesh": self._mesh,
            "mesh_positions": self._mesh_positions,
            "mesh_momenta": self._mesh_momenta,
            "sizes": self._sizes,
            "velocities": self._velocities,
        }

    def begin(self, time: float, position: Array, momentum: Array) -> None:
        """The start of the run."""
        at = np.array([time])
        self._times.append(at)
        self._positions.append(position[None].copy())
        self._momenta.append(momentum[None].copy())
        if self.with_steps:
            self._mesh.append(at)
            self._mesh_positions.append(position[None].copy())
            self._mesh_momenta.append(momentum[None].copy())

    def add(
        self,
        times: Array,
        sizes: Array,
        position: Array,
        momentum: Array,
        velocity: Array,
        reported: NDArray[np.intp],
    ) -> None:
        """Steps that are done.

        Parameters
        ----------
        times, position, momentum
            At their ends, shapes ``(n,)``, ``(n, d)``.
        sizes
            Step sizes, shape ``(n,)``.
        velocity
            At the stages, shape ``(n, r, d)``.
        reported
            Indices of the points among them that are reported.
        """
        if self.with_steps:
            self._mesh.append(times)
            self._sizes.append(sizes)
            self._mesh_positions.append(position)
            self._mesh_momenta.append(momentum)
            self._velocities.append(velocity)
        if reported.size == 0:
            return
        numbers = self._reported + 1 + np.arange(reported.size)
        kept = reported[numbers % self._every == 0]
        self._reported += reported.size
        if kept.size:
            self._times.append(times[kept])
            self._positions.append(position[kept])
            self._momenta.append(momentum[kept])
        last = reported[-1]
        self._is_last_kept = bool(kept.size) and kept[-1] == last
        self._last = (
            times[last : last + 1].copy(),
            position[last : last + 1].copy(),
            momentum[last : last + 1].copy(),
        )

    def finish(self, time: float, position: Array, momentum: Array) -> None:
        """The run ends here; its last point is kept, whatever it is."""
        last = self._last
        if last is None or last[0][0] != time:
            kept = bool(self._times) and self._times[-1][-1] == time
            if not kept:
                self._times.append(np.array([time]))
                self._positions.append(position[None].copy())
                self._momenta.append(momentum[None].copy())
        elif not self._is_last_kept:
            for store, value in zip(
                (self._times, self._positions, self._momenta), last, strict=True
            ):
                store.append(value)

    @property
    def time(self) -> Array:
        """Times of the kept points."""
        return _joined(self._times) if self._times else np.zeros(0)

    @property
    def position(self) -> Array:
        """Positions of the kept points, shape ``(n, d)``."""
        return _joined(self._positions)

    @property
    def momentum(self) -> Array:
        """Momenta of the kept points, shape ``(n, d)``."""
        return _joined(self._momenta)

    def steps(self, tables: StepTables) -> RunSteps:
        """All steps, of a method with these tables."""
        d = self._positions[0].shape[1]
        return RunSteps(
            tables=tables,
            time=_joined(self._mesh),
            step_size=_joined(self._sizes) if self._sizes else np.zeros(0),
            position=_joined(self._mesh_positions),
            momentum=_joined(self._mesh_momenta),
            velocity=_joined(self._velocities) if self._velocities else np.zeros((0, 1, d)),
        )


def _joined(pieces: list[Array]) -> Array:
    """The pieces as one, which takes their place: nothing is there twice."""
    if len(pieces) > 1:
        pieces[:] = [np.concatenate(pieces)]
    return pieces[0]
