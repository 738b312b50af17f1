r"""The motion between the points of a mesh, to the order of the method at the points.

The polynomial of a step of an m-stage method has the order m + 1, its velocity m, and the damping
force along it less; at the mesh points the Gauss method has 2 m. So a second run on the same mesh,
by the Gauss method of 2 m stages, gives the shape of every step, and a cubic corrects it to the
positions and velocities of the run at both ends: :math:`x(t_n) = q_n`, :math:`x'(t_n) = v_n`
exactly, without loss of order between them. In stiff motions a velocity may be less accurate than
that of the step's own polynomial: then it is not used. With damping of an order above 1 the momenta
are not used: :math:`M v = p_0 - \mu I^{2 - \gamma} v - \dots` at the end of a step has an error of
:math:`h_1^{2 - \gamma}` (Riemann-Liouville, :math:`v_0 \neq 0`) or :math:`h_1^{3 - \gamma}` of the
first step that never decays, since the stability function of a Gauss method is +-1 at infinity;
a straight line then corrects the shape to the positions. The slopes are those of the increments of
the steps: in the shortest ones the difference of two positions is round-off. The damping force at
any time is the polynomial through its stage values in that second run, and the acceleration
follows from the equation of motion,

.. math:: M a = f(t) - \nabla V(x) - \sum_j \mu_j D^{\gamma_j} x, \qquad
   L_{vv} a = L_x - L_{vx} v - L_{vt} + f - \sum_j \mu_j D^{\gamma_j} x,

never from differences. The only exceptions are Riemann-Liouville derivatives of an order above 1
with :math:`v_0 \neq 0`, whose stage values keep the error of the first step as the momenta do:
there the acceleration is the derivative of the velocity polynomial, and the force follows from the
equation of motion.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, reduce

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.singular_start import rate_jumps
from fvi_cli.integrator.observations.at_start import (
    damping_at_start,
    riemann_liouville_excess,
    with_infinite_start,
)
from fvi_cli.integrator.observations.pieces import by_owner
from fvi_cli.integrator.results.run_steps import Located, RunSteps, located_once
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.mathematics.series.chebyshev import (
    evaluate_series,
    in_rows,
    second_kind_points,
    slopes_of_series,
    to_coefficients,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseMotion:
    r"""Motions of q members at any time of their runs.

    All steps are numbered in one row: first those of the first member, then those of the next. A
    place is a step and a number from 0 to 1.
    """

    scenes: tuple[Scene, ...]
    steps: tuple[RunSteps, ...]
    # steps on the same meshes that give the motion between their points; the steps of a run itself
    # if there are no better ones
    shapes: tuple[RunSteps, ...]
    # damping forces of every member at the stages of its shape, (k, n, r, d), to be added up; for
    # the place of a damper its force with memory, on its deformation; None without damping
    find_forces: Callable[[int | None], Sequence[Array | None]]
    remarks: tuple[str, ...] = ()  # of each; empty: none
    # whether velocities at t = 0 are those of the scenes; for derivatives of runs they are
    # polynomials
    are_starts_given: bool = False
    # the only steps of which positions and momenta are needed, ascending; they have new numbers.
    # None: all
    chosen: Places | None = None
    known: Located = field(default_factory=dict)  # the last times of :meth:`located`

    # the mesh

    @cached_property
    def firsts(self) -> Places:
        """Number of the first step of every member, and of all steps, ``(q + 1,)``."""
        return np.append(0, np.cumsum([one.n_steps for one in self.steps]))

    @cached_property
    def owner(self) -> Places:
        """Member of every step, ``(N,)``."""
        if self.chosen is not None:
            return np.searchsorted(self.firsts, self.chosen, side="right") - 1
        return np.repeat(np.arange(len(self.steps)), [one.n_steps for one in self.steps])

    @cached_property
    def _own(self) -> Sequence[Places | slice]:
        """The steps of every member by their numbers in its run."""
        if self.chosen is None:
            return [slice(None)] * len(self.steps)
        edges = np.searchsorted(self.chosen, self.firsts).tolist()
        pairs = zip(itertools.pairwise(edges), self.firsts, strict=False)
        return [self.chosen[slice(*pair)] - first for pair, first in pairs]

    def _of_steps(self, values: Iterable[Array]) -> list[Array]:
        """The values of every member, ``(n, ...)``, at its chosen steps."""
        return [one[own] for one, own in zip(values, self._own, strict=True)]

    @cached_property
    def begin(self) -> Array:
        """Where steps begin, ``(N,)``."""
        return np.concatenate(self._of_steps(one.time[:-1] for one in self.steps))

    @cached_property
    def end(self) -> Array:
        """Where steps end, ``(N,)``."""
        return np.concatenate(self._of_steps(one.time[1:] for one in self.steps))

    @cached_property
    def step_size(self) -> Array:
        """Lengths of steps, ``(N,)``."""
        return np.concatenate(self._of_steps(one.step_size for one in self.steps))

    def located(self, member: int, time: Array) -> tuple[Places, Array]:
        """Number of the step and place in it of times in the run of a member, shape ``(n,)``.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        steps, tau = located_once(self.known, self.steps[member], time)
        steps = steps + self.firsts[member]
        return steps if self.chosen is None else np.searchsorted(self.chosen, steps), tau

    def time(self, steps: Places, tau: Array) -> Array:
        """Times of places; the end of a step is the point of the mesh."""
        found = self.begin[steps] + tau * self.step_size[steps]
        return np.where(tau == 1.0, self.end[steps], found)

    # the motion: times, positions and velocities also at k places in each of n steps, (n, 1) and
    # (n, k)

    def position(self, steps: Places, tau: Array) -> Array:
        """Positions, shape ``(n, d)``."""
        increments, _ = self._polynomials
        displacement = evaluate_series(increments, steps, 2.0 * tau - 1.0)
        displacement[tau == 0.0] = 0.0
        return np.asarray(self._begins[steps] + self.step_size[steps][..., None] * displacement)

    def velocity(self, steps: Places, tau: Array) -> Array:
        """Velocities, shape ``(n, d)``."""
        _, rates = self._polynomials
        found = evaluate_series(rates, steps, 2.0 * tau - 1.0)
        starts = np.nonzero((tau == 0.0) & (self.begin[steps] == 0.0))
        members = self.owner[steps[starts[0]].ravel()].tolist()
        for *place, member in zip(*starts, members, strict=True):
            if self.are_starts_given or self.shapes[member] is not self.steps[member]:
                found[tuple(place)] = self.scenes[member].initial_velocity
        return found

    @cached_property
    def _begins(self) -> Array:
        return np.concatenate(self._of_steps(one.position[:-1] for one in self.steps))

    @cached_property
    def _polynomials(self) -> tuple[Array, Array]:
        """Chebyshev coefficients of increments over h and of velocities, both ``(K, N, d)``."""
        velocity = self._of_steps(one.velocity for one in self.shapes)
        increments = maps_of_stages(
            self.shapes, velocity, lambda t: t.increments_to_series @ t.to_unknowns
        )
        rates = stage_series(self.shapes, velocity)
        if all(one is own for one, own in zip(self.shapes, self.steps, strict=True)):
            return increments, rates
        gaps, (to_increments, to_rates) = self._gaps(), _corrections()
        return _corrected(increments, to_increments, gaps), _corrected(rates, to_rates, gaps)

    def _gaps(self) -> Array:
        """Corrections of the shapes' mean velocities and velocities at both ends, ``(3, N, d)``.

        Mean velocities are those of the increments, since in short steps the difference of two
        positions is round-off.
        """

        def means(steps: Sequence[RunSteps]) -> Array:
            velocity = self._of_steps(one.velocity for one in steps)
            return maps_of_stages(steps, velocity, lambda t: t.to_unknowns[-1:])

        def at_ends(steps: Sequence[RunSteps]) -> Array:
            velocity = self._of_steps(one.velocity for one in steps)
            return maps_of_stages(steps, velocity, lambda t: end_slopes(t.degree).T @ t.to_unknowns)

        found = np.repeat(means(self.steps) - means(self.shapes), 3, axis=0)
        ends = at_ends(self.shapes)
        off, slopes = at_ends(self.steps) - ends, np.full_like(ends, np.nan)
        edges = np.searchsorted(self.owner, np.arange(len(self.steps) + 1)).tolist()
        every = zip(self.scenes, self.steps, self.shapes, itertools.pairwise(edges), strict=True)
        for member, (scene, steps, shape, pair) in enumerate(every):
            is_rough = any(term.order > 1 for term in scene.active_damping)
            if not is_rough and steps is not shape:
                at = np.arange(steps.n_steps)[self._own[member]]
                with np.errstate(all="ignore"):
                    slopes[:, slice(*pair)] = self._velocities(member, at)
        slopes -= ends
        found[1:] = np.where(are_nearer(slopes, off), slopes, found[1:])
        return found

    def _velocities(self, member: int, at: Places) -> Array:
        """Velocities of a run where some of its steps begin and where they end, ``(2, n, d)``."""
        scene, steps = self.scenes[member], self.steps[member]
        is_end = np.zeros(steps.n_steps + 1, dtype=bool)
        is_end[at] = is_end[at + 1] = True
        points, places = np.flatnonzero(is_end), np.cumsum(is_end) - 1
        x, p, t = (one[points] for one in (steps.position, steps.momentum, steps.time))
        behind = before = scene.velocity(x, p, t)
        if steps.jump is not None:
            before = scene.velocity(x, p - steps.jump[points], t)
        return np.stack([behind[places[at]], before[places[at + 1]]])

    def momentum_and_energy(
        self, position: Array, steps: Places, tau: Array
    ) -> tuple[Array, Array]:
        """Momenta, shape ``(n, d)``, and energies, ``(n,)``, at places with these positions."""
        time, velocity = self.time(steps, tau), self.velocity(steps, tau)
        momentum, energy = np.empty_like(position), np.empty(steps.size)
        for member, own in by_owner(self.owner, steps, len(self.scenes)):
            scene = self.scenes[member]
            with np.errstate(all="ignore"):
                momentum[own] = scene.momentum(position[own], velocity[own], time[own])
                energy[own] = scene.energy(position[own], momentum[own], time[own])
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
            scene = self.scenes[member]
            if rate_jumps(scene):
                total[own] = self._force_by_balance(scene, steps[own], tau[own])
            with np.errstate(all="ignore"):
                total[own] -= riemann_liouville_excess(scene, time[own])
            total[own] = np.where((time[own] == 0.0)[:, None], damping_at_start(scene), total[own])
        return total

    @cached_property
    def _force_series(self) -> Array:
        """Chebyshev coefficients of the damping force, ``(K, N, d)``."""
        every = zip(self.find_forces(None), self.shapes, strict=True)
        return stage_series(
            self.shapes,
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
            if rate_jumps(scene):
                slopes = self._velocity_slope(steps[own], tau[own])
                found[own] = np.where((time[own] == 0.0)[:, None], np.nan, slopes)
                found[own] = with_infinite_start(scene, found[own], time[own])
                continue
            total = force[own]
            if scene.forcing is not None:
                total = total + scene.forcing(time[own])
            found[own] = accelerations(scene, position[own], velocity[own], total, time[own])
            found[own] = with_infinite_start(scene, found[own], time[own])
        return found

    def _velocity_slope(self, steps: Places, tau: Array) -> Array:
        """Derivatives of the velocity polynomials of the shapes, shape ``(n, d)``."""
        found = evaluate_series(self._slope_series, steps, 2.0 * tau - 1.0)
        return np.asarray(found / self.step_size[steps, None])

    @cached_property
    def _slope_series(self) -> Array:
        rate = stage_series(self.shapes, [one.velocity for one in self.shapes])
        slope = 2.0 * slopes_of_series(len(rate)).T @ rate.reshape(len(rate), -1)
        return slope.reshape(len(slope), *rate.shape[1:])

    def _force_by_balance(self, scene: Scene, steps: Places, tau: Array) -> Array:
        """Damping force that the equation of motion requires, shape ``(n, d)``."""
        time = self.time(steps, tau)
        position, velocity = self.position(steps, tau), self.velocity(steps, tau)
        known = np.zeros_like(position) if scene.forcing is None else scene.forcing(time)
        missing = self._velocity_slope(steps, tau)
        missing = missing - accelerations(scene, position, velocity, known, time)
        if scene.lagrangian is None:
            return np.asarray(times(missing, scene.inertia.form))
        with np.errstate(all="ignore"):
            mass = scene.lagrangian.derivatives(position, velocity, time).mass
        return np.asarray(np.einsum("nij,nj->ni", mass, missing))


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
        rows = in_rows(own.swapaxes(1, 2).reshape(n * d, r), matrix_of(tables).T)
        found.append(np.ascontiguousarray(rows.reshape(n, d, -1).transpose(2, 0, 1)))
    return join_series(found)


def stage_series(steps: Sequence[RunSteps], values: Sequence[Array]) -> Array:
    """Chebyshev coefficients of polynomials through values at the stages, ``(K, N, d)``."""
    return maps_of_stages(steps, values, lambda tables: tables.stages_to_series)


def _corrected(series: Array, matrix: Array, gaps: Array) -> Array:
    """Series plus `matrix` times the gaps."""
    found = np.zeros((max(len(series), len(matrix)), *series.shape[1:]))
    found[: len(series)] = series
    for column, gap in zip(matrix.T, gaps, strict=True):
        found[: len(matrix)] += column[:, None, None] * gap
    return found


def join_series(series: Sequence[Array]) -> Array:
    """Series of members ``(K, n, d)`` one after the other, short ones padded with zeros."""
    if len(series) == 1:
        return series[0]
    ends = np.append(0, np.cumsum([one.shape[1] for one in series]))
    found = np.zeros((max(map(len, series)), int(ends[-1]), series[0].shape[2]))
    for one, begin, end in zip(series, ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        found[: len(one), begin:end] = one
    return found


@lru_cache(maxsize=32)
def end_slopes(degree: int) -> Array:
    """From U to velocities at the beginning and the end of a step, ``(s, 2)``."""
    return lobatto_basis(degree).derivatives([0.0, 1.0])[1:]


@lru_cache(maxsize=1)
def _corrections() -> tuple[Array, Array]:
    """From gaps of mean, first and last velocity to series of increments over h, and of rates."""
    z = second_kind_points(4)
    tau = 0.5 * (z + 1.0)
    rest = 1.0 - tau
    displacement = [tau**2 * (3.0 - 2.0 * tau), tau * rest**2, -rest * tau**2]
    rate = [6.0 * tau * rest, rest * (1.0 - 3.0 * tau), tau * (3.0 * tau - 2.0)]
    matrix = to_coefficients(z)
    return matrix @ np.stack(displacement, axis=1), matrix @ np.stack(rate, axis=1)


def are_nearer(momenta: Array, polynomials: Array) -> NDArray[np.bool_]:
    """Whether corrections by momenta are no larger than those by polynomials, at both ends.

    Momenta have twice the order; but in stiff motions they keep errors that decay at the stages.
    """
    return np.asarray((np.abs(momenta) <= np.abs(polynomials)).all(axis=0))


def largest_near(velocity: Array, at: Places) -> Array:
    """Largest velocities at the stages of some steps and of their neighbours, ``(n, d)``."""
    # stage by stage: NumPy reduces short axes one by one
    size = reduce(np.maximum, np.abs(velocity).swapaxes(0, 1))
    size = np.concatenate([size[:1], size, size[-1:]])
    return np.asarray(np.maximum(size[at + 1], np.maximum(size[at], size[at + 2])))


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
