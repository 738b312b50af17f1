"""Single steps of any size."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.domain import first_undefined, undefined_near
from fvi_cli.integrator.failure import StepFailedError, no_unique_solution
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.steps.dynamics import Separable
from fvi_cli.integrator.steps.step import StepMatrices, StepResult, StepSolver
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis

MATRICES_KEPT = 128
"""Step sizes whose matrices are kept; adaptive runs take a few dozen."""
UNKNOWNS_KEPT = 2**20
"""Unknowns of their steps, at most: factors of large structures take a kilobyte for each."""


@dataclass(kw_only=True, eq=False)
class Marker:
    """Where a run is: everything that the steps to come depend on.

    Parameters
    ----------
    time
        t.
    position, momentum
        Compensated sums, shape ``(d,)``.
    states
        States of the damping, shape ``(J, columns)``.
    unknowns, step_size
        Polynomial of the last step, for the next guess; None at the start and after breaks.
    """

    time: float
    position: CompensatedSum
    momentum: CompensatedSum
    states: Array
    unknowns: Array | None = None
    step_size: float = 0.0


class Stepper:
    """Steps of one run; matrices of the sizes used last are kept."""

    def __init__(self, solver: StepSolver, loads: StepLoads) -> None:
        self.solver, self.loads = solver, loads
        self._kept: OrderedDict[float, StepMatrices] = OrderedDict()
        self._continuations: OrderedDict[float, Array] = OrderedDict()
        tables = solver.tables
        self._basis = lobatto_basis(tables.degree)
        self._control = tables.control_points
        size = tables.degree * solver.dynamics.dimension
        self._most_kept = max(8, min(MATRICES_KEPT, UNKNOWNS_KEPT // size))

    def matrices(self, step_size: float) -> StepMatrices:
        """Matrices of a step size, made once while it is in use."""
        found = self._kept.get(step_size)
        if found is None:
            found = self._kept[step_size] = self.solver.matrices(step_size)
            if len(self._kept) > self._most_kept:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(step_size)
        return found

    def guess(self, marker: Marker, step_size: float) -> Array:
        """U of a step from the polynomial of the last one; uniform motion without one."""
        if marker.unknowns is not None and step_size <= 1.5 * marker.step_size:
            return self._continued(step_size / marker.step_size) @ marker.unknowns
        with np.errstate(all="ignore"):
            velocity = self.solver.dynamics.velocity(
                marker.position.value, marker.momentum.value, marker.time
            )
        velocity = np.where(np.isfinite(velocity), velocity, 0.0)
        return np.outer(self._control[1:], velocity)

    def _continued(self, ratio: float) -> Array:
        """U of the next step from this one's by going on with the polynomial, ``(s, s)``."""
        found = self._continuations.get(ratio)
        if found is None:
            ahead = self._basis.values(1.0 + ratio * self._control[1:])[1:].T
            found = np.asarray((ahead - np.eye(self._control.size - 1)[-1]) / ratio)
            self._continuations[ratio] = found
            if len(self._continuations) > MATRICES_KEPT:
                self._continuations.popitem(last=False)
        return found

    def attempt(self, marker: Marker, step_size: float, *, fresh: bool) -> StepResult:
        """Solve a step; nothing is changed.

        Raises
        ------
        StepFailedError
            If its equations cannot be solved, or it leaves the domain of the potential energy.
        """
        every = self.loads.of_steps(marker.time, step_size, 1, is_fresh=fresh)
        result = self.solve(marker, step_size, None if every is None else every[0])
        dynamics, begin = self.solver.dynamics, marker.position.value
        if isinstance(dynamics, Separable):
            path = np.concatenate([begin[None], begin + step_size * result.unknowns])
            outside = first_undefined(dynamics.potential, path)
            if outside is not None:
                words = undefined_near(path[outside])
                raise StepFailedError(words, result.residuals, reason="irregular")
        return result

    def velocity_of(self, unknowns: Array) -> Array:
        """Velocities at the stages from U, shape ``(s, d)`` to ``(r, d)``."""
        return self.solver.tables.slopes[1:].T @ unknowns

    def solve(self, marker: Marker, step_size: float, loads: Array | None) -> StepResult:
        """The same with load vectors that are at hand, shape ``(s + 1, d)``."""
        guess = None if self.solver.dynamics.is_linear else self.guess(marker, step_size)
        try:
            at = self.matrices(step_size)
        except np.linalg.LinAlgError:
            raise no_unique_solution(step_size) from None
        return self.solver.solve(
            at,
            marker.time,
            marker.position.value,
            marker.momentum.value,
            marker.states,
            loads,
            guess,
        )

    def accept(self, marker: Marker, result: StepResult, step_size: float, end: float) -> None:
        """Go to the end of a solved step."""
        damping = self.solver.damping
        if damping is not None and damping.has_memory:
            driving = damping.input_of(result.driving)
            tables = self.matrices(step_size).damping
            damping.advance(tables, marker.states, driving)
        marker.position.add(step_size * result.unknowns[-1])
        marker.momentum.add(result.momentum_change)
        marker.time, marker.step_size, marker.unknowns = end, step_size, result.unknowns
