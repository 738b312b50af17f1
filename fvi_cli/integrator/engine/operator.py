r"""The linearised equations of a block of B equal steps, solved for the unknowns.

Letters in shapes: q members of a batch (1 where all share a table), B steps of a block, s unknowns
of a step for every component (the degree of the method), e components, r quadrature points of a
step, w numbers of a remainder at a point, i inputs of the memory of a step for every component,
m points of a step where the damping force is taken. The unknowns of step n are :math:`U_\nu` with
:math:`x(t_n + \tau h) = x_n + h \sum_\nu l_\nu(\tau) U_\nu`.

*Remainders* are the forces, and momenta, of a nonlinear scene without their linear part. The
*memory force* is the damping force that earlier steps cause.
"""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from fvi_cli.integrator.engine.frame import Frame, UnitTables, unit_tables
from fvi_cli.integrator.engine.law import Linearisation, StepLaw, force_of
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.engine.tables import apply, by_columns, on_components, on_points, on_steps
from fvi_cli.integrator.memory.damping import Damping
from fvi_cli.integrator.memory.interface import toeplitz_matrix
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array, Mask, Places


class Operator:
    r"""The linear map from position, momentum and loads of a block to its unknowns U.

    It is made from the tables of a step size (``frame``) and the second derivatives of the
    Lagrangian at one place (``at``). With load vectors g of the block, position x and momentum p at
    its beginning,

    .. math:: U = \text{start}\,(x, p) + \text{by\_load}\, g.

    In nonlinear scenes g includes the remainders, ``fold`` maps remainders to displacements (and
    velocities) at the quadrature points, and displacements are measured from the beginning of the
    block, so that the columns of ``start`` for x are zero. Members whose equations have no unique
    solution are marked in ``singular``; their tables are nan.
    """

    fold: Array  # (q, B r w, B r w), where there are remainders

    def __init__(
        self, frame: Frame, at: Linearisation, damping: Damping | None, *, is_linear: bool
    ) -> None:
        self.frame, self.at, self.is_linear = frame, at, is_linear
        directions = () if damping is None else damping.combinations
        self._matrices = [np.asarray(one.matrix) for one in directions]
        matrix = step_matrix(frame.unit, at, frame.h, frame.damp, self._matrices)
        # equations of one step, inverted, (q, s e, s e); its response to remainders, (q, s e, r w)
        self.inverse, self.singular = _inverse(matrix)
        if frame.count > 1:
            loads = self._respond_to_unit_loads()
            self.by_load = toeplitz_matrix(loads)
            if not is_linear:
                by_remainder = np.matmul(loads, frame.tests)
                q, count, _, width = by_remainder.shape
                folded = np.matmul(frame.points, by_remainder.reshape(q, -1, width))
                self.fold = toeplitz_matrix(folded.reshape(q, count, -1, width))
        elif not is_linear:
            self.by_remainder = np.matmul(self.inverse, frame.tests_inside)
            self.fold = np.matmul(frame.points, self.by_remainder)

    @cached_property
    def by_load(self) -> Array:
        """From load vectors to U, ``(q, B s e, B (s + 1) e)``."""
        last = np.zeros((*self.inverse.shape[:2], self.at.stiffness.shape[-1]))
        return np.concatenate([-self.inverse, last], axis=2)

    @cached_property
    def start(self) -> Array:
        """From position and momentum to U, ``(q, B s e, 2 e)``."""
        k = self.at.stiffness
        by_position = np.zeros((*self.inverse.shape[:2], k.shape[-1]))
        if self.is_linear:
            stiffness_loads = on_components(self.frame.test_sum[None, :-1, None], k)
            by_position = np.matmul(self.inverse, stiffness_loads)
        return np.concatenate([by_position, -self.inverse[:, :, : k.shape[-1]]], axis=2)

    def solve(self, state: State, known: Array) -> Array:
        """U of the first n steps without remainders, ``(q, n s e)``.

        `known` are loads, ``(q, n, s + 1, e)``, with their sign on the left side of the equations.
        """
        q, count = known.shape[:2]
        if self.frame.count == 1:
            right = known[:, 0, :-1].copy()
            right[:, 0] -= state.p
            if self.is_linear:
                force = force_of(self.at.stiffness, state.x[:, None])
                right += self.frame.test_sum[:-1, None] * force
            return apply(self.inverse, right.reshape(q, -1))
        begin = np.concatenate([state.x, state.p], axis=1)
        n, c = count * len(self.inverse[0]), known[0].size
        return apply(self.start[:, :n], begin) - apply(self.by_load[:, :n, :c], known.reshape(q, c))

    def respond(self, remainders: Array, count: int) -> Array:
        """U of the first n = `count` steps by remainders ``(q, n r, w)`` alone, ``(q, n s e)``."""
        if self.frame.count == 1:
            return apply(self.by_remainder, remainders.reshape(len(remainders), -1))
        loads = self.frame.loads_of(remainders, count)
        n = count * len(self.inverse[0])
        return apply(self.by_load[:, :n, : loads.shape[1]], loads)

    def _respond_to_unit_loads(self) -> Array:
        """U of all steps by unit loads in the first, ``(q, B, s e, (s + 1) e)``; sets ``start``.

        Computed step by step, together with the responses to a unit position and a unit momentum at
        the beginning (``start``). To invert the equations of the whole block would lose digits like
        (B omega h)^3 where modes are stiff; here every step begins from its own position, on which
        the stiffness acts.
        """
        f, count, s = self.frame, self.frame.count, self.frame.tables.degree
        inverse, e = self.inverse, self.at.stiffness.shape[-1]
        q = len(inverse)
        width = (s + 3) * e
        unit = np.eye(width)
        given = unit[: (s + 1) * e].reshape(-1, e, width)
        x = np.broadcast_to(unit[(s + 1) * e : -e] * self.is_linear, (q, e, width)).copy()
        p = np.broadcast_to(unit[-e:], (q, e, width)).copy()
        m, i, size = f.weights.size, len(f.tables.to_inputs), s * e
        every = np.empty((q, count, size, width))
        inputs = np.empty((q, count * i, e * width))
        force = np.zeros((q, m, e, width))
        first = self._one_step(inverse, x, p, force, given)
        held = (2 + m) * e
        units = np.broadcast_to(np.eye(held), (q, held, held))
        pasts = units[:, 2 * e :].reshape(q, m, e, held)
        advance = self._one_step(inverse, units[:, :e], units[:, e : 2 * e], pasts, None)
        for n in range(count):
            found = first
            if n:
                force = np.zeros((q, m, e, width))
                for lags, matrix in zip(f.lags, self._matrices, strict=True):
                    own = np.matmul(lags[:, :, (count - 1 - n) * i :], inputs[:, : n * i])
                    force += np.matmul(matrix[:, None], own.reshape(q, m, e, width))
                carried = np.concatenate([x, p, force.reshape(q, m * e, width)], axis=1)
                found = np.matmul(advance, carried)
            x, p = found[:, :e], found[:, e : 2 * e]
            every[:, n] = found[:, 2 * e : 2 * e + size]
            inputs[:, n * i : (n + 1) * i] = found[:, 2 * e + size :].reshape(q, i, -1)
        self.start = np.ascontiguousarray(every[..., -2 * e :]).reshape(q, -1, 2 * e)
        return np.ascontiguousarray(every[..., : -2 * e])

    def _one_step(
        self, inverse: Array, x: Array, p: Array, force: Array, given: Array | None
    ) -> Array:
        """Position and momentum after a step, its unknowns and its inputs of the memory, stacked.

        From position and momentum ``(q, e, n)`` before it, the memory force ``(q, m, e, n)`` and
        possibly load vectors ``(s + 1, e, n)``, for n cases at once: ``(q, (2 + s + i) e, n)``.
        """
        f, k = self.frame, self.at.stiffness
        h, s = f.h, f.tables.degree
        q, m, e, width = force.shape
        spring_force = np.matmul(k, x)
        tested = np.matmul(f.to_loads[:-1], force.reshape(q, m, e * width))
        right = f.test_sum[:-1, None, None] * spring_force[:, None] + tested.reshape(q, s, e, width)
        right[:, 0] -= p
        if given is not None:
            right -= given[:-1]
        u = np.matmul(inverse, right.reshape(q, s * e, width)).reshape(q, s, e * width)
        inputs = np.matmul(f.tables.to_inputs, u)
        for sequence, matrix in zip(f.sequences, self._matrices, strict=True):
            own = np.matmul(sequence[:, 0], inputs).reshape(q, m, e, width)
            force = force + np.matmul(matrix[:, None], own)
        mean = np.matmul((h * f.tables.weights)[None] @ f.displacement[0], u)
        by_displacement = np.matmul(k, mean.reshape(q, e, width))
        damped = np.matmul(f.weights, force.reshape(q, m, e * width)).reshape(q, e, width)
        p = p - (damped + (h * spring_force + by_displacement))
        if given is not None:
            p = p + given.sum(axis=0)
        x = x + h * u[:, -1].reshape(q, e, width)
        rows = (u.reshape(q, s * e, width), inputs.reshape(q, -1, width))
        return np.concatenate([x, p, *rows], axis=1)

    @cached_property
    def outputs(self) -> Array:
        """From position, momentum and memory force to the results of a linear block.

        The results are the inputs of the memory in every step, and the changes dx and dp of
        position and momentum from the beginning of the block to the end of every step. One matrix
        for every member, ``(q, B (i + 2) e, (2 + B m) e)``.
        """
        f, e = self.frame, self.at.stiffness.shape[-1]
        q, rows, _ = self._outputs_by_load.shape
        if f.damping is None:
            return by_columns(self._outputs_by_load[..., : 2 * e])
        loads = self._outputs_by_load[..., 2 * e :].reshape(q, rows * f.count, -1, e)
        by_force = on_steps(f.to_loads.T, loads).reshape(q, rows, -1)
        return by_columns(np.concatenate([self._outputs_by_load[..., : 2 * e], by_force], axis=2))

    @cached_property
    def outputs_of_loads(self) -> Array:
        """From load vectors to the same results, ``(q, B (i + 2) e, B (s + 1) e)``."""
        return by_columns(-self._outputs_by_load[..., 2 * self.at.stiffness.shape[-1] :])

    @cached_property
    def _outputs_by_load(self) -> Array:
        """From position, momentum and load vectors to the inputs of the memory, dx and dp.

        Loads have their sign on the left side of the equations.
        """
        f, k = self.frame, self.at.stiffness
        q, c = len(self.by_load), self.by_load.shape[2]
        e, count, h = k.shape[-1], f.count, f.h
        width = 2 * e + c
        u = np.concatenate([self.start, -self.by_load], axis=2).reshape(q, count, -1, e * width)
        inputs = np.matmul(f.tables.to_inputs, u).reshape(q, -1, e * width)
        dx = h * np.cumsum(u[:, :, -1], axis=1)
        place = np.matmul((h * f.tables.weights)[None] @ f.displacement[0], u)[:, :, 0]
        place[:, 1:] += h * dx[:, :-1]
        place = place.reshape(q, count, e, width)
        place[..., np.arange(e), np.arange(e)] += h
        change = -np.matmul(k[:, None], place)
        for impulses, matrix in zip(f.impulses, self._matrices, strict=True):
            impulse = np.matmul(impulses, inputs).reshape(q, count, e, width)
            change -= np.matmul(matrix[:, None], impulse)
        loads = np.arange(c).reshape(count, -1, e)
        change[:, np.arange(count)[:, None, None], np.arange(e), 2 * e + loads] -= 1.0
        dp = np.cumsum(change, axis=1)
        parts = [one.reshape(q, -1, width) for one in (inputs.reshape(q, -1, e, width), dx, dp)]
        return np.concatenate(parts, axis=1)

    def of(self, places: Places) -> Operator:
        """The operator of some members, with copies of their tables."""
        part = copy.copy(self)
        part.at, part.frame = self.at.of(places), self.frame.of(places)
        vars(part).update({name: one[places] for name, one in self._tables().items()})
        return part

    def put(self, places: Places, other: Operator) -> None:
        """Copy the tables of some members from `other`."""
        for name, one in self._tables().items():
            one[places] = getattr(other, name)
        self.at.put(places, other.at)

    def _tables(self) -> dict[str, Array]:
        """Tables with an entry for every member, as far as they are computed."""
        kept = ("inverse", "singular", "by_remainder", "by_load", "start", "fold")
        return {name: one for name, one in vars(self).items() if name in kept}


