r"""The motion between the points of a mesh: the polynomials of the steps themselves.

The polynomial of a step of an m-stage method has the order m + 1, its velocity m; at the points of
the mesh positions and momenta have 2 m. The damping force at any time is the polynomial through its
values at the stages, and the acceleration follows from the equation of motion,

.. math:: M a = f(t) - \nabla V(x) - \sum_j \mu_j D^{\gamma_j} x, \qquad
   L_{vv} a = L_x - L_{vx} v - L_{vt} + f - \sum_j \mu_j D^{\gamma_j} x,

never from differences. Of linear scenes only the coordinates that are asked for are evaluated.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.chebyshev import evaluate_series

Columns = tuple[int, ...]
"""Numbers of coordinates, from 0; only these are evaluated."""
Take = Callable[[Array], Array]
"""A linear map of motions, ``(..., d)`` to ``(..., c)``."""


class Motion:
    """Motions of q members by one method at any time of their runs.

    All steps are numbered in one row: first those of the first member, then those of the next. A
    place is a step and a number from 0 to 1; places of positions and velocities may also be k in
    each of n steps, ``(n, 1)`` and ``(n, k)``. With columns the last axis has these coordinates
    only. `forces` gives the damping force of every member at the stages, ``(n, r, d)``; for the
    place of a damper its force with memory, on its deformation.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        steps: Sequence[RunSteps],
        forces: Callable[[int | None], Sequence[Array]],
    ) -> None:
        self.scenes, self.steps = tuple(scenes), tuple(steps)
        counts = [one.n_steps for one in steps]
        self.firsts = np.append(0, np.cumsum(counts))  # first step of every member, and of all
        self.owner = np.repeat(np.arange(len(steps)), counts)  # member of every step
        self.begin = np.concatenate([one.time[:-1] for one in steps])
        self.end = np.concatenate([one.time[1:] for one in steps])
        self.step_size = np.concatenate([one.step_size for one in steps])
        self._forces, self._known = forces, dict[Hashable, Any]()

    def kept(self, key: Hashable, compute: Callable[[], Any]) -> Any:
        """What is computed once, by a key."""
        if key not in self._known:
            self._known[key] = compute()
        return self._known[key]

    def forces(self, place: int | None) -> Sequence[Array]:
        """The forces of the memory at the stages of every member."""
        found: Sequence[Array] = self.kept(("forces", place), lambda: self._forces(place))
        return found

    def located(self, member: int, time: Array) -> tuple[Places, Array]:
        """Number of the step and place in it of times in the run of a member, shape ``(n,)``.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        steps, tau = self.steps[member].located(time)
        return steps + self.firsts[member], tau

    def time(self, steps: Places, tau: Array) -> Array:
        """Times of places; the end of a step is the point of the mesh."""
        found = self.begin[steps] + tau * self.step_size[steps]
        return np.where(tau == 1.0, self.end[steps], found)

    def by_member(self, steps: Places) -> Iterator[tuple[int, Places | slice]]:
        """The members that own some of the steps, and which steps they own."""
        if len(self.scenes) == 1:
            yield 0, slice(None)
            return
        owner = self.owner[steps.ravel()]
        order = np.argsort(owner, kind="stable")
        members, firsts = np.unique(owner[order], return_index=True)
        yield from zip(members.tolist(), np.split(order, firsts[1:]), strict=True)

    def position(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        """Positions, shape ``(n, d)``."""
        return self.path(("position", columns), [_chosen(columns)] * len(self.steps), steps, tau)

    def velocity(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        """Velocities, shape ``(n, d)``; at the start of runs those that are given.

        Behind a singular start the polynomial of the first step is far from these.
        """
        take, key = _chosen(columns), ("velocity", columns)
        found = self.series(key, lambda: [take(one.velocity) for one in self.steps], steps, tau)
        owner = self.owner[steps]
        starts = (tau == 0.0) & (steps == self.firsts[owner])
        given = take(np.array([one.initial_velocity for one in self.scenes]))
        found[starts] = given[np.broadcast_to(owner, tau.shape)[starts]]
        return found

    def path(self, key: Hashable, takes: Sequence[Take], steps: Places, tau: Array) -> Array:
        """Linear maps of the positions of every member, ``(n, c)``, by a key of their own."""
        every, tables = list(zip(takes, self.steps, strict=True)), self.steps[0].tables
        begins = self.kept(
            ("begins", key),
            lambda: np.concatenate([take(one.position[:-1]) for take, one in every]),
        )
        to_series = tables.increments_to_series @ tables.to_unknowns
        moved = self.series(
            ("path", key),
            lambda: [take(one.velocity) for take, one in every],
            steps,
            tau,
            to_series,
        )
        moved[tau == 0.0] = 0.0
        return np.asarray(begins[steps] + self.step_size[steps][..., None] * moved)

    def series(
        self,
        key: Hashable,
        values: Callable[[], Sequence[Array]],
        steps: Places,
        tau: Array,
        to_series: Array | None = None,
    ) -> Array:
        """Polynomials from values of every member at the stages, ``(n, r, c)``, by a key."""
        matrix = self.steps[0].tables.stages_to_series if to_series is None else to_series
        series = self.kept(key, lambda: np.tensordot(matrix, np.concatenate(values()), axes=(1, 1)))
        return evaluate_series(series, steps, 2.0 * tau - 1.0)

    def momentum_and_energy(
        self, position: Array, steps: Places, tau: Array
    ) -> tuple[Array, Array]:
        """Momenta, shape ``(n, d)``, and energies, ``(n,)``, at places with these positions.

        At the points of the mesh the momenta are those of the method.
        """
        time, velocity = self.time(steps, tau), self.velocity(steps, tau)
        momentum, energy = np.empty_like(position), np.empty(steps.size)
        for member, own in self.by_member(steps):
            scene, run = self.scenes[member], self.steps[member]
            with np.errstate(all="ignore"):
                found = scene.momentum(position[own], velocity[own], time[own])
                if scene.prescribed is None:
                    number, place = steps[own] - self.firsts[member], tau[own, None]
                    found = np.where(place == 0.0, run.momentum[number], found)
                    found = np.where(place == 1.0, run.momentum[number + 1], found)
                momentum[own] = found
                energy[own] = scene.energy(position[own], found, time[own])
        return momentum, energy

    # forces

    def damping(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        r"""Force of the damping on every coordinate, :math:`-\sum \mu D^\gamma q`, ``(n, d)``."""
        takes = [_chosen(columns)] * len(self.scenes)
        return self._damping(("damping", columns), takes, steps, tau)

    def _damping(self, key: Hashable, takes: Sequence[Take], steps: Places, tau: Array) -> Array:
        """Linear maps of the force of the damping, ``(n, c)``."""
        if not any(scene.active_forces for scene in self.scenes):
            return np.zeros((steps.size, takes[0](self.scenes[0].initial_position).size))
        every = list(zip(takes, self.forces(None), strict=True))
        found = -self.series(key, lambda: [take(force) for take, force in every], steps, tau)
        if any(scene.initial_loads for scene in self.scenes):
            time = self.time(steps, tau)
            for member, own in self.by_member(steps):
                found[own] += self.scenes[member].initial_force(time[own], takes[member])
        return found

    def acceleration(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        """Accelerations from the equation of motion, shape ``(n, d)``.

        At a break point of the forcing it is the acceleration before it.
        """
        d = self.scenes[0].dimension
        columns = tuple(range(d)) if columns is None else columns
        if self.scenes[0].lagrangian is not None:
            return self._general_acceleration(steps, tau)[:, columns]
        key = "acceleration", columns
        units = np.eye(d)[list(columns)]
        rows: list[Array] = self.kept(
            key, lambda: [one.inertia.velocity(units) for one in self.scenes]
        )
        found = self._damping(("damping", *key), [_combined(one) for one in rows], steps, tau)
        if all(scene.is_linear for scene in self.scenes):
            every = zip(self.scenes, rows, strict=True)
            stiff = [partial(_stiff, scene, row) for scene, row in every]
            found -= self.path(key, stiff, steps, tau)
        time = self.time(steps, tau)
        for member, own in self.by_member(steps):
            scene, row = self.scenes[member], rows[member]
            if scene.forcing is not None:
                found[own] += scene.forcing(time[own], row)
            if scene.potential is not None and not scene.is_linear:
                position = self.position(steps[own], tau[own])
                found[own] -= scene.potential.gradient(position) @ row.T
        return found

    def _general_acceleration(self, steps: Places, tau: Array) -> Array:
        """Accelerations of Lagrangians."""
        time, position = self.time(steps, tau), self.position(steps, tau)
        velocity, found = self.velocity(steps, tau), self.damping(steps, tau)
        for member, own in self.by_member(steps):
            scene = self.scenes[member]
            assert scene.lagrangian is not None
            q, v, t, right = position[own], velocity[own], time[own], found[own]
            with np.errstate(all="ignore"):
                right = right + scene.lagrangian.remainder(q, v, np.zeros_like(v), t)
                if scene.forcing is not None:
                    right = right + scene.forcing(t)
                mass = scene.lagrangian.derivatives(q, v, t).mass
                found[own] = np.linalg.solve(mass, right[..., None])[..., 0]
        return found


def _chosen(columns: Columns | None) -> Take:
    """Takes some coordinates of motions, or all."""
    if columns is None:
        return lambda motion: motion
    return lambda motion: motion[..., list(columns)]


def _combined(rows: Array) -> Take:
    """Takes combinations ``(c, d)`` of coordinates of motions."""
    used = np.flatnonzero(rows.any(axis=0))
    weights = rows[:, used].T.copy()
    return lambda motion: np.asarray(motion[..., used] @ weights)


def _stiff(scene: Scene, rows: Array, motion: Array) -> Array:
    """Rows times the stiffness of a linear scene, of motions."""
    force = np.zeros_like(rows) if scene.potential is None else scene.potential.gradient(rows)
    return _combined(force)(motion)
