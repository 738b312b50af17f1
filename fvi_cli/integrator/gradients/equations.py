"""The linearised equations of blocks of steps, solved: one matrix for each."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.damping.damping import Damping
from fvi_cli.integrator.damping.directions import Direction
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.engine.frame import Frame, unit_tables
from fvi_cli.integrator.engine.law import law_of
from fvi_cli.integrator.engine.operator import Operator, step_matrix
from fvi_cli.integrator.engine.tables import on_components
from fvi_cli.integrator.gradients.past import LinearisedStretch
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.interface import toeplitz_matrix
from fvi_cli.integrator.memory.kernel import Term
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.arrays import Array

Points = tuple[Array, Array, Array]
"""Positions, velocities and times at the stages of all steps."""


class Maps(NamedTuple):
    """Blocks of a stretch: one for all of them, or one for each, in the first axis."""

    by_begin: Array  # U by (x, p, F), (.., B s d, 2 d + f B m d)
    by_load: Array  # U by load vectors
    ends: Array  # position and momentum behind the block by U alone, (.., 2 d, B s d)
    whole: Array  # T, (.., 2 d + B m d, 2 d + f B m d)


class Equations:
    """The equations of a scene by a Runge-Kutta method, in all its components.

    Damping terms have matrices ``(f, d, d)``; regular linear scenes go by blocks of equal steps.
    """

    def __init__(
        self,
        scene: Scene,
        method: Method,
        coefficients: Array,
        terms: Sequence[Term],
        memory: Exponentials | None,
        *,
        is_regular: bool,
    ) -> None:
        self.method, self.tables, self.d = method, step_tables(method), scene.dimension
        self.coefficients, self._terms, self._memory = coefficients, terms, memory
        self._is_regular, self._to_inputs = is_regular, self.tables.to_inputs
        whole = [Decoupling(mass=scene.inertia.mass, modes=None)] if scene.is_linear else None
        self._law = law_of([scene], whole)

    def maps(self, stretch: LinearisedStretch, points: Points | None) -> Maps:
        """The matrices of a stretch; of nonlinear scenes at positions, velocities and times.

        Raises
        ------
        ValueError
            If the linearised equations have no unique solution.
        """
        t, count, d, f = self.tables, stretch.count, self.d, len(self.coefficients)
        try:
            start, by_load, gained, by_position = (
                self._of_blocks(stretch) if self._is_regular else self._of_steps(stretch, points)
            )
        except np.linalg.LinAlgError:
            raise ValueError(
                "derivatives: the linearised equations of a step have no unique solution"
            ) from None
        a, rows, s, m = len(start), start.shape[1], t.degree, t.points.size
        h, local = stretch.sizes, stretch.local[:, :f]
        if not self._is_regular:
            h, local = h[stretch.which], local[stretch.which]
        to_force = -h[:, None, None, None, None] * t.test_weights.T

        def of_force(by_loads: Array) -> Array:
            """From derivatives by load vectors to those by forces, ``(a, rows, f, B, m d)``."""
            drawn = np.matmul(to_force, by_loads.reshape(*by_loads.shape[:2], -1, s + 1, d))
            found = np.matmul(drawn[:, :, None], self.coefficients[:, None])
            return np.asarray(found.reshape(*found.shape[:4], m * d))

        # by loads of the first step; by those of another one it is the same later
        first = of_force(by_load[..., : (s + 1) * d]).reshape(a, count, s * d, f, m * d)
        past = np.moveaxis(toeplitz_matrix(np.moveaxis(first, 3, 1)), 1, 2)
        by_begin = np.concatenate([start, past.reshape(a, rows, f * count * m * d)], axis=2)
        ends = np.zeros((a, 2 * d, rows))
        last = ends[:, :d].reshape(a, d, count, s, d)[..., -1, :]
        last[:] = h[:, None, None, None] * np.eye(d)[:, None]
        lost = np.matmul((h[:, None] * np.tile(t.weights, count))[:, None, None], local)
        lost = np.matmul(lost.reshape(len(h), f, count, m), self._to_inputs)
        for index, matrix in enumerate(self.coefficients):
            gained = gained - on_components(lost[:, index].reshape(len(h), 1, -1), matrix[None])
        ends[:, d:] = gained
        behind = ends @ by_begin
        behind[..., : 2 * d] += np.eye(2 * d)
        behind[:, d:, :d] += by_position
        sums = np.broadcast_to(np.tile(np.eye(d), count * (s + 1)), (a, d, count * (s + 1) * d))
        behind[:, d:, 2 * d :] += of_force(sums).reshape(a, d, f * count * m * d)
        driven = np.matmul(self._to_inputs, by_begin.reshape(a, count, s, -1))
        whole = np.concatenate([behind, driven.reshape(a, -1, by_begin.shape[2])], axis=1)
        return Maps(by_begin, by_load, ends, whole)

    def _of_blocks(self, stretch: LinearisedStretch) -> tuple[Array, Array, Array, Array]:
        """Of a linear scene: U by (x, p) and loads, what p gains by K along U, and by x."""
        h, count, damping = float(stretch.sizes[0]), stretch.count, None
        if self._memory is not None:
            one = np.ones((1, 1))
            directions = [
                Direction(matrix=matrix[None], terms=((term,),), factors=one, is_relative=False)
                for matrix, term in zip(self.coefficients, self._terms, strict=True)
            ]
            damping = Damping(directions, self._memory, np.zeros((1, self.d)))
        unit = unit_tables(self.method, count, self.d, False)
        frame = Frame(unit, damping, h, count)
        at = self._law.linearise(np.zeros((1, self.d)), None, 0.0)
        op = Operator(frame, at, damping, is_linear=True)
        if op.singular.any():
            raise np.linalg.LinAlgError
        path = np.tile(h * self.tables.weights, count) @ toeplitz_matrix(frame.displacement)
        gained = -on_components(path[None, None], at.stiffness)
        return op.start, op.by_load, gained, -h * count * at.stiffness

    def _of_steps(
        self, stretch: LinearisedStretch, points: Points | None
    ) -> tuple[Array, Array, Array, Array]:
        """The same of every step, with the second derivatives at its stages."""
        t, d, n = self.tables, self.d, stretch.blocks
        s, h = t.degree, stretch.sizes[stretch.which][:, None, None]
        origin, at_points, time = np.zeros((1, d)), np.zeros((1, 1, d)), np.zeros(1)
        if points is not None:
            at_points, velocity, time = (one[stretch.steps] for one in points)
            if self._law.has_rates:
                at_points = np.concatenate([at_points, velocity], axis=2)
        at, _ = self._law.expand(origin, at_points, time)
        stiffness = at.stiffness if at.stiffness.ndim == 4 else at.stiffness[:, None]
        stiffness = np.broadcast_to(stiffness, (n, t.points.size, d, d))
        unit = unit_tables(self.method, 1, d, self._law.has_rates)
        local = np.moveaxis(stretch.local[stretch.which], 1, 0)[: len(self.coefficients)]
        damp = list(h * (t.test_weights[:-1] @ local @ self._to_inputs))
        matrix = step_matrix(unit, at, h, damp, list(self.coefficients[:, None]))
        inverse: Array = np.asarray(np.linalg.inv(matrix))
        by_load = np.concatenate([-inverse, np.zeros((n, s * d, d))], axis=2)
        # at a stage K and C act on the position at the beginning as on the way from there
        mixed = [] if at.mixed is None else [at.mixed]
        moved = np.concatenate([*mixed, -stiffness], axis=2).reshape(n, -1, d)
        tests, to_points = h * unit.tests[-1], h * unit.points[0]
        if mixed:
            tests, to_points = tests + unit.tests[0], to_points + unit.points[1]
        start = np.concatenate([by_load @ (tests @ moved), -inverse[..., :d]], axis=2)
        weighted = h[..., None] * t.weights[:, None, None]
        turned = [one.swapaxes(2, 3) for one in mixed]
        by_point = weighted * np.concatenate([-stiffness, *turned], axis=3)
        gained = by_point.swapaxes(1, 2).reshape(n, d, -1) @ to_points
        return start, by_load, gained, -(weighted * stiffness).sum(axis=1)
