"""Single steps of any size, and the loop that finds their sizes on the way."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.domain import first_undefined, undefined_near
from fvi_cli.integrator.failure import Failure, StepFailedError, no_unique_solution
from fvi_cli.integrator.growth_bound import GrowthBound, first_outside
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.local_error.defect import StepPath
from fvi_cli.integrator.local_error.examine import Examiner, Finding
from fvi_cli.integrator.meshes.adaptive import StepController
from fvi_cli.integrator.results.newton_record import NewtonRecord
from fvi_cli.integrator.steps.dynamics import Separable
from fvi_cli.integrator.steps.step import StepMatrices, StepResult, StepSolver
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis

MATRICES_KEPT = 128
"""Step sizes whose matrices are kept; adaptive runs take a few dozen."""
UNKNOWNS_KEPT = 2**20
"""Unknowns of their steps, at most: factors of large structures take a kilobyte for each."""
INFINITE = "the force may be infinite"


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


@dataclass(kw_only=True, eq=False)
class Course:
    """Points and polynomials of the steps that are done, in lists that grow."""

    times: list[float] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    momenta: list[Array] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)
    unknowns: list[Array] = field(default_factory=list)
    failure: Failure | None = None
    rejected: int = 0
    iterations: int = 0
    most_iterations: int = 0
    worst_step: int = -1
    worst_residuals: tuple[float, ...] = ()
    doubts: list[tuple[float, str]] = field(default_factory=list)

    @classmethod
    def begun(cls, marker: Marker) -> Course:
        """Of a run that stands at its start."""
        return cls(
            times=[marker.time],
            positions=[marker.position.value.copy()],
            momenta=[marker.momentum.value.copy()],
        )

    def kept(self) -> dict[str, Array]:
        """Points and polynomials so far by name, for a checkpoint."""
        return {
            "times": np.array(self.times),
            "positions": np.array(self.positions),
            "momenta": np.array(self.momenta),
            "sizes": np.array(self.sizes),
            "unknowns": np.array(self.unknowns),
            "infinite": np.array([time for time, words in self.doubts if words == INFINITE]),
        }

    def restore(self, newton: NewtonRecord, kept: Mapping[str, Array] | None = None) -> None:
        """Go on behind a checkpoint, with what was kept before it."""
        self.iterations, self.most_iterations = newton.iterations, newton.largest
        self.worst_step, self.worst_residuals = newton.worst_step, newton.worst_residuals
        if kept is not None:
            self.times, self.sizes = kept["times"].tolist(), kept["sizes"].tolist()
            self.positions, self.momenta = list(kept["positions"]), list(kept["momenta"])
            self.unknowns = list(kept["unknowns"])
            self.doubts = [(time, INFINITE) for time in kept["infinite"].tolist()]

    @property
    def newton(self) -> NewtonRecord:
        """Record of Newton's iteration."""
        return NewtonRecord(
            iterations=self.iterations,
            largest=self.most_iterations,
            worst_step=self.worst_step,
            worst_residuals=self.worst_residuals,
        )

    def add(self, marker: Marker, result: StepResult, size: float) -> None:
        """A step that is done; the marker stands at its end."""
        self.times.append(marker.time)
        self.positions.append(marker.position.value.copy())
        self.momenta.append(marker.momentum.value.copy())
        self.sizes.append(size)
        self.unknowns.append(result.unknowns)

    def note(self, residuals: tuple[float, ...], step: int | None = None) -> None:
        """Count the iterations of a step; by default of the one behind those that are kept."""
        self.iterations += len(residuals)
        if len(residuals) > self.most_iterations:
            self.most_iterations, self.worst_residuals = len(residuals), residuals
            self.worst_step = len(self.sizes) if step is None else step


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


def march_adaptively(
    stepper: Stepper,
    marker: Marker,
    course: Course,
    controller: StepController,
    examiner: Examiner,
    *,
    most_steps: int,
    bound: GrowthBound,
    after_step: Callable[[], object],
) -> None:
    """Steps whose sizes the controller finds, to the end or to a failure."""
    with np.errstate(over="ignore", invalid="ignore"):
        while not controller.is_finished:
            size = controller.propose()
            fresh = controller.is_fresh
            if fresh:
                marker.unknowns = None
            finding = Finding(error=math.inf)
            scale = _scale(marker, None, size)
            try:
                result = stepper.attempt(marker, size, fresh=fresh)
                scale = _scale(marker, result, size)
                path = StepPath(
                    begin=marker.time,
                    size=size,
                    position=marker.position.value,
                    unknowns=result.unknowns,
                )
                finding = examiner.examine(
                    path,
                    controller.tolerance_for(scale),
                    fresh=fresh,
                    shortest=controller.shortest_step,
                )
                course.note(result.residuals)
                error = StepFailedError("the local error cannot be kept")
            except StepFailedError as failed:
                course.note(failed.residuals)
                result, error = None, failed
            if finding.cut is not None:
                controller.cut(finding.cut)
                continue
            is_kink = finding.ends_on is not None
            if not controller.judge(size, finding.error, scale, ends_on_kink=is_kink):
                examiner.give_up_cuts()
                if controller.is_stuck:
                    course.failure = Failure.in_step(len(course.sizes), marker.time, error)
                    break
                continue
            if result is None:
                break
            examiner.go_on(finding)
            if finding.unresolved_at is not None:
                course.doubts.append((finding.unresolved_at, INFINITE))
            stepper.accept(marker, result, size, controller.time)
            course.add(marker, result, size)
            if not _is_finite(marker):
                course.failure = Failure.not_finite(len(course.sizes) - 1, marker.time)
                break
            if float(np.abs(marker.position.value).max()) > bound.size:
                outside = first_outside(
                    bound.with_force(stepper.loads.largest_force),
                    marker.position.value[None],
                    marker.momentum.value[None],
                    np.array([marker.time]),
                    len(course.sizes) - 1,
                )
                if outside is not None:
                    course.failure = outside[1]
                    break
            if len(course.sizes) >= most_steps:
                most = StepFailedError("the most steps are done", reason="most steps")
                course.failure = Failure.in_step(len(course.sizes), marker.time, most)
                break
            after_step()
    course.rejected = controller.rejected
    if controller.forced_at is not None:
        course.doubts.append((controller.forced_at, "no step is short enough for the local error"))


def _scale(marker: Marker, result: StepResult | None, size: float) -> float:
    """Size of the position and of the way of a step, a length; zero if it is not finite."""
    found = float(np.abs(marker.position.value).max())
    if result is not None:
        found += size * float(np.abs(result.velocity).max())
    return found if math.isfinite(found) else 0.0


def _is_finite(marker: Marker) -> bool:
    return bool(
        np.isfinite(marker.position.value).all() and np.isfinite(marker.momentum.value).all()
    )