def step_matrix(
    unit: UnitTables,
    at: Linearisation,
    h: float | Array,
    damp: Sequence[Array],
    matrices: Sequence[Array],
) -> Array:
    """The matrix of the equations of one step, ``(q, s e, s e)``.

    h is the step's length, ``(q, 1, 1)`` if members have steps of their own. For every direction,
    `damp` has the matrix from U to the equations, ``(q or 1, s, s)``, and `matrices` has D.
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


def _inverse(matrices: Array) -> tuple[Array, Mask]:
    """Inverses, nan where there is none, and which members have a finite but singular matrix."""
    is_singular = np.zeros(len(matrices), dtype=bool)
    try:
        return np.asarray(np.linalg.inv(matrices)), is_singular
    except np.linalg.LinAlgError:
        found = np.full(matrices.shape, np.nan)
        for index, matrix in enumerate(matrices):
            try:
                found[index] = np.linalg.inv(matrix)
            except np.linalg.LinAlgError:
                is_singular[index] = np.isfinite(matrix).all()
        return found, is_singular


KEPT_TABLES = 128
"""Number of step sizes whose tables are kept."""


class Operators:
    """Frames and operators of the members of an engine: computed for each step size, and kept."""

    def __init__(
        self, law: StepLaw, damping: Damping | None, method: Method, components: int
    ) -> None:
        self.law, self.damping, self._method, self._e = law, damping, method, components
        self._tables = step_tables(method)
        self._frames: OrderedDict[tuple[float, int], Frame] = OrderedDict()
        self._linear: OrderedDict[tuple[float, int], Operator] = OrderedDict()
        self._of_block: Operator | None = None
        self._whole: tuple[Operators, Places] | None = None

    def frame(self, h: float, count: int) -> Frame:
        """Tables of `count` steps of length h."""
        key = (h, count)
        if key not in self._frames:
            unit = unit_tables(self._method, count, self._e, self.law.has_rates)
            self._frames[key] = Frame(unit, self.damping, h, count)
            if len(self._frames) > KEPT_TABLES:
                self._frames.popitem(last=False)
        return self._frames[key]

    def frame_of_at_least(self, h: float, count: int, most: int) -> Frame:
        """Tables of `count` steps or, if these are there already, of `most` steps."""
        whole = self._frames.get((h, most))
        return self.frame(h, count) if whole is None or most < count else whole

    def of_linear(self, h: float, count: int) -> Operator:
        """The operator of `count` steps of linear scenes."""
        key = (h, count)
        if key not in self._linear and self._whole is not None:
            whole, places = self._whole
            self._linear[key] = whole.of_linear(h, count).of(places)
        elif key not in self._linear:
            at = self.law.linearise(np.zeros((1, self._e)), None, 0.0)
            self._linear[key] = Operator(self.frame(h, count), at, self.damping, is_linear=True)
            if len(self._linear) > KEPT_TABLES:
                self._linear.popitem(last=False)
        return self._linear[key]

    def of_step(self, state: State, h: float, guess: Array) -> tuple[Operator, Array, Array]:
        """The operator of one step about a guess of U, with its points and their remainders."""
        frame = self.frame(h, 1)
        points = frame.points_of(guess[:, None]).reshape(len(guess), self._tables.points.size, -1)
        at, rest = self.law.expand(state.x, points, state.t + h * self._tables.points)
        return Operator(frame, at, self.damping, is_linear=False), points, rest

    def of_block(self, state: State, h: float, count: int) -> Operator:
        """The operator of a block; ``state.block`` keeps its second derivatives for later."""
        key = (h, count)
        if state.block is None or state.stale.any():
            v = self.law.velocity(state.x, state.p, state.t) if self.law.has_rates else None
            fresh = self.law.linearise(state.x, v, state.t).copy()
            if state.block is not None:
                kept = np.flatnonzero(~state.stale)
                fresh.put(kept, state.block.of(kept))
            state.block, state.stale = fresh, np.zeros_like(state.stale)
        known = self._of_block
        if known is None and self._whole is not None:
            whole, places = self._whole
            known = None if whole._of_block is None else whole._of_block.of(places)
            self._of_block = known
        if known is None or (known.frame.h, known.frame.count) != key:
            known = Operator(self.frame(*key), state.block.copy(), self.damping, is_linear=False)
            self._of_block = known
        elif (places := known.at.differing(state.block)).size == len(state.longest):
            known = Operator(known.frame, state.block.copy(), self.damping, is_linear=False)
            self._of_block = known
        elif places.size:
            fresh, frame = state.block.of(places), known.frame.of(places)
            damping = None if self.damping is None else self.damping.of(places)
            known.put(places, Operator(frame, fresh, damping, is_linear=False))
        return known

    def of(self, places: Places) -> Operators:
        """Frames and operators of some members; frames are shared if all members have the same."""
        part = copy.copy(self)
        part.law = self.law.of(places)
        if self.damping is not None:
            part.damping = self.damping.of(places)
            if not self.damping.is_shared:
                part._frames = OrderedDict()
        part._linear = OrderedDict()
        part._of_block, part._whole = None, (self, places)
        return part
