"""Equal steps of a nonlinear scene, in blocks as long as these contract."""

from __future__ import annotations

import numpy as np

from fvi_cli.effects.matrices import dense
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.run.loop import Course, Marker, Stepper
from fvi_cli.integrator.steps.block_lengths import BlockLengths
from fvi_cli.integrator.steps.block_memory import BlockMemory
from fvi_cli.integrator.steps.block_response import own_damping
from fvi_cli.integrator.steps.dynamics import General
from fvi_cli.integrator.steps.newton_blocks import FrozenBlocks, frozen_law
from fvi_cli.mathematics.arrays import Array


class NewtonStretch:
    """Equal steps of one size; what is done depends on where a chunk begins only.

    Parameters
    ----------
    stepper
        Single steps of the run.
    step_size, block
        h, and the most steps of a block.
    mass
        Mass matrix where a Lagrangian has no positive one.
    """

    def __init__(self, stepper: Stepper, step_size: float, block: int, mass: Array) -> None:
        self._stepper, self._h, self._block, self._mass = stepper, step_size, block, mass
        self._solver = stepper.solver
        self._at = stepper.matrices(step_size).damping
        damping = self._solver.damping
        self._directions: tuple[Array, ...] = ()
        if damping is not None:
            self._directions = tuple(dense(one.matrix) for one in damping.directions)
        self._memory: BlockMemory | None = None
        if damping is not None and self._at.step is not None:
            self._memory = BlockMemory(damping, self._at, block)

    def advance(
        self,
        marker: Marker,
        begin: float,
        first: int,
        count: int,
        loads: Array | None,
        course: Course,
        before: int,
    ) -> tuple[Array, Array, Array, Failure | None]:
        """Do `count` steps from step `first` of the stretch on.

        Parameters
        ----------
        marker
            Where the run is; it moves on.
        begin
            Time of the beginning of the stretch.
        first, count
            The steps, counted in the stretch.
        loads
            Load vectors of known forces, shape ``(count, s + 1, d)``.
        course
            Notes the iterations.
        before
            Steps of the run that are done before these.

        Returns
        -------
        tuple
            Positions and momenta after the steps, ``(n, d)``, stage velocities ``(n, r, d)``, and
            what stopped the steps, if anything did.
        """
        d, r = marker.position.value.size, self._solver.tables.points.size
        positions, momenta = np.empty((count, d)), np.empty((count, d))
        velocities = np.empty((count, r, d))
        frozen = self._freeze(marker)
        remainder = np.zeros(2 * d if isinstance(self._solver.dynamics, General) else d)
        lengths, done = BlockLengths(self._block), 0
        failure: Failure | None = None
        while done < count and not failure:
            trial = 0 if frozen is None else lengths.trial(count - done)
            found = None
            if frozen is not None and trial:
                found = frozen.attempt(
                    begin + (first + done) * self._h,
                    marker.position.value,
                    marker.momentum.value,
                    self._loads(
                        marker, None if loads is None else loads[done : done + trial], trial
                    ),
                    remainder,
                    trial,
                )
                if found is None:
                    lengths.failed(trial)
                    continue
            if found is None:
                own = None if loads is None else loads[done]
                failure = self._single(marker, begin, first + done, own, course, before + done)
                if not failure:
                    at = done
                    positions[at], momenta[at] = marker.position.value, marker.momentum.value
                    if marker.unknowns is not None:
                        velocities[at] = self._stepper.velocity_of(marker.unknowns)
                    done += 1
                continue
            span = slice(done, done + trial)
            positions[span] = marker.position.value + found.way
            momenta[span] = marker.momentum.value + found.momentum_change
            velocities[span] = self._solver.velocity_of(found.samples)
            marker.position.add(found.way[-1])
            marker.momentum.add(found.momentum_change[-1])
            self._push(marker, found.samples)
            marker.unknowns = None
            course.note(found.changes, before + done)
            done += trial
            marker.time = begin + (first + done) * self._h
            remainder = found.remainder
            lengths.contracted(trial, len(found.changes))
            if lengths.is_stale:
                frozen = self._freeze(marker) or frozen
                lengths.renewed()
        return positions[:done], momenta[:done], velocities[:done], failure

    def _freeze(self, marker: Marker) -> FrozenBlocks | None:
        """Blocks by the linear response here; None where its steps have no unique solution."""
        law = frozen_law(
            self._solver.dynamics,
            marker.position.value,
            marker.momentum.value,
            marker.time,
            self._mass,
        )
        try:
            return FrozenBlocks(
                law,
                self._directions,
                own_damping(self._solver.damping, self._at, self._solver.sampling),
                self._solver.tables,
                self._h,
                self._block,
                None if self._solver.sampling.at_stages else self._solver.to_velocity,
            )
        except np.linalg.LinAlgError:
            return None

    def _loads(self, marker: Marker, loads: Array | None, count: int) -> Array | None:
        """Load vectors of known forces and of the past on the next `count` steps."""
        memory, sampling = self._memory, self._solver.sampling
        if memory is None:
            return loads
        m, d = sampling.weights.size, marker.position.value.size
        total = np.zeros((count * m, d))
        for response, direction in zip(memory.responses, self._directions, strict=True):
            total += (response[: count * m] @ marker.states[:, :d]) @ direction
        force = total.reshape(count, m, d) + self._at.constant_force
        if marker.states.shape[1] > d:
            force = force + memory.carried_force(marker.states[:, -1], count)
        past: Array = np.einsum("nr,krd->knd", -self._h * sampling.to_loads, force)
        return past if loads is None else loads + past

    def _push(self, marker: Marker, driving: Array) -> None:
        damping = self._solver.damping
        if self._memory is None or damping is None:
            return
        count = driving.shape[0]
        every = damping.input_of(driving).reshape(-1, marker.states.shape[1])
        marker.states = self._memory.kernel(count).after(marker.states, every)

    def _single(
        self,
        marker: Marker,
        begin: float,
        step: int,
        loads: Array | None,
        course: Course,
        number: int,
    ) -> Failure | None:
        """One step with its own Jacobian, `number` of the run; what went wrong, if anything."""
        marker.time = begin + step * self._h
        try:
            result = self._stepper.solve(marker, self._h, loads)
        except StepFailedError as error:
            course.note(error.residuals, number)
            return Failure.in_step(number, marker.time, error)
        course.note(result.residuals, number)
        self._stepper.accept(marker, result, self._h, begin + (step + 1) * self._h)
        finite = (
            np.isfinite(marker.position.value).all() and np.isfinite(marker.momentum.value).all()
        )
        return None if finite else Failure.not_finite(number, marker.time)
