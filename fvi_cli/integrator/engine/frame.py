r"""Tables of B equal steps: everything but the second derivatives of the scene.

The unknowns of a step are :math:`U_\nu` with
:math:`x(t_n + \tau h) = x_n + h \sum_\nu l_\nu(\tau) U_\nu`. Displacements in a step depend on
all steps before it in the same block, so that tables are lag sequences
(:mod:`fvi_cli.integrator.memory.interface`).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from fvi_cli.integrator.engine.law import StepLaw
from fvi_cli.integrator.engine.tables import apply, on_every_component, on_steps
from fvi_cli.integrator.memory.damping import Damping
from fvi_cli.integrator.memory.interface import constant_lags, toeplitz_matrix
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import StepTables, step_tables
from fvi_cli.mathematics.arrays import Array, Places

STEPS_OF_BLOCK = 64
"""Most steps of a block of linear scenes: twice as many are no quicker, and double the effect of
round-off near order 2. Nonlinear scenes take up to twice as many: 0.72 of the time for a
pendulum."""
SIZE_OF_LINEAR, SIZE_OF_NEWTON = 1024, 256
"""Most inputs B i e of a block. Newton's iteration applies a matrix of so many rows and columns
again and again: with 512 it has 2 MB and takes twice as long where the cache holds less."""
SIZE_IN_BATCH = 24
"""Most inputs where every member has matrices of its own, which must stay in the cache."""
CACHE = 2**15  # numbers in the matrices of a batch that stay in the cache


@dataclass(frozen=True, kw_only=True, eq=False)
class UnitTables:
    """Tables of B steps of length 1: what depends on the method and on B alone."""

    tables: StepTables
    displacement: Array  # from U to the quadrature points, lag sequences (B, r, s)
    velocity: Array  # the same for velocities
    components: int  # number e
    has_rates: bool  # whether remainders have parts of momenta and depend on velocities

    @cached_property
    def test(self) -> Array:
        """From forces at the points to the equations of their own step, ``(s, r)``."""
        return self.tables.test_weights[:-1]

    @cached_property
    def rate_test(self) -> Array:
        """From momenta at the points to the equations of their own step, ``(s, r)``."""
        return self.tables.weights * self.tables.slopes[:-1]

    @cached_property
    def stiff(self) -> Array:
        """Factor of the stiffness in the equations of a step, ``(s, s)``."""
        return np.asarray(self.test @ self.displacement[0])

    @cached_property
    def mass(self) -> Array:
        """Factor of the mass in the equations of a step, ``(s, s)``."""
        return np.asarray(self.rate_test @ self.velocity[0])

    @cached_property
    def test_sum(self) -> Array:
        """The load vector of a force of 1 at all points, ``(s + 1,)``."""
        return np.asarray(self.tables.test_weights.sum(axis=1))

    @cached_property
    def pairs(self) -> tuple[Array, Array, Array, Array]:
        """From second derivatives at every point to the Jacobian of a step, ``(r, s s)`` each.

        In this order: by v and v, v and q, q and v, q and q.
        """
        rate, test = self.rate_test, self.test
        v, x = self.velocity[0], self.displacement[0]
        r = test.shape[1]
        made = [
            np.einsum("ni,im->inm", a, b).reshape(r, -1)
            for a, b in ((rate, v), (rate, x), (test, v), (test, x))
        ]
        return made[0], made[1], made[2], made[3]

    @cached_property
    def points(self) -> tuple[Array, ...]:
        """From U to displacements, and velocities where there are rates, ``(1, B r w, B s e)``."""
        rows = [self.displacement, self.velocity] if self.has_rates else [self.displacement]
        found = []
        for index, one in enumerate(rows):
            placed = self._among(one, index, axis=2).reshape(len(one), -1, one.shape[2])
            found.append(toeplitz_matrix(on_every_component(placed, self.components))[None])
        return tuple(found)

    @cached_property
    def tests(self) -> tuple[Array, ...]:
        """From remainders (momenta, forces) to load vectors of a step, ``((s + 1) e, r w)``."""
        columns = [self.tables.test_weights]
        if self.has_rates:
            rate_test = self.tables.weights * self.tables.slopes
            # remainders of momenta change no momentum
            rate_test[-1] = -rate_test[:-1].sum(axis=0)
            columns = [rate_test, self.tables.test_weights]
        found = []
        for index, one in enumerate(columns):
            placed = self._among(one, index, axis=2).reshape(len(one), -1)
            found.append(on_every_component(placed, self.components))
        return tuple(found)

    def _among(self, table: Array, index: int, axis: int) -> Array:
        """A table as part `index` of pairs: (displacement, velocity) or (momentum, force)."""
        slots = 2 if self.has_rates else 1
        parts = [table if one == index else np.zeros_like(table) for one in range(slots)]
        return np.stack(parts, axis=axis)


@lru_cache(maxsize=64)
def unit_tables(method: Method, count: int, components: int, has_rates: bool) -> UnitTables:
    """Tables of `count` steps of length 1."""
    t = step_tables(method)
    last = np.zeros((t.points.size, t.degree))
    last[:, -1] = 1.0
    return UnitTables(
        tables=t,
        displacement=constant_lags(t.basis[1:].T, last, count),
        velocity=constant_lags(t.slopes[1:].T, np.zeros_like(last), count),
        components=components,
        has_rates=has_rates,
    )


class Frame:
    """Tables of B steps of length h."""

    def __init__(self, unit: UnitTables, damping: Damping | None, h: float, count: int) -> None:
        self.h, self.count, self.unit, self.tables = h, count, unit, unit.tables
        # from damping forces to load vectors of their step, (s + 1, m), and to its momentum, (m,);
        # the load vector of a force of 1, (s + 1,)
        self.to_loads, self.test_sum = h * unit.tables.to_loads, h * unit.test_sum
        self.weights = np.add.reduce(self.to_loads)
        # from U to displacements, a lag sequence (B, r, s); factor of the stiffness in a step
        self.displacement, self.stiff = h * unit.displacement, h * h * unit.stiff
        # tables of the memory, and for every direction from U to the equations, (q or 1, s, s)
        self.damping = None if damping is None else damping.tables(h, count)
        self.sequences = () if self.damping is None else self.damping.sequences
        test, drive = self.to_loads[:-1], unit.tables.to_inputs
        self.damp = [test @ one[:, 0] @ drive for one in self.sequences]

    def of(self, places: Places) -> Frame:
        """The frame of some members."""
        if self.damping is None or all(len(one) == 1 for one in self.sequences):
            return self
        part = copy.copy(self)
        part.damping = self.damping.of(places)
        part.sequences = part.damping.sequences
        part.damp = [one if len(one) == 1 else one[places] for one in self.damp]
        for name in ("impulses", "lags"):
            part.__dict__.pop(name, None)
        return part

    @cached_property
    def impulses(self) -> list[Array]:
        """For every direction, from inputs to changes of momentum, ``(q or 1, B, B i)``."""
        return [toeplitz_matrix(np.matmul(self.weights, one)[:, :, None]) for one in self.sequences]

    @cached_property
    def mean(self) -> Array:
        """From U to the weighted sum of displacements, ``(1, s)``."""
        return np.asarray((self.h * self.tables.weights)[None] @ self.displacement[0])

    @cached_property
    def lags(self) -> list[Array]:
        """For every direction, from inputs of earlier steps, the latest last, to forces of a step.

        Shape ``(q or 1, m, (B - 1) i)``.
        """
        found = []
        for one in self.sequences:
            later = one[:, :0:-1].transpose(0, 2, 1, 3)
            found.append(later.reshape(*later.shape[:2], -1))
        return found

    @cached_property
    def points(self) -> Array:
        """From U to the points that remainders depend on, ``(1, B r w, B s e)``."""
        one = self.unit.points
        return self.h * one[0] if len(one) == 1 else self.h * one[0] + one[1]

    @cached_property
    def tests(self) -> Array:
        """From remainders to load vectors of their step, ``((s + 1) e, r w)``."""
        one = self.unit.tests
        return self.h * one[0] if len(one) == 1 else one[0] + self.h * one[1]

    @cached_property
    def tests_inside(self) -> Array:
        """From remainders to the equations of their step, ``(s e, r w)``."""
        return np.ascontiguousarray(-self.tests[: -self.unit.components])

    def points_of(self, u: Array) -> Array:
        """The points that remainders depend on, ``(q, n r w)``, from U ``(q, n, s, e)``."""
        q, count = u.shape[:2]
        if count == 1:
            return apply(self.points, u.reshape(q, -1))
        found = on_steps(self.displacement[0], u)
        found[:, 1:] += self.h * np.cumsum(u[:, :-1, -1:], axis=1)
        if self.unit.has_rates:
            found = np.concatenate([found, on_steps(self.unit.velocity[0], u)], axis=-1)
        return found.reshape(q, -1)

    def loads_of(self, rest: Array, count: int) -> Array:
        """Load vectors of remainders ``(q, n r, w)`` of `count` steps, ``(q, n (s + 1) e)``."""
        by_step = rest.reshape(len(rest), count, -1)
        return np.asarray(np.matmul(by_step, self.tests.T).reshape(len(rest), -1))


def longest_block(law: StepLaw, members: int, inputs: int) -> int:
    """Steps of the longest block of `members` with `inputs` in a step."""
    if members > 1:
        # modes of one scene: 2 to 20 take .4 to .85 of the time of blocks for batches
        is_large = members * STEPS_OF_BLOCK**2 > CACHE
        largest = STEPS_OF_BLOCK if is_large else 2 * STEPS_OF_BLOCK
    else:
        largest = SIZE_OF_LINEAR if law.is_linear else SIZE_OF_NEWTON
    return _steps_of(2 * inputs if law.has_rates else inputs, largest, is_linear=law.is_linear)


def longest_in_batch(inputs: int, *, is_linear: bool) -> int:
    """Steps of the longest block of a member of a batch."""
    largest = 2 * SIZE_IN_BATCH if is_linear else SIZE_IN_BATCH
    return _steps_of(inputs, largest, is_linear=is_linear)


def _steps_of(size: int, largest: int, *, is_linear: bool) -> int:
    """Steps of the longest block, a power of 2."""
    most = STEPS_OF_BLOCK if is_linear else 2 * STEPS_OF_BLOCK
    while most > 1 and most * size > largest:
        most //= 2
    return most
