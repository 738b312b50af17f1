"""The equations of B steps, solved: what loads, position and momentum make of the unknowns."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from fvi_cli.integrator.damping.damping import Damping
from fvi_cli.integrator.engine.frame import Frame, UnitTables
from fvi_cli.integrator.engine.law import Linearisation
from fvi_cli.integrator.engine.tables import on_components, on_points
from fvi_cli.integrator.memory.lag_sequences import expand
from fvi_cli.mathematics.arrays import Array, Places


class Operator:
    r"""Frame and second derivatives.

    With load vectors g of a block, position x and momentum p at its beginning,

    .. math:: U = \text{start}\,(x, p) + \text{by\_load}\, g + \text{by\_rest}\, \rho,

    where :math:`\rho` are remainders of the law at the points, ``points`` U are these points, and
    ``fold`` is the product of ``points`` and ``by_rest``. Where there is a law with remainders,
    displacements are from the beginning of the block, so that x itself has no part. The equations
    of a member without a unique solution give nan.

    Parameters
    ----------
    frame, at, damping
        Tables, second derivatives and damping of the members.
    is_linear
        Whether there are no remainders.

    Attributes
    ----------
    by_load, start
        Shapes ``(q, B s e, B (s + 1) e)`` and ``(q, B s e, 2 e)``.
    by_rest, fold, points
        Shapes ``(q, B s e, B r w)``, ``(q, B r w, B r w)`` and ``(1, B r w, B s e)``.
    singular
        Members whose equations have no unique solution, ``(q,)``.
    """

    by_rest: Array
    fold: Array
    by_load: Array
    start: Array

    def __init__(
        self, frame: Frame, at: Linearisation, damping: Damping | None, *, is_linear: bool
    ) -> None:
        self.frame, self.at, self.is_linear = frame, at, is_linear
        directions = () if damping is None else damping.combinations
        self._matrices = [np.asarray(one.matrix) for one in directions]
        matrix = step_matrix(frame.unit, at, frame.h, frame.damp, self._matrices)
        inverse = _inverse(matrix)
        self.singular = np.isnan(inverse[:, 0, 0])
        if self.singular.any():
            self.singular &= np.isfinite(matrix).all(axis=(1, 2))
        loads = self._by_impulses(inverse) if frame.count > 1 else self._of_one_step(inverse)
        self.by_load = expand(loads)
        if not is_linear:
            self.points = frame.points
            self.by_rest = expand(np.matmul(loads, frame.tests))
            self.fold = np.matmul(self.points, self.by_rest)

    def _of_one_step(self, inverse: Array) -> Array:
        """Responses to unit loads ``(q, 1, s e, (s + 1) e)``; sets `start`."""
        q, n, _ = inverse.shape
        k = self.at.stiffness
        e = k.shape[-1]
        loads = np.zeros((q, 1, n, n + e))
        loads[:, 0, :, :n] = -inverse
        self.start = np.zeros((q, n, 2 * e))
        self.start[:, :, e:] = -inverse[:, :, :e]
        if self.is_linear:
            pulled = on_components(self.frame.test_sum[None, :-1, None], k)
            self.start[:, :, :e] = np.matmul(inverse, pulled)
        return loads

    def _by_impulses(self, inverse: Array) -> Array:
        """Responses ``(q, B, s e, (s + 1) e)`` to unit loads in the first step; sets `start`.

        Step by step, with the unit position and momentum at its beginning beside them. The inverse
        of the whole block loses digits like (B omega h)^3 where modes are stiff; here position and
        momentum go along, and K acts on where the position is.
        """
        f, k = self.frame, self.at.stiffness
        h, count, s = f.h, f.count, f.tables.degree
        q, e = len(inverse), k.shape[-1]
        width = (s + 3) * e
        unit = np.eye(width)
        given = unit[: (s + 1) * e].reshape(-1, e, width)
        x = np.broadcast_to(unit[(s + 1) * e : -e] * self.is_linear, (q, e, width)).copy()
        p = np.broadcast_to(unit[-e:], (q, e, width)).copy()
        weights, m = f.weights, f.weights.size
        to_mean = (h * f.tables.weights)[None] @ f.displacement[0]
        to_inputs = f.sampling.to_inputs
        i = len(to_inputs)
        every = np.empty((q, count, s * e, width))
        inputs = np.empty((q, count * i, e * width))
        local = [one[:, 0] for one in f.sequences]
        for n in range(count):
            pulled = np.matmul(k, x)
            right = f.test_sum[:-1, None, None] * pulled[:, None]
            force = np.zeros((q, m, e, width))
            if n:
                for lags, matrix in zip(f.lags, self._matrices, strict=True):
                    own = np.matmul(lags[:, :, (count - 1 - n) * i :], inputs[:, : n * i])
                    force += np.matmul(matrix[:, None], own.reshape(q, m, e, width))
                carried = np.matmul(f.to_loads[:-1], force.reshape(q, m, e * width))
                right = right + carried.reshape(right.shape)
            else:
                right = right - given[:-1]
            right[:, 0] -= p
            every[:, n] = np.matmul(inverse, right.reshape(q, s * e, width))
            u = every[:, n].reshape(q, s, e * width)
            own = inputs[:, n * i : (n + 1) * i] = np.matmul(to_inputs, u)
            for first, matrix in zip(local, self._matrices, strict=True):
                part = np.matmul(first, own).reshape(q, m, e, width)
                force += np.matmul(matrix[:, None], part)
            bent = np.matmul(k, np.matmul(to_mean, u).reshape(q, e, width))
            lost = np.matmul(weights, force.reshape(q, m, e * width)).reshape(p.shape)
            p = p - (lost + (h * pulled + bent))
            if n == 0:
                p = p + given.sum(axis=0)
            x = x + h * u[:, -1].reshape(x.shape)
        loads = (s + 1) * e
        self.start = np.ascontiguousarray(every[..., loads:]).reshape(q, -1, 2 * e)
        return np.ascontiguousarray(every[..., :loads])

    @cached_property
    def outputs(self) -> Array:
        """Position, momentum and known loads to inputs, dx and dp, of a linear scene.

        One matrix for every member, ``(q, B (i + 2) e, (2 + B (s + 1)) e)``; loads have the sign of
        the left side.
        """
        f, k = self.frame, self.at.stiffness
        q, c = len(self.by_load), self.by_load.shape[2]
        e, count, h = k.shape[-1], f.count, f.h
        width = 2 * e + c
        u = np.concatenate([self.start, -self.by_load], axis=2).reshape(q, count, -1, e * width)
        inputs = np.matmul(f.sampling.to_inputs, u).reshape(q, -1, e * width)
        dx = h * np.cumsum(u[:, :, -1], axis=1)
        place = np.matmul((h * f.tables.weights)[None] @ f.displacement[0], u)[:, :, 0]
        place[:, 1:] += h * dx[:, :-1]
        place = place.reshape(q, count, e, width)
        place[..., np.arange(e), np.arange(e)] += h
        change = -np.matmul(k[:, None], place)
        for kicks, matrix in zip(f.kicks, self._matrices, strict=True):
            kick = np.matmul(kicks, inputs).reshape(q, count, e, width)
            change -= np.matmul(matrix[:, None], kick)
        loads = np.arange(c).reshape(count, -1, e)
        for step in range(count):
            for component in range(e):
                change[:, step, component, 2 * e + loads[step, :, component]] -= 1.0
        dp = np.cumsum(change, axis=1)
        parts = [one.reshape(q, -1, width) for one in (inputs.reshape(q, -1, e, width), dx, dp)]
        return np.concatenate(parts, axis=1)

    def of(self, places: Places) -> Operator:
        """That of some members, with arrays of its own."""
        part = copy.copy(self)
        part.at, part.frame = self.at.of(places), self.frame.of(places)
        for name in ("by_load", "start", "by_rest", "fold", "singular"):
            setattr(part, name, getattr(self, name)[places])
        return part

    def put(self, places: Places, other: Operator) -> None:
        """Take the tables of `other` for some members."""
        for name in ("by_load", "start", "by_rest", "fold", "singular"):
            getattr(self, name)[places] = getattr(other, name)
        self.at.put(places, other.at)


def step_matrix(
    unit: UnitTables,
    at: Linearisation,
    h: float | Array,
    damp: Sequence[Array],
    matrices: Sequence[Array],
) -> Array:
    """The matrix of the equations of one step, ``(q, s e, s e)``.

    Parameters
    ----------
    unit, at
        Tables of a step of length 1, and second derivatives of the members.
    h
        Length of the step; where members have steps of their own ``(q, 1, 1)``.
    damp, matrices
        For every direction U to the equations of the step, ``(q or 1, s, s)``, and D.
    """
    m, c, k = at
    if k.ndim == 4:
        by_mass, by_mixed, by_transposed, by_stiffness = unit.pairs
        matrix = on_points(by_mass, m) if m.ndim == 4 else on_components(unit.mass[None], m)
        matrix = matrix - h * h * on_points(by_stiffness, k)
        if c is not None:
            matrix += h * (on_points(by_mixed, c) + on_points(by_transposed, c.swapaxes(2, 3)))
    else:
        matrix = on_components(unit.mass[None], m) - h * h * on_components(unit.stiff[None], k)
    for table, direction in zip(damp, matrices, strict=True):
        matrix = matrix - on_components(table, direction)
    return np.asarray(matrix)


def _inverse(matrices: Array) -> Array:
    """Inverses; nan for members whose matrix has none."""
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        found = np.full(matrices.shape, np.nan)
        for own, matrix in zip(found, matrices, strict=True):
            try:
                own[:] = np.linalg.inv(matrix)
            except np.linalg.LinAlgError:
                continue
        return found
