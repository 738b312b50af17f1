"""Steps of systems side by side: one loop over the steps, none over the systems."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.advance import advanced
from fvi_cli.integrator.batches.blocks import SideBlocks
from fvi_cli.integrator.batches.memory import SideDamping
from fvi_cli.integrator.batches.newton import Notes
from fvi_cli.integrator.batches.plan import in_blocks
from fvi_cli.integrator.batches.steps import SideStep, on_first_axis
from fvi_cli.integrator.batches.systems import Systems
from fvi_cli.integrator.convolution.stages import BlockHistory
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.steps.step import ForceSampling
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis

Loads = Callable[[float, float, int, bool], Array | None]
"""Load vectors ``(n, s + 1, e, q)`` from begin, step size, n and whether the steps begin afresh."""

CHUNK = 256
"""Steps whose known forces are worked out together."""


class SideMarch:
    """The steps of a mesh for all systems.

    Parameters
    ----------
    systems, damping
        What moves; no damping where it has none.
    tables, sampling
        Numbers of the method, and where the damping acts.
    mesh
        Where steps are.
    loads
        Known forces.
    every
        Keep every n-th reported point, the first and the last.
    """

    def __init__(
        self,
        systems: Systems,
        damping: SideDamping,
        tables: StepTables,
        sampling: ForceSampling,
        mesh: Mesh,
        loads: Loads,
        *,
        every: int,
    ) -> None:
        self._systems, self._damping = systems, damping
        self._tables, self._sampling = tables, sampling
        self._mesh, self._loads, self._every = mesh, loads, every
        self._e, self._q = systems.shape
        self._rows, self._s = sampling.driving.shape
        self._ahead = lobatto_basis(tables.degree)
        self.position, self.momentum = systems.position.copy(), systems.momentum.copy()
        self._lost = np.zeros((2, self._e, self._q))
        self._states, self._carried = damping.at_start(systems)
        self._unknowns: tuple[Array, float] | None = None
        self._going_on = ((0.0, 0.0), np.zeros((0, 0)))
        self._at: SideStep | None = None
        self._blocks: tuple[SideStep, SideBlocks] | None = None
        self.notes = Notes(self._q)
        self.failed = np.zeros(self._q, dtype=bool)
        self.largest = np.abs(systems.position)
        self.done = self._reported = 0
        self._times = [0.0]
        self._kept: list[tuple[Array, Array]] = [(self.position[None], self.momentum[None])]

    def run(self) -> tuple[Array, Array, Array]:
        """All steps.

        Returns
        -------
        tuple of Array
            Times of the kept points, ``(n,)``, positions and momenta there, ``(q, n, e)``. Of
            systems that `failed` they mean nothing.
        """
        with np.errstate(all="ignore"):
            for one in self._mesh.stretches:
                first = 0
                while first < one.n_steps:
                    count = min(CHUNK, one.n_steps - first)
                    advanced(self._reported, self._mesh.n_reported)
                    self._chunk(one, first, count)
                    first += count
        position, momentum = (
            np.ascontiguousarray(np.concatenate(parts).transpose(2, 0, 1))
            for parts in zip(*self._kept, strict=True)
        )
        self._kept.clear()
        return np.array(self._times), position, momentum

    def _chunk(self, one: Stretch, first: int, count: int) -> None:
        h, is_fresh = one.step_size, one.is_fresh and first == 0
        if is_fresh:
            self._unknowns = None
        loads = self._loads(one.begin + first * h, h, count, is_fresh)
        at = self._ready(h)
        done = 0
        while done < count:
            steps = min(self._damping.block, count - done)
            own = None if loads is None else loads[done : done + steps]
            whole = self._whole(at, one, steps)
            if whole is None:
                positions, momenta = self._block(at, steps, own)
            else:
                positions, momenta = self._whole_block(at, whole, own)
            self._keep(one, first + done, positions, momenta)
            done += steps

    def _ready(self, step_size: float) -> SideStep:
        """Steps of a size."""
        if self._at is None or self._at.step_size != step_size:
            self._at = SideStep(
                self._systems,
                self._damping.tables(step_size),
                self._tables,
                self._sampling,
                step_size,
                self.position,
            )
            self._give_up(self._at.singular)
        return self._at

    def _whole(self, at: SideStep, one: Stretch, count: int) -> SideBlocks | None:
        """Matrices of whole blocks; None where steps are done one after the other."""
        linear = self._systems.potential is None
        if not linear or not in_blocks(one.n_steps, self._rows * self._e):
            return None
        if count < self._damping.block:
            return None
        if self._blocks is None or self._blocks[0] is not at:
            self._blocks = (at, SideBlocks(at, self._damping, self._sampling))
        return self._blocks[1]

    def _whole_block(
        self, at: SideStep, blocks: SideBlocks, loads: Array | None
    ) -> tuple[Array, Array]:
        """The same as :meth:`_block` by one matrix for every system."""
        count = self._damping.block
        block, past = self._past(at, count)
        driving, ways, gains = blocks.advance(past, self.position, self.momentum, loads)
        positions, momenta = self.position + ways, self.momentum + gains
        self.position = self._add(0, self.position, ways[-1])
        self.momentum = self._add(1, self.momentum, gains[-1])
        self.done += count
        self._end(block, driving, positions, momenta)
        return positions, momenta

    def _past(self, at: SideStep, count: int) -> tuple[BlockHistory | None, Array | None]:
        """Tables of a block, and the force of the past in its steps."""
        damping = self._damping
        if at.damping.step is None:
            return None, None
        block = damping.block_kernel(at.step_size, at.damping.step, count)
        past = damping.past(block, self._states, self._carried)
        if at.damping.constant is not None:
            past += at.damping.constant
        return block, past

    def _end(
        self, block: BlockHistory | None, driving: Array, positions: Array, momenta: Array
    ) -> None:
        """What is left of a block for those that follow."""
        if block is not None:
            self._states = self._damping.pushed(block, self._states, driving)
            self._carried = self._damping.carried_after(block, self._carried)
        np.maximum(self.largest, np.abs(positions).max(axis=0), out=self.largest)
        self._give_up(~np.isfinite(positions[-1] + momenta[-1]).all(axis=0))

    def _solve(self, at: SideStep, force: Array, load: Array | None) -> Array:
        """U and the change of the momentum of a step, ``((s + 1) e, q)``."""
        if self._systems.potential is None:
            return at.linear(force, self.position, self.momentum, load)
        guess = self._guess(at.step_size)
        moved, iteration = at.iterated(
            force, self.position, self.momentum, load, guess, ~self.failed
        )
        self.notes.add(iteration, self.done)
        self._give_up(iteration.failed)
        return moved

    def _block(self, at: SideStep, count: int, loads: Array | None) -> tuple[Array, Array]:
        """Steps of a block: positions and momenta after each of them, ``(count, e, q)``."""
        rows, e, q = self._rows, self._e, self._q
        damping = self._damping
        driving = np.zeros((count * rows, e, q))
        positions, momenta = np.empty((2, count, e, q))
        path = [self.position[None]]
        block, past = self._past(at, count)
        for index in range(count):
            force = np.zeros((self._sampling.weights.size, e, q)) if past is None else past[index]
            if index and past is not None:
                force = force + damping.of_block(at.damping, driving, index)
            load = None if loads is None else loads[index]
            moved = self._solve(at, force, load)
            unknowns = moved[:-e].reshape(self._s, e, q)
            own = on_first_axis(self._sampling.driving, unknowns)
            driving[index * rows : (index + 1) * rows] = own
            path.append(self.position + at.step_size * unknowns)
            self.position = self._add(0, self.position, at.step_size * unknowns[-1])
            self.momentum = self._add(1, self.momentum, moved[-e:])
            self._unknowns = (unknowns, at.step_size)
            positions[index], momenta[index] = self.position, self.momentum
            self.done += 1
        self._end(block, driving, positions, momenta)
        if self._systems.potential is not None:
            # each of these is looked at more closely by itself
            self._give_up(self._systems.potential.may_be_undefined(np.concatenate(path)))
        return positions, momenta

    def _add(self, which: int, value: Array, change: Array) -> Array:
        """A sum that keeps what it loses to round-off."""
        change = change - self._lost[which]
        total = value + change
        self._lost[which] = (total - value) - change
        return np.asarray(total)

    def _give_up(self, systems: NDArray[np.bool_]) -> None:
        """These are done alone; here they rest."""
        new = systems & ~self.failed
        if not new.any():
            return
        self.failed |= new
        for values in (self.position, self.momentum, self._lost, self._states):
            values[..., new] = 0.0
        if self._unknowns is not None:
            self._unknowns[0][..., new] = 0.0

    def _keep(self, one: Stretch, first: int, positions: Array, momenta: Array) -> None:
        if not one.reported_every:
            return
        steps = first + 1 + np.arange(positions.shape[0])
        reported = np.flatnonzero(steps % one.reported_every == 0)
        numbers = self._reported + 1 + np.arange(reported.size)
        self._reported += reported.size
        kept = (numbers % self._every == 0) | (numbers == self._mesh.n_reported)
        places = reported[kept]
        if places.size:
            times = one.begin + one.step_size * steps[places]
            if steps[places[-1]] == one.n_steps:
                times[-1] = one.end
            self._times += times.tolist()
            self._kept.append((positions[places], momenta[places]))

    def _guess(self, step_size: float) -> Array:
        """Ways to the stages by the polynomial of the last step, or by uniform motion."""
        if self._unknowns is not None and step_size <= 1.5 * self._unknowns[1]:
            unknowns, before = self._unknowns
            key = (step_size, before)
            if self._going_on[0] != key:
                ahead = self._ahead.values(1.0 + step_size / before * self._tables.points)
                end = self._ahead.values(np.ones(1))
                self._going_on = (key, before * (ahead - end)[1:].T)
            return on_first_axis(self._going_on[1], unknowns)
        velocity = self._velocity()
        return np.asarray(step_size * self._tables.points[:, None, None] * velocity)

    def _velocity(self) -> Array:
        if self._e == 1:
            return np.asarray(self.momentum / self._systems.mass[0])
        masses = np.moveaxis(self._systems.mass, -1, 0)
        return np.asarray(np.linalg.solve(masses, self.momentum.T[..., None])[..., 0].T)
