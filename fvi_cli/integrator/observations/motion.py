r"""The motion between the points of a mesh: the polynomials of the steps themselves.

The polynomial of a step of an m-stage method has the order m + 1, its velocity m; at the points of
the mesh positions and momenta have 2 m. The damping force at any time is the polynomial through its
values at the stages, and the acceleration follows from the equation of motion,

.. math:: M a = f(t) - \nabla V(x) - \sum_j \mu_j D^{\gamma_j} x, \qquad
   L_{vv} a = L_x - L_{vx} v - L_{vt} + f - \sum_j \mu_j D^{\gamma_j} x,

never from differences.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observations.pieces import by_owner
from fvi_cli.integrator.results.run_steps import Located, RunSteps, located_once
from fvi_cli.integrator.tables import StepTables
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.series.chebyshev import evaluate_series


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseMotion:
    r"""Motions of q members at any time of their runs.

    All steps are numbered in one row: first those of the first member, then those of the next. A
    place is a step and a number from 0 to 1.
    """

    scenes: tuple[Scene, ...]
    steps: tuple[RunSteps, ...]
    # damping forces of every member at the stages, (k, n, r, d), to be added up; for the place of a
    # damper its force with memory, on its deformation; None without damping
    find_forces: Callable[[int | None], Sequence[Array | None]]
    known: Located = field(default_factory=dict)  # the last times of :meth:`located`

    # the mesh

    @cached_property
    def firsts(self) -> Places:
        """Number of the first step of every member, and of all steps, ``(q + 1,)``."""
        return np.append(0, np.cumsum([one.n_steps for one in self.steps]))

    @cached_property
    def owner(self) -> Places:
        """Member of every step, ``(N,)``."""
        return np.repeat(np.arange(len(self.steps)), [one.n_steps for one in self.steps])

    @cached_property
    def begin(self) -> Array:
        """Where steps begin, ``(N,)``."""
        return np.concatenate([one.time[:-1] for one in self.steps])

    @cached_property
    def end(self) -> Array:
        """Where steps end, ``(N,)``."""
        return np.concatenate([one.time[1:] for one in self.steps])

    @cached_property
    def step_size(self) -> Array:
        """Lengths of steps, ``(N,)``."""
        return np.concatenate([one.step_size for one in self.steps])

    def located(self, member: int, time: Array) -> tuple[Places, Array]:
        """Number of the step and place in it of times in the run of a member, shape ``(n,)``.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        steps, tau = located_once(self.known, self.steps[member], time)
        return steps + self.firsts[member], tau

    def time(self, steps: Places, tau: Array) -> Array:
        """Times of places; the end of a step is the point of the mesh."""
        found = self.begin[steps] + tau * self.step_size[steps]
        return np.where(tau == 1.0, self.end[steps], found)

    # the motion: times, positions and velocities also at k places in each of n steps, (n, 1) and
    # (n, k)

    def position(self, steps: Places, tau: Array) -> Array:
        """Positions, shape ``(n, d)``."""
        displacement = evaluate_series(self._increments, steps, 2.0 * tau - 1.0)
        displacement[tau == 0.0] = 0.0
        return np.asarray(self._begins[steps] + self.step_size[steps][..., None] * displacement)

    def velocity(self, steps: Places, tau: Array) -> Array:
        """Velocities, shape ``(n, d)``."""
        return evaluate_series(self._rates, steps, 2.0 * tau - 1.0)

    @cached_property
    def _begins(self) -> Array:
        return np.concatenate([one.position[:-1] for one in self.steps])

    @cached_property
    def _increments(self) -> Array:
        """Chebyshev coefficients of increments over h, ``(K, N, d)``."""
        velocity = [one.velocity for one in self.steps]
        return maps_of_stages(
            self.steps, velocity, lambda t: t.increments_to_series @ t.to_unknowns
        )

    @cached_property
    def _rates(self) -> Array:
        """Chebyshev coefficients of velocities, ``(K, N, d)``."""
        return stage_series(self.steps, [one.velocity for one in self.steps])

    def momentum_and_energy(
        self, position: Array, steps: Places, tau: Array
    ) -> tuple[Array, Array]:
        """Momenta, shape ``(n, d)``, and energies, ``(n,)``, at places with these positions.

        At the points of the mesh the momenta are those of the method.
        """
        time, velocity = self.time(steps, tau), self.velocity(steps, tau)
        momentum, energy = np.empty_like(position), np.empty(steps.size)
        for member, own in by_owner(self.owner, steps, len(self.scenes)):
            scene, run = self.scenes[member], self.steps[member]
            with np.errstate(all="ignore"):
                found = scene.momentum(position[own], velocity[own], time[own])
                if scene.prescribed is None:
                    number, place = steps[own] - self.firsts[member], tau[own]
                    end = run.momentum if run.jump is None else run.momentum - run.jump
                    found = np.where((place == 0.0)[:, None], run.momentum[number], found)
                    found = np.where((place == 1.0)[:, None], end[number + 1], found)
                momentum[own] = found
                energy[own] = scene.energy(position[own], found, time[own])
        return momentum, energy

    # forces

    def damping(self, steps: Places, tau: Array) -> Array:
        r"""Force of the damping on every coordinate, :math:`-\sum \mu D^\gamma q`, ``(n, d)``."""
        total = np.zeros((steps.size, self._begins.shape[1]))
        if not any(scene.active_forces for scene in self.scenes):
            return total
        total -= evaluate_series(self._force_series, steps, 2.0 * tau - 1.0)
        time = self.time(steps, tau)
        for member, own in by_owner(self.owner, steps, len(self.scenes)):
            if self.scenes[member].initial_loads:
                total[own] += self.scenes[member].initial_force(time[own])
        return total

    @cached_property
    def _force_series(self) -> Array:
        """Chebyshev coefficients of the damping force, ``(K, N, d)``."""
        every = zip(self.find_forces(None), self.steps, strict=True)
        return stage_series(
            self.steps,
            [np.zeros_like(o.velocity) if one is None else one.sum(axis=0) for one, o in every],
        )

    def acceleration(self, steps: Places, tau: Array) -> Array:
        """Accelerations from the equation of motion, shape ``(n, d)``.

        At a break point of the forcing it is the acceleration before it.
        """
        time, position = self.time(steps, tau), self.position(steps, tau)
        velocity, force = self.velocity(steps, tau), self.damping(steps, tau)
        found = np.empty_like(position)
        for member, own in by_owner(self.owner, steps, len(self.scenes)):
            scene = self.scenes[member]
            total = force[own]
            if scene.forcing is not None:
                total = total + scene.forcing(time[own])
            found[own] = accelerations(scene, position[own], velocity[own], total, time[own])
        return found


