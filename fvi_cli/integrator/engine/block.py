r"""A block of B equal steps, a power of 2, as one linear map.

The *rows* of a step are its unknowns U, and the changes of position and momentum from the beginning
of the block to its end. They are linear in its first position x and momentum p, and in load vectors
g of this and earlier steps: that map is a Toeplitz matrix, whose leading part serves fewer steps.

The map of one step is doubled again and again: the second half begins from its own position. To
invert the equations of the whole block would lose digits like (B omega h)^3 where modes are stiff.

In nonlinear scenes remainders are further load vectors, and displacements are measured from the
beginning of the block: the position there has no effect. ``fold`` maps remainders to the *points*,
their arguments. Letters in shapes are those of ``engine.py``, and w of ``step.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fvi_cli.integrator.engine.products import apply, by_columns, on_every_component, on_steps
from fvi_cli.integrator.engine.step import DenseStep, Frame, Step
from fvi_cli.integrator.memory.interface import toeplitz_matrix
from fvi_cli.mathematics.arrays import Array, Mask


class Rows(NamedTuple):
    """Results of n steps."""

    unknowns: Array  # U, (q, n, s, e)
    dx: Array  # changes of position and momentum from the beginning of the block, (q, n, e)
    dp: Array


class Block:
    """The map of the steps of a frame, from a step of length h and the matrices of the damping."""

    def __init__(
        self, frame: Frame, step: Step, matrices: Sequence[Array], *, has_position: bool
    ) -> None:
        self.frame, self.step, self._matrices = frame, step, matrices
        self._has_position = has_position
        self.e, self._s = frame.unit.components, frame.unit.tables.degree

    @property
    def singular(self) -> Mask:
        """Members whose equations have no unique solution."""
        return self.step.singular

    @cached_property
    def _by_units(self) -> Array:
        """Rows by unit vectors, ``(q, B, (s + 2) e, n)``.

        These are of position (if it has an effect), momentum and load vectors of the first step.
        """
        step, e, s, count = self.step, self.e, self._s, self.frame.count
        q, width = len(step.singular), (s + 3) * e
        unit = np.broadcast_to(np.eye(width), (q, width, width))
        loads = unit[..., 2 * e :].reshape(q, width, s + 1, e)
        u, dx, dp = step.solve(unit[..., :e], unit[..., e : 2 * e], loads)
        columns = np.concatenate([u.reshape(q, width, -1), dx, dp], axis=2)
        rows = columns.swapaxes(1, 2)[:, None]
        while rows.shape[1] < count:
            # the second half begins where the first one ends
            change = rows[:, -1, s * e :]
            by_state = rows[..., : 2 * e].reshape(q, -1, 2 * e)
            later = np.matmul(by_state, change + unit[:, : 2 * e])
            if self._matrices:
                later += np.matmul(toeplitz_matrix(rows[..., 2 * e :]), self._loads_after(rows))
            later = later.reshape(rows.shape)
            later[:, :, s * e :] += change[:, None]
            rows = np.concatenate([rows, later], axis=1)
        return rows if self._has_position else rows[..., e:]

    def _loads_after(self, rows: Array) -> Array:
        """Load vectors in n steps by n steps before, with these rows, ``(q, n (s + 1) e, ...)``."""
        (q, n, _, width), s, e = rows.shape, self._s, self.e
        u = rows[:, :, : s * e].reshape(q, n * s, e * width)
        total = np.zeros((q, n * (s + 1), e, width))
        for table, matrix in zip(self.frame.damp, self._matrices, strict=True):
            to_later = toeplitz_matrix(table[:, : 2 * n])[:, -n * (s + 1) :, : n * s]
            total += np.matmul(matrix[:, None], np.matmul(to_later, u).reshape(total.shape))
        return total.reshape(q, -1, width)

    @cached_property
    def start(self) -> Array:
        """From position, where it has an effect, and momentum to rows, ``(q, B (s + 2) e, ..)``."""
        by_state = self._by_units[..., : -(self._s + 1) * self.e]
        return np.ascontiguousarray(by_state).reshape(len(by_state), -1, by_state.shape[-1])

    @cached_property
    def by_load(self) -> Array:
        """From load vectors to rows, ``(q, B (s + 2) e, B (s + 1) e)``."""
        return toeplitz_matrix(self._by_units[..., -(self._s + 1) * self.e :])

    @cached_property
    def _whole(self) -> Array:
        """From position, momentum and load vectors to rows."""
        return by_columns(np.concatenate([self.start, self.by_load], axis=2))

    @cached_property
    def _whole_by_force(self) -> Array:
        """From position, momentum and the damping force of the past to rows."""
        by_force = on_every_component(self.frame.to_loads, self.e)
        by_unit = np.matmul(self._by_units[..., -(self._s + 1) * self.e :], by_force)
        return by_columns(np.concatenate([self.start, toeplitz_matrix(by_unit)], axis=2))

    def solve(
        self, x: Array | None, p: Array, force: Array | None, loads: Array | None, count: int
    ) -> Rows:
        """Rows of the first `count` steps.

        From position and momentum ``(q, e)``, the damping force of the past ``(q, count m, e)`` and
        load vectors ``(q, count, s + 1, e)``; None: zero.
        """
        q, vectors, whole = len(p), [p] if x is None else [x, p], None
        # a force alone needs the smaller matrix by forces; with loads it becomes load vectors
        if force is not None and (loads is not None or self.frame.count == 1):
            of_force = on_steps(self.frame.to_loads, force.reshape(q, count, -1, self.e))
            loads = of_force if loads is None else loads + of_force
            force = None
        if self.frame.count == 1:
            if loads is None:
                loads = np.zeros((q, 1, self._s + 1, self.e))
            return Rows(*self.step.solve(None if x is None else x[:, None], p[:, None], loads))
        whole = self._whole if force is None else self._whole_by_force
        vectors += [one.reshape(q, -1) for one in (force, loads) if one is not None]
        vector = np.concatenate(vectors, axis=1)
        rows = count * (self._s + 2) * self.e
        if rows < whole.shape[1] or vector.shape[1] < whole.shape[2]:
            whole = whole[:, :rows, : vector.shape[1]]
        by_step = apply(whole, vector).reshape(q, count, self._s + 2, self.e)
        return Rows(by_step[:, :, :-2], by_step[:, :, -2], by_step[:, :, -1])

    @cached_property
    def fold(self) -> Array:
        """From remainders to points, ``(q, B r w, B r w)``."""
        e, s, frame = self.e, self._s, self.frame
        if frame.count == 1:
            assert isinstance(self.step, DenseStep)
            return np.asarray(frame.points @ (self.step.inverse @ frame.tests_inside))
        rows = self._by_units[..., -(s + 1) * e :]
        q, count = rows.shape[:2]
        points = np.matmul(frame.points, rows[:, :, : s * e])
        # a view of the points: displacements are those from the beginning of the block
        by_point = points.reshape(q, count, frame.unit.tables.points.size, -1, points.shape[-1])
        by_point[:, 1:, :, :e] += rows[:, :-1, None, s * e : (s + 1) * e]
        return toeplitz_matrix(np.matmul(points, frame.tests))

    def points_of(self, rows: Rows, entries: Callable[[Array], Array] = np.positive) -> Array:
        """Displacements, and velocities where these matter, at the points, ``(q, n r w)``.

        `entries` is a function of the entries of the tables: the identity, or the absolute value.
        """
        u, tables = rows.unknowns, self.frame.unit.tables
        points = self.frame.h * on_steps(entries(tables.basis[1:].T), u)
        if len(u[0]) > 1:
            points[:, 1:] += rows.dx[:, :-1, None]
        if self.frame.unit.has_rates:
            points = np.concatenate([points, on_steps(entries(tables.slopes[1:].T), u)], axis=-1)
        return points.reshape(len(u), -1)

    def loads_of(self, remainders: Array, count: int) -> Array:
        """Load vectors ``(q, n, s + 1, e)`` of the remainders ``(q, n r, w)`` of n steps."""
        by_step = remainders.reshape(len(remainders), count, -1)
        loads = np.matmul(by_step, self.frame.tests.T)
        return np.asarray(loads.reshape(*by_step.shape[:2], -1, self.e))

    def round_off(self, p: Array, loads: Array, remainders: Array) -> Array:
        """Sums of the sizes of all terms of the points, ``(q, n r w)``.

        `remainders` are the sizes of terms of remainders, ``(q, n r, w)``. Components that are not
        coupled have no effect on each other: their entries are exact zeros.
        """
        q, count = loads.shape[:2]
        size, rows = count * (self._s + 1) * self.e, count * (self._s + 2) * self.e
        terms = apply(np.abs(self.start[:, :rows, -self.e :]), np.abs(p))
        terms += apply(np.abs(self.by_load[:, :rows, :size]), np.abs(loads).reshape(q, -1))
        steps = terms.reshape(q, count, self._s + 2, self.e)
        sizes = self.points_of(Rows(steps[:, :, :-2], steps[:, :, -2], steps[:, :, -1]), np.abs)
        flat = remainders.reshape(q, -1)
        return sizes + apply(np.abs(self.fold[:, : flat.shape[1], : flat.shape[1]]), flat)
