r"""The motion between the points of a mesh: the polynomials of the steps themselves.

The polynomial of a step of an m-stage method has the order m + 1, its velocity m; at the points of
the mesh positions and momenta have 2 m. The damping force at any time is the polynomial through its
values at the stages, and the acceleration follows from the equation of motion,

.. math:: M a = f(t) - \nabla V(x) - \sum_j \mu_j D^{\gamma_j} x, \qquad
   L_{vv} a = L_x - L_{vx} v - L_{vt} + f - \sum_j \mu_j D^{\gamma_j} x,

never from differences. Only the coordinates that are asked for are evaluated, with those that their
forces depend on.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from fvi_cli.effects.potential import gradient_part
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.chebyshev import evaluate_series

Columns = tuple[int, ...]
"""Numbers of coordinates, from 0; only these are evaluated."""
Take = Callable[[Array], Array]
"""A linear map of motions, ``(..., d)`` to ``(..., c)``."""
AT_ONCE = 2**20  # numbers that are held where an acceleration needs many coordinates


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
        self.scenes, self.steps, self.forces = tuple(scenes), tuple(steps), forces
        counts = [one.n_steps for one in steps]
        self.firsts = np.append(0, np.cumsum(counts))  # first step of every member, and of all
        self.owner = np.repeat(np.arange(len(steps)), counts)  # member of every step
        self.begin = np.concatenate([one.time[:-1] for one in steps])
        self.end = np.concatenate([one.time[1:] for one in steps])
        self.step_size = np.concatenate([one.step_size for one in steps])
        self._known: dict[Hashable, Any] = {}

    def located(self, member: int, time: Array) -> tuple[Places, Array]:
        """Number of the step and place in it of times in the run of a member, shape ``(n,)``.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        run = self.steps[member]
        # members of a batch have one mesh and the same times
        same = run.time.tobytes(), time.tobytes()
        if self._known.get("times") != same:
            self._known |= {"times": same, "places": run.located(time)}
        steps, tau = self._known["places"]
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
        members, inverse = np.unique(self.owner[steps.ravel()], return_inverse=True)
        order = np.argsort(inverse, kind="stable")
        ends = np.cumsum(np.bincount(inverse))[:-1]
        yield from zip(members.tolist(), np.split(order, ends), strict=True)

    def position(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        """Positions, shape ``(n, d)``."""
        return self.path(("position", columns), [_chosen(columns)] * len(self.steps), steps, tau)

    def velocity(self, steps: Places, tau: Array, columns: Columns | None = None) -> Array:
        """Velocities, shape ``(n, d)``."""
        take = _chosen(columns)
        return self.series(
            ("velocity", columns), lambda: [take(one.velocity) for one in self.steps], steps, tau
        )

    def path(self, key: Hashable, takes: Sequence[Take], steps: Places, tau: Array) -> Array:
        """Linear maps of the positions of every member, ``(n, c)``, by a key of their own."""
        if ("begins", key) not in self._known:
            every = list(zip(takes, self.steps, strict=True))
            begins = np.concatenate([take(one.position[:-1]) for take, one in every])
            self._known["begins", key] = begins
        tables = self.steps[0].tables
        moved = self.series(
            ("path", key),
            lambda: [take(one.velocity) for take, one in zip(takes, self.steps, strict=True)],
            steps,
            tau,
            tables.increments_to_series @ tables.to_unknowns,
        )
        moved[tau == 0.0] = 0.0
        return np.asarray(
            self._known["begins", key][steps] + self.step_size[steps][..., None] * moved
        )

    def series(
        self,
        key: Hashable,
        values: Callable[[], Sequence[Array]],
        steps: Places,
        tau: Array,
        to_series: Array | None = None,
    ) -> Array:
        """Polynomials from values of every member at the stages, ``(n, r, c)``, by a key."""
        if key not in self._known:
            matrix = self.steps[0].tables.stages_to_series if to_series is None else to_series
            self._known[key] = np.tensordot(matrix, np.concatenate(values()), axes=(1, 1))
        return evaluate_series(self._known[key], steps, 2.0 * tau - 1.0)

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
        takes = [_chosen(columns)] * len(self.scenes)
        return self._damping(("damping", columns), takes, steps, tau)

    def _damping(self, key: Hashable, takes: Sequence[Take], steps: Places, tau: Array) -> Array:
        """Linear maps of the force of the damping, ``(n, c)``."""
        if not any(scene.active_forces for scene in self.scenes):
            return np.zeros((steps.size, takes[0](self.scenes[0].initial_position).size))
        if "forces" not in self._known:
            self._known["forces"] = self.forces(None)
        every = list(zip(takes, self._known["forces"], strict=True))
        found = -self.series(key, lambda: [take(one) for take, one in every], steps, tau)
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
            return self._in_slices(self._general_acceleration, steps, tau, columns, d * d)
        key = "acceleration", columns
        if key not in self._known:
            units = np.eye(d)[list(columns)]
            rows = [one.inertia.velocity(units) for one in self.scenes]
            self._known[key] = rows, [_combined(one) for one in rows]
        rows, takes = self._known[key]
        found = self._damping(("damping", *key), takes, steps, tau)
        if all(scene.is_linear for scene in self.scenes):
            stiff = [
                partial(_stiff, scene, row) for scene, row in zip(self.scenes, rows, strict=True)
            ]
            found -= self.path(key, stiff, steps, tau)
        else:
            found -= self._in_slices(self._restoring, steps, tau, columns, d)
        if any(scene.forcing is not None for scene in self.scenes):
            time = self.time(steps, tau)
            for member, own in self.by_member(steps):
                forcing = self.scenes[member].forcing
                if forcing is not None:
                    found[own] += forcing.combined(time[own], rows[member])
        return found

    def _in_slices(
        self,
        compute: Callable[[Places, Array, Columns], Array],
        steps: Places,
        tau: Array,
        columns: Columns,
        width: int,
    ) -> Array:
        """Values at places, each of which needs so many numbers."""
        found, count = np.empty((steps.size, len(columns))), max(AT_ONCE // width, 1)
        for first in range(0, steps.size, count):
            own = slice(first, first + count)
            found[own] = compute(steps[own], tau[own], columns)
        return found

    def _restoring(self, steps: Places, tau: Array, columns: Columns) -> Array:
        r"""Rows of :math:`M^{-1} \nabla V`, shape ``(n, c)``."""
        found = np.zeros((steps.size, len(columns)))
        for member, own in self.by_member(steps):
            potential = self.scenes[member].potential
            rows = self._known["acceleration", columns][0][member]
            if potential is None:
                continue
            components = tuple(np.flatnonzero(rows.any(axis=0)).tolist())
            key = "part", member, components
            if key not in self._known:
                self._known[key] = gradient_part(potential, components, rows.shape[1])
            used, gradient = self._known[key]
            position = self.position(steps[own], tau[own], used)
            found[own] = gradient(position) @ rows[:, components].T
        return found

    def _general_acceleration(self, steps: Places, tau: Array, columns: Columns) -> Array:
        """Accelerations of Lagrangians; nan where their masses or forces are not finite."""
        time, position = self.time(steps, tau), self.position(steps, tau)
        velocity, found = self.velocity(steps, tau), self.damping(steps, tau)
        for member, own in self.by_member(steps):
            scene = self.scenes[member]
            if scene.lagrangian is None:
                continue
            q, v, t, right = position[own], velocity[own], time[own], found[own]
            with np.errstate(all="ignore"):
                mass = scene.lagrangian.derivatives(q, v, t).mass
                right = right + scene.lagrangian.remainder(q, v, np.zeros_like(v), t)
                if scene.forcing is not None:
                    right = right + scene.forcing(t)
                every = np.concatenate([mass, right[..., None]], axis=-1)
                usable = np.asarray(np.isfinite(every).all(axis=(-2, -1)))
                mass = np.where(usable[:, None, None], mass, np.eye(scene.dimension))
                solved = np.linalg.solve(mass, right[..., None])[..., 0]
            found[own] = np.where(usable[:, None], solved, np.nan)
        return found[:, columns]


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
