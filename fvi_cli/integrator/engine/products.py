"""Products on the axes of the engine: members, steps, points and components."""

from __future__ import annotations

import numpy as np

from fvi_cli.mathematics.arrays import Array


def on_components(tables: Array, matrices: Array) -> Array:
    """Kronecker products of ``(q or 1, a, b)`` and ``(q or 1, e, e)``, ``(q, a e, b e)``."""
    _, a, b = tables.shape
    e = matrices.shape[-1]
    if e == 1:
        return np.asarray(tables * matrices)
    whole = tables[:, :, None, :, None] * matrices[:, None, :, None, :]
    return np.asarray(whole.reshape(-1, a * e, b * e))


def on_every_component(table: Array, components: int) -> Array:
    """The table for each component by itself, ``(a, b)`` to ``(a e, b e)``."""
    return np.asarray(np.kron(table, np.eye(components)), dtype=float)


def on_points(table: Array, matrices: Array, rows: int) -> Array:
    """Sum over points i of Kronecker products of ``table[i]`` and ``matrices[:, i]``.

    `table`, ``(r, a b)``, has a matrix of a = `rows` rows for each point; `matrices` are
    ``(q, r, e, e)``, or ``(q, e, e)`` where they are the same at all points: ``(q, a e, b e)``.
    """
    r, columns = len(table), table.shape[1] // rows
    if matrices.ndim == 3:
        return on_components(np.add.reduce(table).reshape(1, rows, columns), matrices)
    q, _, e, _ = matrices.shape
    if e == 1:
        return np.asarray((matrices.reshape(q, 1, r) @ table).reshape(q, rows, columns))
    entries = (matrices.transpose(0, 2, 3, 1) @ table).reshape(q, e, e, rows, columns)
    return np.asarray(entries.transpose(0, 3, 1, 4, 2).reshape(q, rows * e, columns * e))


def on_steps(table: Array, values: Array) -> Array:
    """A small matrix ``(a, b)`` on the third axis of ``(q, B, b, e)``."""
    if values.shape[-1] == 1:
        return np.asarray(np.matmul(values[..., 0], table.T)[..., None])
    return np.asarray(np.matmul(table, values))


def apply(matrices: Array, vectors: Array) -> Array:
    """Matrices ``(q or 1, n, k)`` on vectors ``(q, k)``; one product if all share a matrix."""
    if len(matrices) == 1 < len(vectors):
        return np.asarray(vectors @ matrices[0].T)
    return np.asarray(np.matmul(matrices, vectors[..., None])[..., 0])


def by_columns(matrices: Array) -> Array:
    """The same matrices, stored column by column: quicker to apply where they have many rows."""
    return np.ascontiguousarray(matrices.swapaxes(-2, -1)).swapaxes(-2, -1)
