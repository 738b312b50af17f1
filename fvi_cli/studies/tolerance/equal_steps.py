"""A method and a number of equal steps for a tolerance, held against an adaptive run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import nearest_fitting
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.run.checkpoint import RunKeeper, part_of
from fvi_cli.integrator.trajectory import Assessment, Outcome, Trajectory
from fvi_cli.planning.expected_order import expected_order
from fvi_cli.planning.plan import plan_run
from fvi_cli.studies.norms import Norm, error_norm
from fvi_cli.studies.tolerance.search import solve

FIRST_STEPS: Final = 16
MOST_STEPS: Final = 2**22
WITNESS: Final = 0.1
"""Tolerance of the adaptive run, as a share of the one that is asked for."""
ENOUGH: Final = 0.5
"""An adaptive run that stops at round-off will do below this share of the tolerance."""
AIMED_AT: Final = 0.5
"""Share of the tolerance at which a number of steps aims."""
RESOLVED: Final = 0.1
"""Errors below this share of the motion are thought to fall by the order of the method."""
FARTHEST: Final = 64
"""No number of steps is more than so many times the one before."""
STILL: Final = 0.7
"""An error of more than this share of the one before has not fallen."""


@dataclass(kw_only=True, eq=False)
class _Candidate:
    """A method with its finest run and where to go next; no step number: it is out."""

    method: AnyMethod
    next_steps: int
    error: float = math.inf
    run: Trajectory | None = None
    stalled: int = 0


def solve_on_equal_steps(
    scene: Scene,
    methods: Sequence[AnyMethod],
    *,
    tolerance: float | None = None,
    relative: float | None = None,
    norm: Norm = "max",
    available_bytes: int | None = None,
    log: Callable[[str], object] = lambda line: None,
    checkpoints: RunKeeper | None = None,
) -> tuple[AnyMethod, Trajectory, Trajectory]:
    """Find a method and a number of equal steps whose error is below a tolerance.

    An adaptive run to a tenth of the tolerance (:func:`fvi_cli.studies.tolerance.search.solve`)
    stands for the truth: what it sees cannot be missed by the equal steps. Every method is tried on
    few steps; then the one that is thought to take the least time goes on, to the number of steps
    that its error and its order ask for. N is a power of two times the least number of steps on
    whose grid all break points of the forcing lie.

    The tolerance holds in `norm`, the first of equal methods is preferred, and where the tolerance
    is out of reach the best run is returned. `log` is given a line for every run; every run has a
    part of `checkpoints`. Beside method and run comes the adaptive one.
    """
    unit = math.sqrt(scene.final_time) if norm == "l2" else 1.0
    witness = solve(
        scene,
        tolerance=None if tolerance is None else WITNESS * tolerance / unit,
        relative=None if relative is None else WITNESS * relative,
        log=log,
        checkpoints=checkpoints,
    )
    search = _Search(
        scene=scene,
        witness=witness,
        norm=norm,
        unit=unit,
        target=_target(witness, tolerance, relative, unit),
        available_bytes=available_bytes,
        log=log,
        checkpoints=checkpoints,
    )
    return *search.result(methods), witness


def _target(
    witness: Trajectory, tolerance: float | None, relative: float | None, unit: float
) -> float:
    """The tolerance in the norm."""
    if tolerance is not None:
        return tolerance
    return unit * (relative or 0.0) * float(np.abs(witness.position).max())


@dataclass(kw_only=True, eq=False)
class _Search:
    """The runs so far; only the finest of every method is kept."""

    scene: Scene
    witness: Trajectory
    norm: Norm
    unit: float
    target: float
    available_bytes: int | None
    log: Callable[[str], object]
    checkpoints: RunKeeper | None = None
    lines: list[str] = field(default_factory=list)

    def result(self, methods: Sequence[AnyMethod]) -> tuple[AnyMethod, Trajectory]:
        known = self.witness.assessment
        if known is None:  # pragma: no cover - a solved run has one
            raise ValueError("tolerance: no run was made")
        self.lines += known.attempts
        own = self.unit * known.estimate
        if known.outcome == "unreliable" or not own <= ENOUGH * self.target:
            outcome: Outcome = "unreliable" if known.outcome == "unreliable" else "refused"
            run = integrate(self.scene, methods[0], max(self._first_steps(methods[0]), 1))
            return methods[0], self._result(run, outcome, self.unit * known.estimate, known.reason)
        candidates = [
            _Candidate(method=method, next_steps=self._first_steps(method)) for method in methods
        ]
        while True:
            options = [one for one in candidates if 0 < one.next_steps <= MOST_STEPS]
            options = [one for one in options if self._has_room(one)]
            if not options:
                break
            chosen = min(options, key=self._work)
            self._advance(chosen)
            if chosen.run is not None and chosen.error + own <= self.target:
                return chosen.method, self._result(chosen.run, "met", chosen.error + own, "")
        best = min(candidates, key=lambda one: one.error)
        if best.run is None:
            raise ValueError("no number of equal steps puts every break point on the grid")
        reason = f"{self.target:.2g} is out of reach of these methods on equal steps, with "
        reason += f"{MOST_STEPS} steps at most and the available memory"
        if math.isfinite(best.error):
            reason += f": the best error reached is {best.error:.2g}"
        return best.method, self._result(best.run, "refused", best.error + own, reason)

    def _first_steps(self, method: AnyMethod) -> int:
        base = nearest_fitting(self.scene, 1)[1]
        if not base:
            if not (isinstance(method, Method) and method.cq == "gauss"):
                return 0
            # Gauss methods take break points between the points of the grid
            base = 1
        return base << max(0, math.ceil(math.log2(FIRST_STEPS / base)))

    def _work(self, one: _Candidate) -> float:
        """What the next run takes; every method is tried once before."""
        return -1.0 if one.run is None else plan_run(self.scene, one.method, one.next_steps).work

    def _has_room(self, one: _Candidate) -> bool:
        if self.available_bytes is None:
            return True
        plan = plan_run(self.scene, one.method, one.next_steps)
        return plan.memory_bytes <= self.available_bytes

    def _advance(self, one: _Candidate) -> None:
        """Run it, hold it against the witness, and say where it goes next."""
        n_steps = one.next_steps
        own = part_of(self.checkpoints, f"{one.method!r} N = {n_steps}")
        run = integrate(self.scene, one.method, n_steps, checkpoints=own)
        before, error = one.error, math.inf
        if run.status == "ok":
            error = error_norm(run.position, self.witness(run.time), run.step_size, self.norm)
        line = f"{method_name(one.method)}, N = {n_steps}: "
        line += f"error {error:.2g}" if run.status == "ok" else run.status
        self.lines.append(line)
        self.log(line)
        one.run, one.error = run, error if math.isfinite(error) else math.inf
        amplitude = self.unit * float(np.abs(self.witness.position).max())
        factor = 2
        if one.error < RESOLVED * amplitude:
            # what falls no more below this is round-off
            one.stalled += one.error > STILL * before
            order = expected_order(self.scene, one.method, self.norm, n_steps)
            if not order > 0:
                order = 1.0
            wanted = (one.error / (AIMED_AT * self.target)) ** (1 / order)
            doublings = math.ceil(math.log2(max(wanted, 1.0)))
            factor = 1 << max(1, min(doublings, int(math.log2(FARTHEST))))
        one.next_steps = 0 if one.stalled > 1 else factor * n_steps

    def _result(
        self, run: Trajectory, outcome: Outcome, estimate: float, reason: str
    ) -> Trajectory:
        found = self.witness.assessment
        assessment = Assessment(
            outcome=outcome,
            tolerance=self.target,
            estimate=estimate,
            reason=reason,
            time=None if found is None or outcome != "unreliable" else found.time,
            place=None if found is None or outcome != "unreliable" else found.place,
            attempts=tuple(self.lines),
        )
        return replace(run, assessment=assessment)