def maps_of_stages(
    steps: Sequence[RunSteps], values: Sequence[Array], matrix_of: Callable[[StepTables], Array]
) -> Array:
    """Linear maps of values at the stages on the steps of all members, ``(K, N, d)``."""
    found = []
    for tables, pairs in itertools.groupby(
        zip(steps, values, strict=True), lambda pair: pair[0].tables
    ):
        own = np.concatenate([one for _, one in pairs])
        n, r, d = own.shape
        rows = np.matmul(own.swapaxes(1, 2).reshape(n * d, r), matrix_of(tables).T)
        found.append(np.ascontiguousarray(rows.reshape(n, d, -1).transpose(2, 0, 1)))
    return join_series(found)


def stage_series(steps: Sequence[RunSteps], values: Sequence[Array]) -> Array:
    """Chebyshev coefficients of polynomials through values at the stages, ``(K, N, d)``."""
    return maps_of_stages(steps, values, lambda tables: tables.stages_to_series)


def join_series(series: Sequence[Array]) -> Array:
    """Series of members ``(K, n, d)`` one after the other, short ones padded with zeros."""
    if len(series) == 1:
        return series[0]
    ends = np.append(0, np.cumsum([one.shape[1] for one in series]))
    found = np.zeros((max(map(len, series)), int(ends[-1]), series[0].shape[2]))
    for one, begin, end in zip(series, ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        found[: len(one), begin:end] = one
    return found


def accelerations(
    scene: Scene, position: Array, velocity: Array, force: Array, time: Array
) -> Array:
    """Accelerations under further forces than those of the Lagrangian, all of shape ``(n, d)``."""
    with np.errstate(all="ignore"):
        lagrangian = scene.lagrangian
        if lagrangian is not None:
            mass = lagrangian.derivatives(position, velocity, time).mass
            at_rest = np.zeros_like(velocity)
            right = force + lagrangian.remainder(position, velocity, at_rest, time)
            every = np.concatenate([mass, right[..., None]], axis=-1)
            usable = np.asarray(np.isfinite(every).all(axis=(-2, -1)))
            mass = np.where(usable[:, None, None], mass, np.eye(scene.dimension))
            found = np.linalg.solve(mass, right[..., None])[..., 0]
            return np.where(usable[:, None], found, np.nan)
        _, conservative = scene.forces(position, velocity, time)
        return scene.inertia.velocity(conservative + force)
