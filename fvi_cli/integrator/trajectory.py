"""The result of an integration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Mask, Places

Status = Literal["ok", "failed", "refused"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Assessment:
    """Assessment of the error of a run for a tolerance."""

    tolerance: float  # in the norm of the experiment
    estimate: float  # of the error of the position at any time, the least that was reached
    reason: str = ""  # why it is not met, in one line; empty if it is met


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnostics:
    r"""Works and energies at the points of the mesh, ``(n,)`` each.

    Parameters
    ----------
    time
        The points.
    dissipated_work
        :math:`W_d(t) = \int_0^t v \cdot \sum_j \mu_j D^{\gamma_j} q`, and what impacts take.
    forcing_work
        :math:`W_f(t) = \int_0^t v \cdot f`, less :math:`\int_0^t \partial_t L`.
    energy_defect
        :math:`E(t) - E(0) + W_d(t) - W_f(t)`.
    stored_energy
        Energy in the memory of the damping; None for methods without a sum of exponentials.
    """

    time: Array
    dissipated_work: Array
    forcing_work: Array
    energy_defect: Array
    stored_energy: Array | None = None

    def at(self, kept: Places | Mask) -> Diagnostics:
        """The diagnostics at some of the points."""
        found: dict[str, Any] = {
            name: None if values is None else values[kept] for name, values in vars(self).items()
        }
        return Diagnostics(**found)


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How large a quantity becomes in a run, at any time; nan where it has no values."""

    peak: float = math.nan  # largest absolute value, and when it is reached first
    peak_time: float = math.nan
    least: float = math.nan
    greatest: float = math.nan
    rms: float = math.nan  # root of the mean square over the run
    error: float = math.nan  # estimated error of the peak; nan without a second run


@dataclass(frozen=True, kw_only=True, eq=False)
class Occurrences:
    """The times of an event."""

    time: Array  # (n,), and positions and velocities then, (n, d)
    position: Array
    velocity: Array

    def until(self, end: float) -> Occurrences:
        """Those up to a time."""
        kept = self.time <= end
        return Occurrences(
            time=self.time[kept], position=self.position[kept], velocity=self.velocity[kept]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Observed:
    """Outputs that were requested of a motion, by name."""

    mesh: Array  # points of the steps, (n + 1,)
    quantities: Mapping[str, Array] = field(default_factory=dict)  # at the reported times, (k,)
    extents: Mapping[str, Extent] = field(default_factory=dict)  # between all times
    events: Mapping[str, Occurrences] = field(default_factory=dict)
    stopped_by: str = ""  # event or surface that ended the run, or empty


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A discrete solution at the reported times (fewer when it stopped early).

    Where its steps were kept, ``trajectory(t)`` and ``trajectory.velocity(t)`` give position and
    velocity at any times.

    Parameters
    ----------
    time
        t_k = k h, the points of another mesh, or the times of the output, shape ``(n,)``.
    position, momentum
        Shape ``(n, d)``; no momentum for methods that have none.
    energy
        Hamiltonian without forcing, shape ``(n,)``, where there is a momentum.
    n_steps, step_size
        Number N of reported steps, and h = T / N.
    status, message
        Status of the run, and in words what happened if it is not ``ok``.
    history_operations
        Multiply-adds (weight times sample) spent on the memory.
    newton_iterations
        Iterations of Newton in all steps; 0 for linear scenes.
    seconds
        Time that it took.
    remarks
        What the reader of the numbers should know, for example that steps were too long.
    diagnostics
        Works and energy balance; None unless requested.
    steps
        All steps as polynomials on their own mesh, where they were kept.
    assessment
        Assessment of its error, if it was made for a tolerance.
    observed
        Quantities and events, if requested.
    on_mesh
        The same run at the points of its mesh, where an output chose other times.
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
    history_operations: int = 0
    newton_iterations: int = 0
    seconds: float = 0.0
    remarks: tuple[str, ...] = ()
    diagnostics: Diagnostics | None = None
    steps: RunSteps | None = None
    assessment: Assessment | None = None
    observed: Observed | None = None
    on_mesh: Trajectory | None = None
    coordinates: tuple[str, ...] = ()

    @property
    def met(self) -> bool | None:
        """Whether a tolerance was met; None if there was no tolerance."""
        return None if self.assessment is None else not self.assessment.reason

    @property
    def error_estimate(self) -> float:
        """Estimated error of the position at any time, a length; nan without a tolerance."""
        return math.nan if self.assessment is None else self.assessment.estimate

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

    def at(self, kept: Places | Mask) -> Trajectory:
        """The run at some of its reported points."""
        momentum, energy, known = self.momentum, self.energy, self.diagnostics
        return replace(
            self,
            time=self.time[kept],
            position=self.position[kept],
            momentum=None if momentum is None else momentum[kept],
            energy=None if energy is None else energy[kept],
            diagnostics=None if known is None else known.at(kept),
        )

    def __repr__(self) -> str:
        """The trajectory in one line."""
        points, d = self.position.shape
        end = f"{self.time[-1]:.6g}" if points else "-"
        detail = f": {self.message}" if self.message else ""
        count = len(self.remarks)
        remarks = f", {count} remark{'s' if count > 1 else ''}" if count else ""
        return (
            f"<Trajectory {self.status}{detail}, {points} points to t = {end}, {d} "
            f"coordinate{'s' if d > 1 else ''}, {self.n_steps} steps{remarks}>"
        )

    def to_dataframe(self) -> Any:
        """A pandas DataFrame over the times: ``x1``, momenta ``p_x1``, energy and quantities.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        import pandas

        names = self._names()
        columns = {name: self.position[:, k] for k, name in enumerate(names)}
        if self.momentum is not None:
            columns |= {f"p_{name}": self.momentum[:, k] for k, name in enumerate(names)}
        index = pandas.Index(self._clean_times(), name="time")
        return pandas.DataFrame({**columns, **self._scalars()}, index=index)

    def to_xarray(self) -> Any:
        """An xarray Dataset along ``time`` and ``coordinate``: position, momentum and the others.

        Raises
        ------
        ImportError
            If xarray is not installed.
        """
        import xarray

        vectors = {"position": self.position, "momentum": self.momentum}
        found = {
            name: (("time", "coordinate"), values)
            for name, values in vectors.items()
            if values is not None
        }
        return xarray.Dataset(
            {**found, **{name: ("time", values) for name, values in self._scalars().items()}},
            coords={"time": self._clean_times(), "coordinate": list(self._names())},
            attrs={"status": self.status, "n_steps": self.n_steps},
        )

    def _names(self) -> tuple[str, ...]:
        """Names of the coordinates: their own, or ``x``, or ``x1``, ``x2``, ..."""
        d = self.position.shape[1]
        if len(self.coordinates) == d:
            return self.coordinates
        return ("x",) if d == 1 else tuple(f"x{k}" for k in range(1, d + 1))

    def _clean_times(self) -> Array:
        """Times without the round-off of k h: 0.3 in place of 0.30000000000000004."""
        return np.array([float(f"{t:.15g}") for t in self.time.tolist()])

    def _scalars(self) -> dict[str, Array]:
        """Energy and quantities at the reported times."""
        found = {} if self.energy is None else {"energy": self.energy}
        return found if self.observed is None else {**found, **self.observed.quantities}

    def _kept_steps(self) -> RunSteps:
        if self.steps is None:
            raise ValueError(
                "trajectory: its steps were not kept; integrate with_steps=True by a Gauss method, "
                'such as integrate(scene, "gauss3", 100, with_steps=True)'
            )
        return self.steps
