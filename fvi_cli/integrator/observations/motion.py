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

Columns = tuple[int, ...]
"""Numbers of coordinates, from 0; only these are evaluated."""
AT_ONCE = 2**20
"""About so many numbers are held at a time where all coordinates are needed for a few."""


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
    # series of some coordinates, by what they are of
    series: dict[tuple[str, Columns | None], Array] = field(default_factory=dict)
    combinations: dict[tuple[str, Columns | None], Combination] = field(default_factory=dict)
    # rows of the inverse of constant mass matrices, of every member (c, d)
    rows: dict[Columns, list[Array]] = field(default_factory=dict)

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
    # (n, k); with columns only of these coordinates, (n, c) in place of (n, d)

    def position(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        """Positions, shape ``(n, d)``."""
        key = "position", columns
        if key not in self.combinations:
            self.combinations[key] = combination_of(
                self.steps, [_chosen(columns)] * len(self.steps)
            )
        return self.along(self.combinations[key], steps, tau)

    def velocity(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        """Velocities, shape ``(n, d)``."""
        key, take = ("velocity", columns), _chosen(columns)
        if key not in self.series:
            self.series[key] = stage_series(self.steps, [take(one.velocity) for one in self.steps])
        return evaluate_series(self.series[key], steps, 2.0 * tau - 1.0)

    def along(self, combination: Combination, steps: Places, tau: Array) -> Array:
        """Values of combinations of positions, shape ``(n, c)``."""
        displacement = evaluate_series(combination.increments, steps, 2.0 * tau - 1.0)
        displacement[tau == 0.0] = 0.0
        return np.asarray(
            combination.begins[steps] + self.step_size[steps][..., None] * displacement
        )

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

    def damping(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        r"""Force of the damping on every coordinate, :math:`-\sum \mu D^\gamma q`, ``(n, d)``."""
        take = _chosen(columns)
        count = self.scenes[0].dimension if columns is None else len(columns)
        total = np.zeros((steps.size, count))
        if not any(scene.active_forces for scene in self.scenes):
            return total
        key = "damping", columns
        if key not in self.series:
            self.series[key] = stage_series(self.steps, [take(one) for one in self._forces])
        total -= evaluate_series(self.series[key], steps, 2.0 * tau - 1.0)
        time = self.time(steps, tau)
        for member, own in by_owner(self.owner, steps, len(self.scenes)):
            if self.scenes[member].initial_loads:
                total[own] += take(self.scenes[member].initial_force(time[own]))
        return total

    @cached_property
    def _forces(self) -> list[Array]:
        """The damping force of every member at the stages, ``(n, r, d)``."""
        every = zip(self.find_forces(None), self.steps, strict=True)
        return [np.zeros_like(o.velocity) if one is None else one.sum(axis=0) for one, o in every]

    def acceleration(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        """Accelerations from the equation of motion, shape ``(n, d)``.

        At a break point of the forcing it is the acceleration before it.
        """
        if columns is None:
            return self._accelerations(steps, tau)
        if all(one.is_linear and not one.initial_loads for one in self.scenes):
            return self._linear_accelerations(steps, tau, columns)
        width = self.scenes[0].dimension
        if self.scenes[0].lagrangian is not None:
            width *= width
        count = max(AT_ONCE // width, 1)
        found, take = np.empty((steps.size, len(columns))), _chosen(columns)
        for first in range(0, steps.size, count):
            own = slice(first, first + count)
            found[own] = take(self._accelerations(steps[own], tau[own]))
        return found

    def _accelerations(self, steps: Places, tau: Array) -> Array:
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

    def _linear_accelerations(self, steps: Places, tau: Array, columns: Columns) -> Array:
        r"""Rows of :math:`M^{-1} (f - K x - \sum \mu D^\gamma x)`, each product one series."""
        key, scenes = ("acceleration", columns), self.scenes
        if columns not in self.rows:
            self.rows[columns] = [_rows_of_inverse_mass(scene, columns) for scene in scenes]
        rows = self.rows[columns]
        if key not in self.combinations:
            stiff = [
                np.zeros_like(row) if one.potential is None else one.potential.gradient(row)
                for one, row in zip(scenes, rows, strict=True)
            ]
            self.combinations[key] = combination_of(self.steps, [_combined(one) for one in stiff])
        found = -self.along(self.combinations[key], steps, tau)
        if any(scene.active_forces for scene in scenes):
            if key not in self.series:
                every = zip(self._forces, rows, strict=True)
                self.series[key] = stage_series(
                    self.steps, [_combined(row)(one) for one, row in every]
                )
            found -= evaluate_series(self.series[key], steps, 2.0 * tau - 1.0)
        time = self.time(steps, tau)
        for member, own in by_owner(self.owner, steps, len(scenes)):
            forcing = scenes[member].forcing
            if forcing is not None:
                found[own] += forcing.combined(time[own], rows[member])
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Combination:
    """Combinations of coordinates along steps."""

    begins: Array  # where steps begin, (N, c)
    increments: Array  # Chebyshev coefficients of increments over h, (K, N, c)


Taken = Callable[[Array], Array]


def combination_of(steps: Sequence[RunSteps], taken: Sequence[Taken]) -> Combination:
    """Linear combinations for every member, each from ``(..., d)`` to ``(..., c)``."""
    every = list(zip(taken, steps, strict=True))
    return Combination(
        begins=np.concatenate([take(one.position[:-1]) for take, one in every]),
        increments=maps_of_stages(
            steps,
            [take(one.velocity) for take, one in every],
            lambda tables: tables.increments_to_series @ tables.to_unknowns,
        ),
    )


def _chosen(columns: Columns | None) -> Taken:
    """Takes some coordinates of motions ``(..., d)``, or all."""
    if columns is None:
        return lambda motion: motion
    return lambda motion: motion[..., list(columns)]


def _combined(rows: Array) -> Taken:
    """Takes combinations ``(c, d)`` of coordinates of motions ``(..., d)``."""
    used = np.flatnonzero(rows.any(axis=0))
    weights = rows[:, used].T.copy()
    return lambda motion: np.asarray(motion[..., used] @ weights)


def _rows_of_inverse_mass(scene: Scene, columns: Columns) -> Array:
    """Rows of the inverse of a constant mass matrix, ``(c, d)``."""
    units = np.zeros((len(columns), scene.dimension))
    units[range(len(columns)), columns] = 1.0
    return scene.inertia.velocity(units)


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
