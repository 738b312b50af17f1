r"""All steps of a finished run, as polynomials.

On step n the position is :math:`x(t_n + \tau h) = q_n + h \sum_i \beta_i(\tau) V_i`, where
:math:`\beta_i` is the integral of the Lagrange polynomial of stage i: the trajectory of the
variational integrator itself, no interpolation of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.lagrange import lobatto_basis

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSteps:
    """Steps of a run on its own mesh, which may be finer than the grid that is reported.

    Parameters
    ----------
    tables
        Numbers of the method.
    time, position, momentum
        Points of the mesh, shapes ``(n + 1,)`` and ``(n + 1, d)``.
    step_size
        Shape ``(n,)``; equal steps have equal bits.
    velocity
        At the stages, shape ``(n, r, d)``.
    jump
        What impacts add to the momentum at the points, shape ``(n + 1, d)``, held in `momentum`
        already; None: nothing.
    """

    tables: StepTables
    time: Array
    position: Array
    momentum: Array
    step_size: Array
    velocity: Array
    jump: Array | None = None

    @property
    def n_steps(self) -> int:
        """Number of steps."""
        return int(self.step_size.size)

    @property
    def unknowns(self) -> Array:
        """Positions at the control points, (x - q_n) / h, shape ``(n, s, d)``."""
        inverse = np.linalg.pinv(self.tables.slopes[1:].T)
        return np.asarray(np.einsum("sr,nrd->nsd", inverse, self.velocity))

    @property
    def stage_position(self) -> Array:
        """Positions at the stages, shape ``(n, r, d)``."""
        way = np.einsum("sr,nsd->nrd", self.tables.basis[1:], self.unknowns)
        return np.asarray(self.position[:-1, None] + self.step_size[:, None, None] * way)

    @property
    def stage_time(self) -> Array:
        """Times of the stages, shape ``(n, r)``."""
        return np.asarray(self.time[:-1, None] + self.step_size[:, None] * self.tables.points)

    def __call__(self, time: ArrayLike) -> Array:
        """Position at any times of the run, shape ``(...)`` to ``(..., d)``.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        (steps, tau), shape = self.located(time), np.shape(time)
        basis = lobatto_basis(self.tables.degree).values(tau)[1:]
        way = np.einsum("sk,ksd->kd", basis, self.unknowns[steps])
        found = self.position[steps] + self.step_size[steps, None] * way
        return np.asarray(found.reshape(*shape, self.position.shape[1]))

    def velocity_at(self, time: ArrayLike) -> Array:
        """Velocity at any times of the run, shape ``(...)`` to ``(..., d)``.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        (steps, tau), shape = self.located(time), np.shape(time)
        slopes = lobatto_basis(self.tables.degree).derivatives(tau)[1:]
        found = np.einsum("sk,ksd->kd", slopes, self.unknowns[steps])
        return np.asarray(found.reshape(*shape, self.position.shape[1]))

    def located(self, time: ArrayLike) -> tuple[NDArray[np.intp], Array]:
        """Step of every time, and its place in [0, 1] there, in one row.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        asked = np.asarray(time, dtype=float)
        flat = asked.ravel()
        if flat.size and not (self.time[0] <= flat.min() and flat.max() <= self.time[-1]):
            raise ValueError(
                f"time: {flat.min():g} to {flat.max():g} is not allowed; the run goes from "
                f"{self.time[0]:g} to {self.time[-1]:g}"
            )
        steps = np.clip(np.searchsorted(self.time, flat, side="right") - 1, 0, self.n_steps - 1)
        tau = np.clip((flat - self.time[steps]) / self.step_size[steps], 0.0, 1.0)
        return steps, tau
