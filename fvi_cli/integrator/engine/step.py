r"""The equations of one step, solved for any number of cases at once.

With the unknowns :math:`U_\nu` of a step, :math:`x(t_n + \tau h) = x_n + h \sum_\nu l_\nu(\tau)
U_\nu`, P and Q of the law (``law.py``) at the quadrature points :math:`c_i`, the damping force F at
its samples :math:`\chi_i`, and load vectors g, the equations are, for :math:`\nu = 0, \dots, s`,

.. math:: \sum_i b_i (l_\nu'(c_i) P_i + h l_\nu(c_i) Q_i) - h \sum_i \beta_i l_\nu(\chi_i) F_i
          + g_\nu = p_{n+1} \delta_{\nu s} - p_n \delta_{\nu 0} .

The rows :math:`\nu < s` determine U; the sum of all rows is the change of the momentum. The law is
linearised, :math:`P = M v + C \Delta`, :math:`Q = C^T v - K \Delta`: its remainders, and the
effects of the position :math:`x_n` and of earlier steps, are load vectors.

A *direction* of the damping is a matrix and all terms with multiples of it. Letters in shapes: q
members (1 where all share a table), n cases, s unknowns of a step (the degree) for each of e
components, r quadrature points, w = e or 2 e numbers of a remainder at a point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np

from fvi_cli.integrator.engine.law import Linearisation
from fvi_cli.integrator.engine.products import on_components, on_every_component, on_points
from fvi_cli.integrator.memory.damping import Damping
from fvi_cli.integrator.memory.interface import Kernels
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import StepTables, step_tables
from fvi_cli.mathematics.arrays import Array, Mask


@dataclass(frozen=True, kw_only=True, eq=False)
class UnitTables:
    """Tables of a step of length 1: what depends on the method alone."""

    tables: StepTables
    components: int  # number e
    has_rates: bool  # whether remainders have parts of momenta and depend on velocities

    @cached_property
    def pairs(self) -> tuple[Array, Array, Array, Array]:
        """From second derivatives at every point to the matrix of a step, ``(r, s s)`` each.

        In this order: by v and v, v and q, q and v, q and q.
        """
        t = self.tables
        rate, test = (t.weights * t.slopes)[:-1], t.test_weights[:-1]
        v, x = t.slopes[1:].T, t.basis[1:].T
        tables = [
            np.einsum("ni,im->inm", a, b).reshape(t.points.size, -1)
            for a, b in ((rate, v), (rate, x), (test, v), (test, x))
        ]
        return tables[0], tables[1], tables[2], tables[3]

    @cached_property
    def sums(self) -> tuple[Array, Array]:
        """From second derivatives by q and v, and q and q, to the impulse of Q, ``(r, s)`` each."""
        weights = self.tables.weights[:, None]
        return weights * self.tables.slopes[1:].T, weights * self.tables.basis[1:].T

    @cached_property
    def rate_test(self) -> Array:
        """From P at the points to load vectors, ``(s + 1, r)``: their sum, the impulse, is zero."""
        table = self.tables.weights * self.tables.slopes
        table[-1] = -table[:-1].sum(axis=0)
        return table

    @cached_property
    def points(self) -> tuple[Array, Array]:
        """From U to displacements and to velocities at the points, ``(r w, s e)`` each."""
        return self._placed(self.tables.basis[1:].T, 0), self._placed(self.tables.slopes[1:].T, 1)

    @cached_property
    def tests(self) -> tuple[Array, Array]:
        """From remainders of forces and of momenta to load vectors, ``((s + 1) e, r w)`` each."""
        force, rate = self.tables.test_weights.T, self.rate_test.T
        return self._placed(force, 1).T, self._placed(rate, 0).T

    def _placed(self, table: Array, part: int) -> Array:
        """A table ``(r, k)`` as rows of one of two parts of every point, ``(r w, k e)``."""
        if not self.has_rates:
            return on_every_component(table, self.components)
        parts = [table if part == one else np.zeros_like(table) for one in range(2)]
        whole = np.stack(parts, axis=1).reshape(-1, table.shape[1])
        return on_every_component(whole, self.components)


@lru_cache(maxsize=64)
def unit_tables(method: Method, components: int, has_rates: bool) -> UnitTables:
    """Tables of a step of length 1."""
    return UnitTables(tables=step_tables(method), components=components, has_rates=has_rates)


class Frame:
    """Tables of B steps of length h: everything but the second derivatives of the law."""

    def __init__(self, unit: UnitTables, damping: Damping | None, h: float, count: int) -> None:
        self.h, self.count, self.unit, t = h, count, unit, unit.tables
        self.memory: Kernels | None = None if damping is None else damping.tables(h, count)
        # from samples of the damping force to the load vectors of their step, (s + 1, m)
        self.to_loads = -h * t.to_loads
        # for every direction, from U of a step to load vectors of this and later steps,
        # (q or 1, B, s + 1, s)
        sequences = () if self.memory is None else self.memory.sequences
        self.damp = [self.to_loads @ one @ t.to_inputs for one in sequences]

    @cached_property
    def points(self) -> Array:
        """From U to the points that remainders depend on, ``(r w, s e)``."""
        displacement, velocity = self.unit.points
        return self.h * displacement + velocity if self.unit.has_rates else self.h * displacement

    @cached_property
    def tests(self) -> Array:
        """From remainders to load vectors of their step, ``((s + 1) e, r w)``."""
        force, rate = self.unit.tests
        return self.h * force + rate if self.unit.has_rates else self.h * force

    @cached_property
    def tests_inside(self) -> Array:
        """From remainders to the equations of their step, with their sign there, ``(s e, r w)``."""
        return np.ascontiguousarray(-self.tests[: -self.unit.components])


class Step(Protocol):
    """The solved equations of one step."""

    @property
    def singular(self) -> Mask:
        """Members whose equations have no unique solution, ``(q,)``."""

    def solve(self, x: Array | None, p: Array, loads: Array) -> tuple[Array, Array, Array]:
        """U ``(q, n, s, e)`` and the changes of position and momentum, ``(q, n, e)`` each.

        From position and momentum ``(q, n, e)`` and load vectors ``(q, n, s + 1, e)``, n cases at
        once; a position of None has no effect.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseStep:
    """A step of q members with dense matrices."""

    h: float | Array  # length, (q, 1, 1) where members have steps of their own
    inverse: Array  # of the matrix of the equations, (q, s e, s e); nan where it has none
    impulse: Array  # from U to the change of the momentum by forces, (q, e, s e)
    by_position: Array  # from position to load vectors, (q, (s + 1) e, e)
    singular: Mask

    def solve(self, x: Array | None, p: Array, loads: Array) -> tuple[Array, Array, Array]:
        """As :meth:`Step.solve`."""
        if x is not None:
            loads = loads + np.matmul(x, self.by_position.swapaxes(1, 2)).reshape(loads.shape)
        right = -loads[:, :, :-1]
        right[:, :, 0] -= p
        flat = right.reshape(*loads.shape[:2], -1)
        u = np.matmul(flat, self.inverse.swapaxes(1, 2))
        dp = np.matmul(u, self.impulse.swapaxes(1, 2)) + np.add.reduce(loads, axis=2)
        u = u.reshape(right.shape)
        return u, self.h * u[:, :, -1], dp


