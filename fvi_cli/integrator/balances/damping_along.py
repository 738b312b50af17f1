r"""Damping forces and stored energy along finished runs, from what drove the memory in each step.

That are velocities at the stages of Runge-Kutta methods, the unknowns U for backward differences.
At the stages of a Runge-Kutta step the force is that of the scheme; between them it is the
polynomial through these values, :attr:`fvi_cli.integrator.step_tables.StepTables.stage_basis`. With
the states :math:`s_j` of the damping and weights :math:`e_j` of the kernel

.. math:: E^\text{stored} = \tfrac12 \sum_j e_j\, s_j \cdot D s_j,

and :math:`H + E^\text{stored}` of a scene with quadratic potential, without forcing, with positive
damping falls in every single step of every mesh: the work against the damping is the increase of
what is stored and a sum of squares. (Caputo derivatives of order above 1 take the start velocity
from the velocity; then this holds where it is zero.)
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.damping.damping import Damping, DampingTables, damping_of
from fvi_cli.integrator.memory.exponentials import ExponentialKernels, Exponentials
from fvi_cli.integrator.memory.reach import Reach, find_reach
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.arrays import Array

PIECE = 64
"""Equal steps, or tables of unequal ones, that are worked out together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DampingAlong:
    """The damping of q scenes of one kind along their runs of n steps."""

    damping: Damping
    step_sizes: Array  # (n,)
    inputs: Array  # (q, n, i, e)
    reach: Reach | None = None  # what it reaches of a large structure
    is_prescribed: bool = False  # whether the motion, of one coordinate, is given

    def forces(self) -> Array:
        r"""Forces :math:`\mu D^\gamma q` by direction at the samples, ``(k, q, n, m, d)``."""
        found: list[Array] = []
        damping, (q, n, _, e) = self.damping, self.inputs.shape
        states, column = damping.start()
        if self.is_prescribed and isinstance(damping.memory, Exponentials):
            is_uneven = 2 * len(pieces_of_equal_steps(self.step_sizes)) > n
            if is_uneven and not damping.is_relative:
                return self._forces_on_uneven(damping.memory, states)
        for first, tables in self._pieces():
            count = tables.kernels.count
            driven = self.inputs[:, first : first + count].reshape(q, -1, e)
            forces = [
                damping.past(tables, states, column, count, index)
                + damping.own(tables, driven, count, index)
                for index in range(len(damping.directions))
            ]
            found.append(np.array(forces).reshape(len(forces), q, count, -1, e))
            states = damping.push(tables, states, driven, count)
            column = damping.push_column(tables, column, count)
        zero = np.zeros((len(damping.directions), q, n, 0, e))
        whole = np.concatenate(found, axis=2) if found else zero
        return whole if self.reach is None else self.reach.spread(whole)

    def _forces_on_uneven(self, memory: Exponentials, states: Array) -> Array:
        """The same of a given displacement on steps of many sizes; none subtracts its start."""
        combinations, n = self.damping.combinations, self.step_sizes.size
        found = np.empty((len(combinations), *self.inputs.shape))
        for begin in range(0, n, PIECE**2):
            sizes, places = np.unique(self.step_sizes[begin:][: PIECE**2], return_inverse=True)
            parts = [memory.of_steps(sizes[k : k + PIECE]) for k in range(0, sizes.size, PIECE)]
            local, response, intake, change = map(np.concatenate, zip(*parts, strict=True))
            own = [one.combine(local.swapaxes(0, 1)) for one in combinations]
            for first in range(begin, min(begin + PIECE**2, n), PIECE):
                at = places[first - begin :][:PIECE]
                inputs = self.inputs[:, first : first + PIECE]
                driven = np.matmul(intake[at], inputs)
                path = np.empty_like(driven)
                for index, place in enumerate(at.tolist()):
                    path[:, index] = states
                    states = change[place][:, None] * states + driven[:, index] + states
                for force, one, blocks in zip(found, combinations, own, strict=True):
                    past = np.matmul(response[at], one.weights[:, None, :, None] * path)
                    past += np.matmul(blocks[:, at], inputs)
                    force[:, first : first + PIECE] = past * one.matrices[:, None]
        return found

    def stored(self) -> Array | None:
        """Energy in the memory by direction at the points, ``(k, q, n + 1)``.

        None for backward differences, whose weights are no positive sum of squares.
        """
        states, column = self.damping.start()
        start = self.damping.energy(states[None], column[None])
        if start is None:
            return None
        known = [start]
        for first, tables in self._pieces():
            last = first + tables.kernels.count
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

    def _pieces(self) -> Iterator[tuple[int, DampingTables]]:
        """First step and tables of all pieces of equal steps."""
        made: dict[tuple[float, int], DampingTables] = {}
        for first, last in pieces_of_equal_steps(self.step_sizes):
            key = float(self.step_sizes[first]), last - first
            if key not in made:
                made[key] = self.damping.tables(*key)
            yield first, made[key]


def damping_along(
    scenes: Sequence[Scene],
    method: Method,
    mesh: Mesh,
    steps: Sequence[RunSteps],
) -> DampingAlong | None:
    """The damping along runs on one mesh of scenes whose terms have the same pattern.

    The mesh is that of whole runs, which may have ended before, all at the same step. None: no
    damping.
    """
    reach = find_reach(scenes[0].active_forces) if scenes[0].is_sparse else None
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
        is_prescribed=scenes[0].prescribed is not None,
    )


def pieces_of_equal_steps(step_sizes: Array) -> list[tuple[int, int]]:
    """Ranges of equal step sizes, none longer than :data:`PIECE`."""
    ends = [0, *(np.flatnonzero(np.diff(step_sizes)) + 1).tolist(), step_sizes.size]
    return [
        (first, min(first + PIECE, end))
        for begin, end in itertools.pairwise(ends)
        for first in range(begin, end, PIECE)
    ]
