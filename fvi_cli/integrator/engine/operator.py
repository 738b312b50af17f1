"""The equations of B steps, solved: what loads, position and momentum make of the unknowns."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from fvi_cli.integrator.engine.directions import Direction
from fvi_cli.integrator.engine.frame import Frame, UnitTables
from fvi_cli.integrator.engine.law import Linearisation
from fvi_cli.integrator.engine.tables import expand, on_components, on_members, on_points
from fvi_cli.mathematics.arrays import Array, Places


class Operator:
    r"""Frame and second derivatives.

    With load vectors g of a block, position x and momentum p at its beginning,

    .. math:: U = \text{start}\,(x, p) + \text{by\_load}\, g + \text{by\_rest}\, \rho,

    where :math:`\rho` are remainders of the law at the points, ``points`` U are these points, and
    ``fold`` is the product of ``points`` and ``by_rest``. Where there is a law with remainders,
    displacements are from the beginning of the block, so that x itself has no part.

    Parameters
    ----------
    frame, at, directions
        Tables, second derivatives and damping of the members.
    is_linear
        Whether there are no remainders.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of a member have no unique solution.
    """

    by_rest: Array
    fold: Array

    def __init__(
        self, frame: Frame, at: Linearisation, directions: Sequence[Direction], *, is_linear: bool
    ) -> None:
        self.frame, self.at, self.is_linear = frame, at, is_linear
        matrix = step_matrix(frame.unit, at, frame.h, frame.damp, directions)
        inverse: Array = np.asarray(np.linalg.inv(matrix))
        if frame.count > 1:
            self._by_impulses(inverse, directions)
        else:
            self._of_one_step(inverse)
        if not is_linear:
            self.points = frame.points
            self.by_rest = expand(np.matmul(self._loads, frame.tests))
            self.fold = np.matmul(self.points, self.by_rest)

    def _of_one_step(self, inverse: Array) -> None:
        q, n, _ = inverse.shape
        k = self.at.stiffness
        e = k.shape[-1]
        self._loads = np.zeros((q, 1, n, n + e))
        self._loads[:, 0, :, :n] = -inverse
        self.by_load = self._loads[:, 0]
        self.start = np.zeros((q, n, 2 * e))
        self.start[:, :, e:] = -inverse[:, :, :e]
        if self.is_linear:
            self.start[:, :, :e] = inverse @ on_components(self.frame.test_sum[:-1, None], k)

    def _by_impulses(self, inverse: Array, directions: Sequence[Direction]) -> None:
        """Step by step for unit loads in the first step and unit position and momentum before it.

        The inverse of the whole block loses digits like (B omega h)^3 where modes are stiff. Here
        position and momentum go along, and K acts on where the position is.
        """
        f, k = self.frame, self.at.stiffness
        h, count, s = f.h, f.count, f.tables.degree
        q, e = len(inverse), k.shape[-1]
        width = (s + 3) * e
        unit = np.eye(width)
        given = unit[: (s + 1) * e].reshape(-1, e, width)
        x = np.broadcast_to(unit[(s + 1) * e : -e] * self.is_linear, (q, e, width)).copy()
        p = np.broadcast_to(unit[-e:], (q, e, width)).copy()
        weights = f.to_loads.sum(axis=0)
        to_mean = (h * f.tables.weights)[None] @ f.displacement[0]
        to_inputs = f.sampling.to_inputs
        i = len(to_inputs)
        every = np.empty((q, count, s * e, width))
        inputs = np.empty((q, count * i, e * width))
        for n in range(count):
            pulled = np.matmul(k, x)
            right = f.test_sum[:-1, None, None] * pulled[:, None]
            force = np.zeros((q, weights.size, e, width))
            if n:
                for lags, one in zip(f.lags, directions, strict=True):
                    own = np.matmul(lags[:, (count - 1 - n) * i :], inputs[:, : n * i])
                    force += np.matmul(one.matrix[:, None], own.reshape(q, -1, e, width))
                carried = np.matmul(f.to_loads[:-1], force.reshape(q, -1, e * width))
                right = right + carried.reshape(right.shape)
            else:
                right = right - given[:-1]
            right[:, 0] -= p
            every[:, n] = np.matmul(inverse, right.reshape(q, s * e, width))
            u = every[:, n].reshape(q, s, e * width)
            own = inputs[:, n * i : (n + 1) * i] = np.matmul(to_inputs, u)
            for local, one in zip(f.local, directions, strict=True):
                part = np.matmul(local[: weights.size, :i], own).reshape(q, -1, e, width)
                force += np.matmul(one.matrix[:, None], part)
            bent = np.matmul(k, np.matmul(to_mean, u).reshape(q, e, width))
            lost = np.matmul(weights, force.reshape(q, -1, e * width)).reshape(p.shape)
            p = p - (lost + (h * pulled + bent))
            if n == 0:
                p = p + given.sum(axis=0)
            x = x + h * u[:, -1].reshape(x.shape)
        loads = (s + 1) * e
        self._loads = np.ascontiguousarray(every[..., :loads])
        self.start = np.ascontiguousarray(every[..., loads:]).reshape(q, -1, 2 * e)
        self.by_load = expand(self._loads)

    def of(self, places: Places) -> Operator:
        """That of some members, with arrays of its own."""
        part = copy.copy(self)
        part.at = self.at.of(places)
        for name in ("by_load", "start", "by_rest", "fold"):
            setattr(part, name, getattr(self, name)[places])
        return part

    def put(self, places: Places, other: Operator) -> None:
        """Take the tables of `other` for some members."""
        for name in ("by_load", "start", "by_rest", "fold"):
            getattr(self, name)[places] = getattr(other, name)
        self.at.put(places, other.at)


def step_matrix(
    unit: UnitTables,
    at: Linearisation,
    h: float | Array,
    damp: Sequence[Array],
    directions: Sequence[Direction],
) -> Array:
    """The matrix of the equations of one step, ``(q, s e, s e)``.

    Parameters
    ----------
    unit, at, directions
        Tables of a step of length 1, second derivatives and damping of the members.
    h, damp
        Length of the step, and U to its equations by every direction, ``(s, s)``; where members
        have steps of their own ``(q, 1, 1)`` and ``(q, s, s)``.
    """
    m, c, k = at
    if k.ndim == 4:
        by_mass, by_mixed, by_transposed, by_stiffness = unit.pairs
        matrix = on_points(by_mass, m) if m.ndim == 4 else on_components(unit.mass, m)
        matrix = matrix - h * h * on_points(by_stiffness, k)
        if c is not None:
            matrix += h * (on_points(by_mixed, c) + on_points(by_transposed, c.swapaxes(2, 3)))
    else:
        matrix = on_components(unit.mass, m) - h * h * on_components(unit.stiff, k)
    for table, one in zip(damp, directions, strict=True):
        whole = on_components if table.ndim == 2 else on_members
        matrix = matrix - whole(table, one.matrix)
    return matrix
