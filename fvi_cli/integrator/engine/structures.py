"""Large linear scenes: dense or sparse matrices, and a memory only of what dampers act on.

Steps are solved one after the other, by a factorisation in place of the inverse of a block. The
force of the past is evaluated for a group of steps at once.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import cast

import numpy as np

from fvi_cli.effects.matrices import Form, Solve, as_csr, form, times
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.engine.algebra import solver_of
from fvi_cli.integrator.engine.frame import Frame
from fvi_cli.integrator.engine.law import Linearisation
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.memory.damping import Damping
from fvi_cli.integrator.memory.interface import Combination, toeplitz_matrix
from fvi_cli.integrator.memory.reach import DamperForms, find_damper_forms
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array, Places

GROUP = 16
"""Number of steps whose past is evaluated at once."""
LARGEST_DENSE, LEAST_BLOCK = 1024, 4
"""A scene is large if its shortest block, of 4 steps, has more inputs than 1024."""
KEPT, KEPT_UNKNOWNS = 128, 2**20
"""Most step sizes whose factors are kept, and most unknowns of all their steps."""


def is_structure(
    scenes: Sequence[Scene], method: Method, modes: Sequence[Decoupling] | None
) -> bool:
    """Whether this is one scene of large or sparse linear equations that are not decoupled."""
    if len(scenes) > 1 or not scenes[0].is_linear:
        return False
    if modes is None:
        return True
    is_large = scenes[0].dimension * method.degree * LEAST_BLOCK > LARGEST_DENSE
    return modes[0].batch == 1 and is_large


class StructureLaw:
    """Constant mass and stiffness of one scene, ``(d, d)``, and the reach of its dampers."""

    is_linear, has_rates = True, False

    def __init__(self, scene: Scene) -> None:
        self._inertia, self.mass = scene.inertia, form(scene.inertia.form)
        self.stiffness: Form | None = None
        if isinstance(scene.potential, QuadraticPotential):
            self.stiffness = form(scene.potential.form)
        self.reach = find_damper_forms(scene.active_forces) if scene.active_forces else None
        self._solvers: OrderedDict[float, Solve] = OrderedDict()

    def of(self, places: Places) -> StructureLaw:
        """A structure is one member."""
        return self

    def momentum(self, x: Array, v: Array, t: float) -> Array:
        """M v."""
        return times(v, self.mass)

    def velocity(self, x: Array, p: Array, t: float) -> Array:
        """Inverse of M times p."""
        return self._inertia.velocity(p)

    def spring_force(self, x: Array) -> Array:
        """K x."""
        return np.zeros_like(x) if self.stiffness is None else times(x, self.stiffness)

    def linearise(self, x: Array, v: Array | None, t: float) -> Linearisation:
        """Not possible: sparse matrices are not arrays over members."""
        raise TypeError("structure: its matrices are not arrays over members")

    def expand(self, origin: Array, points: Array, t: Array) -> tuple[Linearisation, Array]:
        """Not possible either."""
        return self.linearise(origin, None, 0.0), points

    def remainder(
        self, at: Linearisation, origin: Array, points: Array, t: Array, before: Array
    ) -> Array:
        """Zero."""
        return np.zeros_like(points)

    def solver(self, frame: Frame, damping: Sequence[Combination]) -> Solve:
        """A function that solves the equations of a step, ``(s d,)`` to the same.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the equations have no unique solution.
        """
        kept = self._solvers
        if frame.h not in kept:
            parts: list[tuple[Array, Form]] = [(frame.unit.mass, self.mass)]
            if self.stiffness is not None:
                parts.append((-frame.stiff, self.stiffness))
            for damp, one in zip(frame.damp, damping, strict=True):
                parts.append((-damp[0], _whole(one, self.reach)))
            kept[frame.h] = solver_of(parts)
            unknowns = len(frame.unit.mass) * self.mass.shape[0]
            if len(kept) > max(8, min(KEPT, KEPT_UNKNOWNS // unknowns)):
                kept.popitem(last=False)
        kept.move_to_end(frame.h)
        return kept[frame.h]

    def along(self, values: Array) -> Array:
        """The components of velocities in the memory, ``(..., d)`` to ``(..., r)``."""
        return values if self.reach is None else self.reach.along(values)

    def spread(self, forces: Array) -> Array:
        """Forces on the components in the memory as forces on all components."""
        return forces if self.reach is None else self.reach.spread(forces)


def solve_one_by_one(
    frame: Frame,
    law: StructureLaw,
    damping: Damping | None,
    state: State,
    loads: Array | None,
) -> Steps:
    """Solve the steps of a frame; as :meth:`fvi_cli.integrator.engine.engine.Engine.solve`."""
    h, count, t = frame.h, frame.count, frame.tables
    combinations = () if damping is None else damping.combinations
    drive, failed = t.to_inputs, False
    try:
        solve = law.solver(frame, combinations)
    except np.linalg.LinAlgError:
        # the step has no unique solution
        solve, failed = np.zeros_like, True
    (m, i), (s, e) = (frame.weights.size, len(drive)), (t.degree, state.x.shape[1])
    r, matrices = state.z.shape[2], [_form_of(one) for one in combinations]
    every = [toeplitz_matrix(one[0]) for one in frame.sequences]
    past = np.zeros((count * m, r))
    if damping is not None and frame.damping is not None:
        past = damping.past(frame.damping, state.z, state.column, count)[0]
    driven, unknowns = np.zeros((count * i, r)), np.empty((count, s, e))
    dx, dp = np.empty((count, e)), np.empty((count, e))
    moved, gained = np.zeros(e), np.zeros(e)
    to_mean = (h * t.weights) @ frame.displacement[0]

    def own(step: int, first: int, last: int) -> Array:
        """Force in a step by the inputs of some steps of the group, ``(m, d)``."""
        total = np.zeros((m, r))
        rows, by = slice(step * m, step * m + m), slice(first * i, last * i)
        for local, matrix in zip(every, matrices, strict=True):
            total += times(local[rows, by] @ driven[by], matrix)
        return total

    for k in range(count):
        known = np.zeros((s + 1, e))
        if damping is not None:
            force = past[k * m : k * m + m]
            known += frame.to_loads @ law.spread(force + own(k, 0, k) if k else force)
        if law.stiffness is not None:
            known += frame.test_sum[:, None] * law.spring_force(state.x[0] + moved)
        if loads is not None:
            known -= loads[0, k]
        right = known[:-1].copy()
        right[0] -= state.p[0] + gained
        u = unknowns[k] = solve(right.ravel()).reshape(s, e)
        change = -known.sum(axis=0) - law.spring_force(to_mean @ u)
        if damping is not None:
            driven[k * i : k * i + i] = drive @ law.along(u)
            change -= frame.weights @ law.spread(own(k, k, k + 1))
        moved, gained = moved + h * u[-1], gained + change
        dx[k], dp[k] = moved, gained
    z = state.z
    if damping is not None and frame.damping is not None:
        z = frame.damping.kernels.push(state.z, driven[None], count)
    return Steps(
        h=h,
        count=count,
        dx=dx[None],
        dp=dp[None],
        unknowns=unknowns[None],
        inputs=np.matmul(drive, unknowns).reshape(1, -1, e),
        z=z,
        iterations=np.zeros(1, dtype=np.int64),
        most=np.zeros(1, dtype=np.int64),
        failed=np.full(1, failed),
        failed_at=np.zeros(1, dtype=np.int64),
        change=np.zeros(1),
    )


def _form_of(one: Combination) -> Form:
    """Its matrix, ``(r, r)``."""
    matrix = one.matrix
    return matrix.reshape(matrix.shape[-2:]) if isinstance(matrix, np.ndarray) else matrix


def _whole(one: Combination, reach: DamperForms | None) -> Form:
    """Its matrix on all components, ``(d, d)``."""
    if reach is None:
        return _form_of(one)
    rows = as_csr(reach.rows)
    return cast(Form, as_csr(cast(Form, rows.T @ as_csr(_form_of(one)) @ rows)))
