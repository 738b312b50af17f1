"""Damping forces and stored energy along a finished run, by damper.

The force of the past is found anew from what drove the memory in every step: velocities at the
stages of Runge-Kutta methods, the unknowns U for backward differences. At the stages of a
Runge-Kutta step the force is that of the scheme; between them it is the polynomial through these
values, :attr:`fvi_cli.integrator.step_tables.StepTables.stage_basis`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from fvi_cli.integrator.damping.damping import Damping, DampingTables
from fvi_cli.mathematics.arrays import Array

PIECE = 64
"""Equal steps that are worked out together."""


def forces_of_dampers(damping: Damping, step_sizes: Array, inputs: Array) -> Array:
    """Force of every direction at the samples of every step, ``(n_directions, q, n, m, e)``.

    Parameters
    ----------
    damping
        Of the members; made with ``is_separate`` it has a direction for every damper.
    step_sizes
        Shape ``(n,)``.
    inputs
        Of the memory in every step, ``(q, n, i, e)``, the same for all dampers.
    """
    found: list[Array] = []
    states, column = damping.start()
    q, n, _, e = inputs.shape
    for first, tables in _pieces(damping, step_sizes):
        count = tables.kernels.count
        driven = inputs[:, first : first + count].reshape(q, -1, e)
        forces = [
            damping.past(tables, states, column, count, index)
            + damping.own(tables, driven, count, index)
            for index in range(len(damping.directions))
        ]
        found.append(np.array(forces).reshape(len(forces), q, count, -1, e))
        states = damping.push(tables, states, driven, count)
        column = damping.push_column(tables, column, count)
    if not found:
        return np.zeros((len(damping.directions), q, n, 0, e))
    return np.concatenate(found, axis=2)


def stored_energy(damping: Damping, step_sizes: Array, inputs: Array) -> Array | None:
    """Energy that every direction stores at the points of a run, ``(n_directions, q, n + 1)``.

    None for backward differences.

    Parameters
    ----------
    damping, step_sizes, inputs
        As for :func:`forces_of_dampers`.
    """
    states, column = damping.start()
    start = damping.energy(states[None], column[None])
    if start is None:
        return None
    known = [start]
    for first, tables in _pieces(damping, step_sizes):
        single = damping.tables(float(step_sizes[first]), 1)
        path, columns = [], []
        for step in range(first, first + tables.kernels.count):
            states = damping.push(single, states, inputs[:, step], 1)
            column = damping.push_column(single, column, 1)
            path.append(states)
            columns.append(column)
        energy = damping.energy(np.array(path), np.array(columns))
        if energy is not None:
            known.append(energy)
    return np.concatenate(known, axis=1).swapaxes(1, 2)


def pieces_of_equal_steps(step_sizes: Array) -> list[tuple[int, int]]:
    """Ranges of equal step sizes, none longer than :data:`PIECE`."""
    if step_sizes.size == 0:
        return []
    ends = [0, *(np.flatnonzero(np.diff(step_sizes)) + 1).tolist(), step_sizes.size]
    return [
        (first, min(first + PIECE, end))
        for begin, end in itertools.pairwise(ends)
        for first in range(begin, end, PIECE)
    ]


def _pieces(damping: Damping, step_sizes: Array) -> Iterator[tuple[int, DampingTables]]:
    """First step and tables of all pieces of equal steps."""
    made: dict[tuple[float, int], DampingTables] = {}
    for first, last in pieces_of_equal_steps(step_sizes):
        key = float(step_sizes[first]), last - first
        if key not in made:
            made[key] = damping.tables(*key)
        yield first, made[key]


__all__ = ["forces_of_dampers", "pieces_of_equal_steps", "stored_energy"]
