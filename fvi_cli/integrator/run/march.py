"""The one loop: a run over the stretches of a mesh, or with steps that are found on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.matrices import dense
from fvi_cli.integrator.advance import advanced
from fvi_cli.integrator.convolution.damping import LONGEST_BLOCK
from fvi_cli.integrator.convolution.step_group import GROUP, StepGroup
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.domain import check_domain
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.growth_bound import first_outside
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch
from fvi_cli.integrator.run.grouped_steps import grouped_steps
from fvi_cli.integrator.run.loop import Course, Marker, no_unique_solution
from fvi_cli.integrator.run.newton_stretch import NewtonStretch
from fvi_cli.integrator.run.setup import RunSetup
from fvi_cli.integrator.run.sink import Sink
from fvi_cli.integrator.steps.block_lengths import newton_block
from fvi_cli.integrator.steps.block_response import LinearSystems
from fvi_cli.integrator.steps.dynamics import General, Separable
from fvi_cli.integrator.steps.linear_blocks import (
    LinearBlocks,
    block_length,
    memory_operations,
)
from fvi_cli.mathematics.arrays import Array

SINGLE_CHUNK = 256
"""The same where no steps are done in blocks."""

CHUNK = 4096
"""Steps after which a run may stop and go on: then nothing is left of how they were done."""

LARGEST_CHUNK = 2**20
"""Numbers in the positions of these steps, at most."""


@dataclass(frozen=True, kw_only=True)
class MeshPlan:
    """How the steps of a mesh will be done, and what their memory takes.

    Parameters
    ----------
    n_steps, single
        Steps of the mesh, and those of them that are done one by one.
    block
        Most steps of a block; 0: there are none.
    systems, coupled
        Independent systems that are stepped side by side, and components of each.
    has_modes
        Whether these are modes of the scene, no components of its coordinates.
    n_states
        States that stand for the past.
    operations
        Multiply-adds of the memory.
    n_lags
        Steps of the past that are remembered one by one in states of their own; all others are
        exponentials.
    """

    n_steps: int
    single: int
    block: int
    systems: int
    coupled: int
    has_modes: bool
    n_states: int
    operations: int
    n_lags: int = 0


def chunk_steps(dimension: int) -> int:
    """Steps of a chunk of a run with so many degrees of freedom."""
    return max(16, min(CHUNK, LARGEST_CHUNK // dimension))


class March:
    """Steps of a mesh, chunk by chunk.

    Parameters
    ----------
    setup, mesh, sink
        What is ready, where steps are, and what keeps the points.
    done
        Steps that are finished already.
    """

    def __init__(self, setup: RunSetup, mesh: Mesh, sink: Sink, *, done: int = 0) -> None:
        self._setup, self._mesh, self._sink = setup, mesh, sink
        self._solver = setup.stepper.solver
        self._chunk_steps = chunk_steps(setup.scene.dimension)
        if not setup.in_blocks:
            self._chunk_steps = min(self._chunk_steps, SINGLE_CHUNK)
        self._linear: dict[tuple[float, int], LinearBlocks] = {}
        self._groups: dict[float, StepGroup] = {}
        self._newton: dict[tuple[float, int], NewtonStretch] = {}
        self._last_of_size = {one.step_size: k for k, one in enumerate(mesh.stretches)}
        self._of_size: dict[float, int] = {}
        for one in mesh.stretches:
            self._of_size[one.step_size] = self._of_size.get(one.step_size, 0) + one.n_steps
        damping = setup.damping
        self._per_step = 0 if damping is None else damping.operations_per_step
        self._most = LONGEST_BLOCK if damping is None else damping.longest_block
        self._systems: tuple[LinearSystems, Decoupling] | None = None
        self.course = Course()
        self.failure: Failure | None = None
        self.done = done
        self.operations = 0

    def run(
        self, marker: Marker, *, stretch: int = 0, step: int = 0, until: int | None = None
    ) -> tuple[int, int] | None:
        """Steps from a place in the mesh on; `failure` says what stopped them, if anything.

        Parameters
        ----------
        marker
            State at that place.
        stretch, step
            Number of the stretch, and finished steps of it.
        until
            Stop where at least so many steps of the whole run are done; the end by default.

        Returns
        -------
        tuple of int, or None
            Where to go on; None at the end and after a failure.
        """
        with np.errstate(all="ignore"):
            for index in range(stretch, len(self._mesh.stretches)):
                one = self._mesh.stretches[index]
                first = step if index == stretch else 0
                while first < one.n_steps and not self.failure:
                    if until is not None and self.done >= until:
                        return index, first
                    count = min(self._chunk_steps, one.n_steps - first)
                    self._chunk(marker, one, first, count)
                    first += count
                if self.failure:
                    break
                self._forget(one.step_size, index)
        return None

    def _forget(self, h: float, index: int) -> None:
        """Let matrices go with the last stretch of their step size."""
        if self._last_of_size[h] == index:
            for made in (self._linear, self._newton):
                for key in [key for key in made if key[0] == h]:
                    del made[key]

    def plan(self) -> MeshPlan:
        """How :meth:`run` will do the steps; nothing is computed."""
        dynamics = self._solver.dynamics
        stages, d = self._solver.sampling.driving.shape[0], dynamics.dimension
        q, e, has_modes = 1, d, False
        decoupling = self._setup.decoupling
        if decoupling is not None:
            q, has_modes = decoupling.batch, decoupling.has_modes
            e = d // q
        single = largest = operations = 0
        for one in self._mesh.stretches:
            inside = min(one.n_steps, self._chunk_steps) if self._setup.in_blocks else 0
            if dynamics.is_linear:
                block = 0 if decoupling is None else block_length(stages, q, e, inside, self._most)
            else:
                general = isinstance(dynamics, General)
                block = newton_block(stages * d, inside, general=general)
            whole, rest = divmod(one.n_steps, self._chunk_steps)
            for count, times in ((self._chunk_steps, whole), (rest, 1)):
                if count == 0 or times == 0:
                    continue
                if block == 0 or (dynamics.is_linear and count < block):
                    single += times * count
                    operations += times * count * self._per_step
                elif dynamics.is_linear:
                    largest = max(largest, block)
                    operations += times * memory_operations(
                        count,
                        block,
                        q,
                        e,
                        stages,
                        self._setup.n_states,
                        self._per_step,
                        self._of_size[one.step_size],
                    )
                else:
                    largest = max(largest, block)
                    operations += times * count * self._per_step
        return MeshPlan(
            n_steps=self._mesh.n_steps,
            single=single,
            block=largest,
            systems=q,
            coupled=e,
            has_modes=has_modes,
            n_states=self._setup.n_states,
            operations=operations,
            n_lags=0 if self._setup.damping is None else self._setup.damping.n_lags,
        )

    def _chunk(self, marker: Marker, one: Stretch, first: int, count: int) -> None:
        """Steps `first` to `first + count` of a stretch."""
        advanced(self._sink.reported, self._mesh.n_reported)
        h, is_fresh = one.step_size, one.is_fresh and first == 0
        if is_fresh:
            marker.unknowns = None
        start, momentum_before = marker.position.value.copy(), marker.momentum.value.copy()
        loads = self._setup.stepper.loads.of_steps(
            one.begin + first * h, h, count, is_fresh=is_fresh
        )
        stretch_steps = min(one.n_steps, self._chunk_steps)
        try:
            if not self._setup.in_blocks:
                found = self._single_steps(marker, h, count, loads)
            elif self._solver.dynamics.is_linear:
                found = self._linear_steps(marker, h, count, stretch_steps, loads)
            else:
                found = self._nonlinear_steps(marker, one, first, count, stretch_steps, loads)
        except np.linalg.LinAlgError:
            # matrices are made before the first step that needs them: none of these is done
            self.failure = Failure(
                no_unique_solution(h), "no unique solution", self.done, marker.time
            )
            self._sink.finish(marker.time, marker.position.value, marker.momentum.value)
            return
        position, momentum, velocity = found
        n = position.shape[0]
        steps = first + 1 + np.arange(n)
        times = np.asarray(one.begin + h * steps, dtype=float)
        if n and steps[-1] == one.n_steps:
            times[-1] = one.end
            marker.time = one.end
        elif n:
            marker.time = float(times[-1])
        finite = np.isfinite(position).all(axis=1) & np.isfinite(momentum).all(axis=1)
        if not finite.all():
            n = int(np.argmin(finite)) + 1
            self.failure = Failure.not_finite(self.done + n - 1, float(times[n - 1]))
        if isinstance(self._solver.dynamics, Separable) and not self._solver.dynamics.is_linear:
            ways = np.einsum("sr,nrd->nsd", self._solver.tables.to_unknowns, velocity[:n])
            ways = h * ways + np.concatenate([start[None], position[: max(n - 1, 0)]])[:n, None]
            path = np.concatenate([start[None], ways.reshape(-1, start.size)])
            left = check_domain(
                self._solver.dynamics.potential, path, ways.shape[1], times, self.done
            )
            if left is not None:
                n, self.failure = left
                if n == 0:
                    self._sink.finish(one.begin + first * h, start, momentum_before)
                    return
        bound = self._setup.bound.with_force(self._setup.stepper.loads.largest_force)
        outside = first_outside(bound, position[:n], momentum[:n], times[:n], self.done)
        if outside is not None:
            n, self.failure = outside[0] + 1, outside[1]
        reported = np.zeros(0, dtype=np.intp)
        if one.reported_every:
            reported = np.flatnonzero(steps[:n] % one.reported_every == 0)
        self._sink.add(times[:n], np.full(n, h), position[:n], momentum[:n], velocity[:n], reported)
        self.done += n
        if self.failure and n:
            self._sink.finish(float(times[n - 1]), position[n - 1], momentum[n - 1])
        elif self.failure:
            # the last point of the chunk before, where not every point is kept
            self._sink.finish(marker.time, marker.position.value, marker.momentum.value)

    def _linear_steps(
        self, marker: Marker, h: float, count: int, stretch_steps: int, loads: Array | None
    ) -> tuple[Array, Array, Array]:
        if self._setup.decoupling is None:
            return self._steps_of_structure(marker, h, count, loads)
        q = self._setup.decoupling.batch
        e = self._setup.scene.dimension // q
        stages = self._solver.sampling.driving.shape[0]
        block = block_length(stages, q, e, stretch_steps, self._most)
        if block == 0 or count < block:
            return self._single_steps(marker, h, count, loads)
        systems, decoupling = self._decoupled()
        key = (h, block)
        if key not in self._linear:
            try:
                self._linear[key] = LinearBlocks(
                    systems,
                    decoupling,
                    self._setup.damping,
                    self._setup.stepper.matrices(h).damping,
                    self._solver.sampling,
                    self._solver.tables,
                    h,
                    block,
                    self._of_size[h],
                )
            except np.linalg.LinAlgError:
                # no unique solution: a single step says so
                return self._single_steps(marker, h, count, loads)
        self.operations += memory_operations(
            count, block, q, e, stages, self._setup.n_states, self._per_step, self._of_size[h]
        )
        steps, marker.states = self._linear[key].advance(
            marker.position,
            marker.momentum,
            marker.states,
            count,
            loads,
            with_driving=self._sink.with_steps,
        )
        marker.unknowns = None
        return steps.position, steps.momentum, self._solver.velocity_of(steps.driving)

    def _steps_of_structure(
        self, marker: Marker, h: float, count: int, loads: Array | None
    ) -> tuple[Array, Array, Array]:
        """Steps of a scene with sparse matrices."""
        damping = self._setup.damping
        if damping is None or not damping.has_memory or count < GROUP:
            return self._single_steps(marker, h, count, loads)
        if h not in self._groups:
            # graded meshes have many sizes, each for a few steps
            self._groups = {h: StepGroup(damping, self._setup.stepper.matrices(h).damping)}
        self.operations += count * self._per_step
        return grouped_steps(self._setup.stepper, damping, self._groups[h], marker, h, count, loads)

    def _nonlinear_steps(
        self,
        marker: Marker,
        one: Stretch,
        first: int,
        count: int,
        stretch_steps: int,
        loads: Array | None,
    ) -> tuple[Array, Array, Array]:
        dynamics, h = self._solver.dynamics, one.step_size
        stages = self._solver.sampling.driving.shape[0]
        general = isinstance(dynamics, General)
        block = newton_block(stages * dynamics.dimension, stretch_steps, general=general)
        if block == 0:
            return self._single_steps(marker, h, count, loads)
        key = (h, block)
        if key not in self._newton:
            self._newton[key] = NewtonStretch(
                self._setup.stepper, h, block, self._setup.scene.inertia.mass
            )
        position, momentum, velocity, self.failure = self._newton[key].advance(
            marker, one.begin, first, count, loads, self.course, self.done
        )
        self.operations += position.shape[0] * self._per_step
        return position, momentum, velocity

    def _single_steps(
        self, marker: Marker, h: float, count: int, loads: Array | None
    ) -> tuple[Array, Array, Array]:
        d, r = marker.position.value.size, self._solver.tables.points.size
        positions, momenta = np.empty((count, d)), np.empty((count, d))
        velocities = np.empty((count, r, d))
        begin, stepper = marker.time, self._setup.stepper
        for index in range(count):
            try:
                result = stepper.solve(marker, h, None if loads is None else loads[index])
            except StepFailedError as error:
                self.course.note(error.residuals, self.done + index)
                self.failure = Failure.in_step(self.done + index, marker.time, error)
                return positions[:index], momenta[:index], velocities[:index]
            self.course.note(result.residuals, self.done + index)
            stepper.accept(marker, result, h, begin + (index + 1) * h)
            positions[index], momenta[index] = marker.position.value, marker.momentum.value
            velocities[index] = result.velocity
            self.operations += self._per_step
            if not np.isfinite(positions[index]).all():
                return positions[: index + 1], momenta[: index + 1], velocities[: index + 1]
        return positions, momenta, velocities

    def _decoupled(self) -> tuple[LinearSystems, Decoupling]:
        """The independent systems of a linear scene, found once."""
        if self._systems is None:
            dynamics, damping = self._solver.dynamics, self._setup.damping
            decoupling = self._setup.decoupling
            if not isinstance(dynamics, Separable) or decoupling is None:
                raise ValueError("blocks: the scene is not linear")
            directions = [] if damping is None else [dense(o.matrix) for o in damping.directions]
            stiffness = dynamics.stiffness
            self._systems = (
                LinearSystems(
                    mass=decoupling.matrices(dynamics.mass),
                    stiffness=None if stiffness is None else decoupling.matrices(stiffness),
                    directions=tuple(decoupling.matrices(one) for one in directions),
                ),
                decoupling,
            )
        return self._systems
