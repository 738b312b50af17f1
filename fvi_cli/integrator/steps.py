r"""All steps of a finished run, as polynomials.

On step n the position is :math:`x(t_n + \tau h) = q_n + h \sum_i \beta_i(\tau) V_i`, where
:math:`\beta_i` is the integral of the Lagrange polynomial of stage i: the trajectory of the
variational integrator itself, no interpolation of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.mesh import Mesh, are_near, mesh_through
from fvi_cli.integrator.tables import StepTables
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSteps:
    """Steps of a run on its own mesh, which may be finer than the grid that is reported."""

    tables: StepTables  # numbers of the method
    time: Array  # points of the mesh, shapes (n + 1,) and (n + 1, d)
    position: Array
    momentum: Array
    step_size: Array  # shape (n,); equal steps have equal bits
    velocity: Array  # at the stages, shape (n, r, d)
    # changes of the momentum by impacts at the points, shape (n + 1, d), already included in
    # `momentum`; None: no impacts
    jump: Array | None = None

    @property
    def n_steps(self) -> int:
        """Number of steps."""
        return int(self.step_size.size)

    @cached_property
    def unknowns(self) -> Array:
        """Positions at the control points, (x - q_n) / h, shape ``(n, s, d)``."""
        return np.asarray(np.einsum("sr,nrd->nsd", self.tables.to_unknowns, self.velocity))

    @property
    def stage_position(self) -> Array:
        """Positions at the stages, shape ``(n, r, d)``."""
        displacement = np.einsum("sr,nsd->nrd", self.tables.basis[1:], self.unknowns)
        return np.asarray(self.position[:-1, None] + self.step_size[:, None, None] * displacement)

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
        steps, tau = self.located(time)
        basis = lobatto_basis(self.tables.degree).values(tau)[1:]
        displacement = np.einsum("sk,ksd->kd", basis, self.unknowns[steps])
        found = self.position[steps] + self.step_size[steps, None] * displacement
        return np.asarray(found.reshape(*np.shape(time), -1))

    def velocity_at(self, time: ArrayLike) -> Array:
        """Velocity at any times of the run, shape ``(...)`` to ``(..., d)``.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        steps, tau = self.located(time)
        slopes = lobatto_basis(self.tables.degree).derivatives(tau)[1:]
        found = np.einsum("sk,ksd->kd", slopes, self.unknowns[steps])
        return np.asarray(found.reshape(*np.shape(time), -1))

    def momenta_of_polynomials(self, scene: Scene) -> Array:
        r"""Momenta at the points from the velocities at the ends of the steps, ``(n + 1, d)``.

        Where a velocity is like :math:`t^{2 - \gamma}`, the momenta of Gauss methods keep an error
        like :math:`\tau^{2 - \gamma}` of the first step :math:`\tau`, since their stability
        function has the size 1 at infinity; the polynomials do not have it.
        """
        slopes = lobatto_basis(self.tables.degree).derivatives([1.0])[1:, 0]
        velocity = np.einsum("s,nsd->nd", slopes, self.unknowns)
        found = self.momentum.copy()
        found[1:] = scene.momentum(self.position[1:], velocity, self.time[1:])
        if self.jump is not None:
            found[1:] += self.jump[1:]
        return found

    def located(self, time: ArrayLike) -> tuple[Places, Array]:
        """Step of every time, and its place in [0, 1] there, as flat arrays.

        A point of the mesh is the end of a step.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        flat = np.asarray(time, dtype=float).ravel()
        slack = 1e-12 * (self.time[-1] - self.time[0])
        if flat.size and not (self.time[0] <= flat.min() and flat.max() <= self.time[-1] + slack):
            span = " to ".join(dict.fromkeys(f"{t:g}" for t in (flat.min(), flat.max())))
            raise ValueError(
                f"time: {span} is not allowed; the run goes from "
                f"{self.time[0]:g} to {self.time[-1]:g}"
            )
        steps = np.clip(np.searchsorted(self.time, flat) - 1, 0, self.n_steps - 1)
        tau = np.clip((flat - self.time[steps]) / self.step_size[steps], 0.0, 1.0)
        # a point of the mesh is met exactly, whatever the last digit of the step size
        return steps, np.where(flat == self.time[steps + 1], 1.0, tau)

    def first(self, count: int) -> RunSteps:
        """The first steps alone."""
        return replace(
            self,
            time=self.time[: count + 1],
            position=self.position[: count + 1],
            momentum=self.momentum[: count + 1],
            step_size=self.step_size[:count],
            velocity=self.velocity[:count],
            jump=None if self.jump is None else self.jump[: count + 1],
        )

    def mesh(self, breaks: Sequence[float]) -> Mesh:
        """The mesh of the run; successive steps of the same size are one stretch.

        At the breaks the motion may be singular.
        """
        edges = 1 + np.flatnonzero(
            (np.diff(self.step_size) != 0.0) | are_near(self.time[1:-1], breaks)
        )
        return mesh_through(self.time, self.step_size, edges, breaks)