def dense_step(
    unit: UnitTables,
    at: Linearisation,
    h: float | Array,
    damp: Sequence[Array],
    matrices: Sequence[Array],
) -> DenseStep:
    """Solve the equations of one step.

    h is the length, ``(q, 1, 1)`` if members have their own. For every direction of the damping,
    `damp` has the table from U to load vectors of the step, ``(q or 1, s + 1, s)``, and `matrices`
    has its matrix, ``(q, e, e)``. Second derivatives are those of :class:`Linearisation`.
    """
    m, c, k = at
    s, t = unit.tables.degree, unit.tables
    by_mass, by_mixed, by_transposed, by_stiffness = unit.pairs
    whole_rate, whole = unit.sums
    matrix = on_points(by_mass, m, s) - h * h * on_points(by_stiffness, k, s)
    impulse = -h * h * on_points(whole, k, 1)
    by_position = -h * on_points(t.test_weights.T, k, s + 1)
    if c is not None:
        transposed = c.swapaxes(-1, -2)
        matrix = matrix + h * (on_points(by_mixed, c, s) + on_points(by_transposed, transposed, s))
        impulse = impulse + h * on_points(whole_rate, transposed, 1)
        by_position = by_position + on_points(unit.rate_test.T, c, s + 1)
    for table, direction in zip(damp, matrices, strict=True):
        matrix = matrix + on_components(table[:, :-1], direction)
        impulse = impulse + on_components(table.sum(axis=1, keepdims=True), direction)
    inverse, singular = _inverse(matrix)
    return DenseStep(
        h=h, inverse=inverse, impulse=impulse, by_position=by_position, singular=singular
    )


def _inverse(matrices: Array) -> tuple[Array, Mask]:
    """Inverses, nan where there is none, and which members have a finite but singular matrix."""
    singular = np.zeros(len(matrices), dtype=bool)
    try:
        return np.asarray(np.linalg.inv(matrices)), singular
    except np.linalg.LinAlgError:
        singular = np.isfinite(matrices).all(axis=(1, 2)) & (np.linalg.slogdet(matrices)[0] == 0)
        regular = np.where(singular[:, None, None], np.eye(matrices.shape[1]), matrices)
        return np.where(singular[:, None, None], np.nan, np.linalg.inv(regular)), singular
