"""The result of an integration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.results.diagnostics import Diagnostics, NewtonRecord
from fvi_cli.integrator.results.observed import Observed
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.results.showing import dataframe_of, dataset_of
from fvi_cli.mathematics.arrays import Array

Status = Literal["ok", "failed", "refused"]
Outcome = Literal["met", "unreliable", "refused"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Assessment:
    """Assessment of the error of a run for a tolerance.

    Parameters
    ----------
    outcome
        ``met``; ``unreliable``: runs that should agree do not, or something may hide between their
        points; ``refused``: the tolerance is out of reach.
    tolerance
        The requested tolerance, a length; nan if it is relative and there is no motion.
    estimate
        Estimated error of the position at any time, the least that was reached.
    reason
        Why it is not met, in one line; empty if it is met.
    time, place
        Where the motion is unreliable from; None otherwise.
    attempts
        One line for every run.
    """

    outcome: Outcome
    tolerance: float
    estimate: float
    reason: str = ""
    time: float | None = None
    place: tuple[float, ...] | None = None
    attempts: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A discrete solution on the reported points of a mesh (fewer when it stopped early).

    Where its steps were kept, ``trajectory(t)`` and ``trajectory.velocity(t)`` give position and
    velocity at any times.

    Parameters
    ----------
    time
        t_k = k h, or the points of another mesh, shape ``(n,)``; n = N + 1 when ``status`` is
        ``ok``.
    position, momentum
        Shape ``(n, d)``; no momentum for methods that have none.
    energy
        Hamiltonian without forcing, shape ``(n,)``, where there is a momentum.
    n_steps, step_size
        Number N of reported steps, and h = T / N.
    status, message
        Status of the run, and in words what happened if it is not ``ok``.
    failure
        The failure with reason, step and time as fields; None if ``ok``, or read from a file.
    history_operations
        Multiply-adds (weight times sample) spent on the memory.
    newton
        Record of Newton's iteration (zero iterations for linear scenes).
    setup_seconds, stepping_seconds
        Time for weights and factorisations, and for the steps.
    remarks
        What the reader of the numbers should know, for example that steps were too long.
    every
        Only every n-th point of the grid is kept, with the first and the last.
    diagnostics
        Works and energy balance on the same points; None unless requested.
    steps
        All steps as polynomials on their own mesh, where they were kept.
    rejected
        Rejected steps of an adaptive run.
    assessment
        Assessment of its error, if it was made for a tolerance.
    observed
        Quantities and events, if requested; then `time` are the times of the output.
    coordinates
        Names of the coordinates; empty: they have none.
    """

    time: Array
    position: Array
    n_steps: int
    step_size: float
    momentum: Array | None = None
    energy: Array | None = None
    status: Status = "ok"
    message: str = ""
    failure: Failure | None = None
    history_operations: int = 0
    newton: NewtonRecord = field(default_factory=NewtonRecord)
    setup_seconds: float = 0.0
    stepping_seconds: float = 0.0
    remarks: tuple[str, ...] = ()
    every: int = 1
    diagnostics: Diagnostics | None = None
    steps: RunSteps | None = None
    rejected: int = 0
    assessment: Assessment | None = None
    observed: Observed | None = None
    coordinates: tuple[str, ...] = ()

    @property
    def outcome(self) -> Outcome | None:
        """Whether a tolerance was met; None if there was no tolerance."""
        return None if self.assessment is None else self.assessment.outcome

    @property
    def error_estimate(self) -> float:
        """Estimated error of the position at any time, a length; nan without a tolerance."""
        return math.nan if self.assessment is None else self.assessment.estimate

    def __repr__(self) -> str:
        """The trajectory in one line."""
        return f"<{self._line()}>"

    def to_dataframe(self) -> Any:
        """A pandas DataFrame over the times: ``x1``, momenta ``p_x1``, energy and quantities.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return dataframe_of(self.time, self._columns())

    def to_xarray(self) -> Any:
        """An xarray Dataset along ``time`` and ``coordinate``: position, momentum and the others.

        Raises
        ------
        ImportError
            If xarray is not installed.
        """
        vectors = {"position": self.position, "momentum": self.momentum}
        scalars = {"energy": self.energy, **self._quantities()}
        return dataset_of(
            self.time,
            self._names(),
            {name: one for name, one in vectors.items() if one is not None},
            {name: one for name, one in scalars.items() if one is not None},
            {"status": self.status, "n_steps": self.n_steps},
        )

    def __call__(self, time: ArrayLike) -> Array:
        """Position at any times of the run, shape ``(...)`` to ``(..., d)``.

        It is the polynomial of each step, the trajectory of the integrator itself.

        Raises
        ------
        ValueError
            For times outside of the run, and where the steps were not kept.
        """
        return self._kept_steps()(time)

    def velocity(self, time: ArrayLike) -> Array:
        """Velocity at any times of the run, shape ``(...)`` to ``(..., d)``.

        Raises
        ------
        ValueError
            For times outside of the run, and where the steps were not kept.
        """
        return self._kept_steps().velocity_at(time)

    def _line(self) -> str:
        points, d = self.position.shape
        end = f"{self.time[-1]:.6g}" if points else "-"
        detail = f": {self.message}" if self.message else ""
        count = len(self.remarks)
        remarks = f", {count} remark{'s' if count > 1 else ''}" if count else ""
        return (
            f"Trajectory {self.status}{detail}, {points} points to t = {end}, {d} "
            f"coordinate{'s' if d > 1 else ''}, {self.n_steps} steps{remarks}"
        )

    def _names(self) -> tuple[str, ...]:
        """Names of the coordinates: their own, or ``x``, or ``x1``, ``x2``, ..."""
        d = self.position.shape[1]
        if len(self.coordinates) == d:
            return self.coordinates
        return ("x",) if d == 1 else tuple(f"x{k}" for k in range(1, d + 1))

    def _quantities(self) -> Mapping[str, Array]:
        return {} if self.observed is None else self.observed.quantities

    def _columns(self) -> dict[str, Array]:
        """Values at the reported times, by name: ``x1``, ``p_x1``, ``energy``, quantities."""
        names = self._names()
        found = {name: self.position[:, k] for k, name in enumerate(names)}
        if self.momentum is not None:
            found |= {f"p_{name}": self.momentum[:, k] for k, name in enumerate(names)}
        if self.energy is not None:
            found["energy"] = self.energy
        return {**found, **self._quantities()}

    def _kept_steps(self) -> RunSteps:
        if self.steps is None:
            raise ValueError(
                "trajectory: its steps were not kept; integrate with_steps=True by a Gauss method, "
                'such as integrate(scene, "gauss3", 100, with_steps=True)'
            )
        return self.steps


def thinned(trajectory: Trajectory, every: int) -> Trajectory:
    """Every n-th point of a whole trajectory, with the first and the last."""
    if every == 1:
        return trajectory
    last = trajectory.time.size - 1
    kept = np.arange(0, last + 1, every)
    if kept[-1] != last:
        kept = np.append(kept, last)
    momentum, energy = trajectory.momentum, trajectory.energy
    return replace(
        trajectory,
        time=trajectory.time[kept],
        position=trajectory.position[kept],
        momentum=None if momentum is None else momentum[kept],
        energy=None if energy is None else energy[kept],
        diagnostics=None if trajectory.diagnostics is None else trajectory.diagnostics.at(kept),
        every=every,
    )
