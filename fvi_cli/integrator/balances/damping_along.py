r"""Damping forces and stored energy along finished runs, from the memory's inputs in each step.

Inputs are the velocities at stages for Runge-Kutta methods, the unknowns U for backward
differences. At the stages of a Runge-Kutta step the force is that of the scheme; between them it is
the polynomial through these values, :attr:`fvi_cli.integrator.tables.StepTables.stage_basis`.
With the states :math:`s_j` of the damping and weights :math:`e_j` of the kernel

.. math:: E^\text{stored} = \tfrac12 \sum_j e_j\, s_j \cdot D s_j,

and :math:`H + E^\text{stored}` of a scene with quadratic potential, without forcing, with positive
damping falls in every single step of every mesh: the work against the damping is the increase of
the stored energy plus a sum of squares. (Caputo derivatives of order above 1 take the start
velocity from the velocity; then this holds where it is zero.)
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.memory.damping import Damping, DampingTables, damping_of
from fvi_cli.integrator.memory.exponentials import ExponentialKernels, Exponentials
from fvi_cli.integrator.memory.interface import along
from fvi_cli.integrator.memory.reach import DamperForms, find_damper_forms
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array

PIECE = 64
"""Number of equal steps, or of tables of unequal steps, that are computed together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DampingAlong:
    """The damping of q scenes of one kind along their runs of n steps."""

    damping: Damping
    step_sizes: Array  # (n,)
    inputs: Array  # (q, n, i, e)
    reach: DamperForms | None = None  # components of a large structure that it acts on
    longest: int = PIECE  # most equal steps that are computed together

    def forces(self) -> Array:
        r"""Forces :math:`\mu D^\gamma q` by direction at the samples, ``(k, q, n, m, d)``."""
        memory = self.damping.memory
        pieces = pieces_of_equal_steps(self.step_sizes, self.longest)
        if isinstance(memory, Exponentials) and 2 * len(pieces) > self.step_sizes.size:
            found = list(self._forces_on_uneven(memory))
        else:
            found = list(self._forces_on_blocks(pieces))
        k, (q, n, _, e) = len(self.damping.combinations), self.inputs.shape
        whole = np.concatenate(found, axis=2) if found else np.zeros((k, q, n, 0, e))
        return whole if self.reach is None else self.reach.spread(whole)

    def _forces_on_blocks(self, pieces: Sequence[tuple[int, int]]) -> Iterator[Array]:
        """The forces on successive steps; equal steps block by block."""
        damping, (q, _, i, e) = self.damping, self.inputs.shape
        states, column = damping.start()
        k = len(damping.combinations)
        for first, blocks, tables in self._alike(pieces):
            count, m = tables.kernels.count, tables.kernels.n_samples
            driven = self.inputs[:, first : first + blocks * count]
            driven = driven.reshape(q, blocks, count * i, e)
            driven = np.ascontiguousarray(driven.swapaxes(0, 1))
            path, columns = np.empty((blocks, *states.shape)), np.empty((blocks, *column.shape))
            for index, own in enumerate(driven):
                path[index], columns[index] = states, column
                states = tables.kernels.push(states, own, count)
                column = damping.push_column(tables, column, count)
            forces = [
                damping.past(tables, path, columns, count, index)
                + damping.own(tables, driven, count, index)
                for index in range(k)
            ]
            yield np.array(forces).swapaxes(1, 2).reshape(k, q, blocks * count, m, e)

    def _forces_on_uneven(self, memory: Exponentials) -> Iterator[Array]:
        """The forces on steps of many sizes, whose tables are computed together."""
        damping, (q, n, m, e) = self.damping, self.inputs.shape
        states, column = damping.start()
        start = damping.start_velocity[:, None]
        for begin in range(0, n, PIECE**2):
            sizes, places = np.unique(self.step_sizes[begin:][: PIECE**2], return_inverse=True)
            parts = [memory.of_steps(sizes[k : k + PIECE]) for k in range(0, sizes.size, PIECE)]
            local, response, intake, change = map(np.concatenate, zip(*parts, strict=True))
            own = [one.combine(local.swapaxes(0, 1)) for one in damping.combinations]
            steady = intake @ memory.column[:, None]
            for first in range(0, places.size, PIECE):
                at = places[first : first + PIECE]
                inputs = self.inputs[:, begin + first :][:, : at.size]
                driven = np.matmul(intake[at], inputs)
                path, columns = np.empty_like(driven), np.empty((at.size, *column.shape[1:]))
                for index, place in enumerate(at.tolist()):
                    path[:, index], columns[index] = states, column[0]
                    states = change[place][:, None] * states + driven[:, index] + states
                    if damping.has_column:
                        column = change[place][:, None] * column + column + steady[place]
                forces = []
                for blocks, one in zip(own, damping.combinations, strict=True):
                    acted, moved = path, inputs
                    if one.is_relative:
                        acted, moved = path + columns * start, inputs - start
                    force = np.matmul(response[at], one.weights[:, None, :, None] * acted)
                    force += np.matmul(blocks[:, at], moved)
                    forces.append(along(force.reshape(q, at.size * m, e), one.matrix))
                yield np.array(forces).reshape(len(own), q, at.size, m, e)

    def stored(self) -> Array | None:
        """Energy in the memory by direction at the points, ``(k, q, n + 1)``.

        None for backward differences, whose weights are no positive sum of squares.
        """
        states, column = self.damping.start()
        start = self.damping.energy(states[None], column[None])
        if start is None:
            return None
        known = [start]
        for first, last in pieces_of_equal_steps(self.step_sizes):
            single = self.damping.tables(float(self.step_sizes[first]), 1)
            kernels = single.kernels
            assert isinstance(kernels, ExponentialKernels)
            path, columns = [], []
            intake = np.matmul(kernels.intake, self.inputs[:, first:last])
            for taken in intake.swapaxes(0, 1):
                states = kernels.change[:, None] * states + taken + states
                column = self.damping.push_column(single, column, 1)
                path.append(states)
                columns.append(column)
            energy = self.damping.energy(np.array(path), np.array(columns))
            known += [] if energy is None else [energy]
        return np.concatenate(known, axis=1).swapaxes(1, 2)

    def _alike(self, pieces: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int, DampingTables]]:
        """First step, number and tables of successive blocks of equal steps."""
        made: dict[tuple[float, int], DampingTables] = {}
        for key, own in itertools.groupby(
            pieces, lambda piece: (float(self.step_sizes[piece[0]]), piece[1] - piece[0])
        ):
            if key not in made:
                made[key] = self.damping.tables(*key)
            firsts = [first for first, _ in own]
            for begin in range(0, len(firsts), PIECE):
                yield firsts[begin], len(firsts[begin : begin + PIECE]), made[key]


def damping_along(
    scenes: Sequence[Scene],
    method: Method,
    mesh: Mesh,
    steps: Sequence[RunSteps],
) -> DampingAlong | None:
    """The damping along runs on one mesh of scenes whose terms have the same pattern.

    `mesh` is that of whole runs, also if all ended early, at the same step. None without damping.
    """
    reach = find_damper_forms(scenes[0].active_forces) if scenes[0].is_sparse else None
    damping = damping_of(
        scenes,
        method,
        shortest_step=mesh.shortest_step,
        steps=mesh.equivalent_steps,
        n_steps=None if method.is_runge_kutta else mesh.n_steps,
        reach=reach,
    )
    if damping is None:
        return None
    inputs = np.stack([one.velocity for one in steps])
    if not method.is_runge_kutta:
        inputs = np.stack([step_tables(method).to_inputs @ one.unknowns for one in steps])
    return DampingAlong(
        damping=damping,
        step_sizes=steps[0].step_size,
        inputs=inputs if reach is None else reach.along(inputs),
        reach=reach,
    )


def pieces_of_equal_steps(step_sizes: Array, longest: int = PIECE) -> list[tuple[int, int]]:
    """Ranges of equal step sizes, none longer than the longest."""
    ends = [0, *(np.flatnonzero(np.diff(step_sizes)) + 1).tolist(), step_sizes.size]
    return [
        (first, min(first + longest, end))
        for begin, end in itertools.pairwise(ends)
        for first in range(begin, end, longest)
    ]
