"""A method and a number of equal steps for a tolerance, checked against an adaptive run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import nearest_fitting
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.singular_start import order_on
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.trajectory import Assessment, Outcome, Trajectory
from fvi_cli.studies.norms import Norm, error_norm
from fvi_cli.studies.tolerance.search import solve

FIRST_STEPS: Final = 16
MOST_STEPS: Final = 2**22
WITNESS: Final = 0.1
"""Tolerance of the adaptive run, as a share of the requested one."""
ENOUGH: Final = 0.5
"""An adaptive run that round-off limits is good enough below this share of the tolerance."""
AIMED_AT: Final = 0.5
"""The number of steps is chosen for this share of the tolerance."""
RESOLVED: Final = 0.1
"""Errors below this share of the motion are assumed to fall with the order of the method."""
FARTHEST: Final = 64
"""Largest factor from one number of steps to the next."""
STILL: Final = 0.7
"""An error that is more than this share of the previous one counts as not fallen."""


@dataclass(kw_only=True, eq=False)
class _Candidate:
    """A method with its finest run and its next number of steps; 0: it is given up."""

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
) -> tuple[AnyMethod, Trajectory, Trajectory]:
    """Find a method and a number of equal steps whose error is below a tolerance.

    An adaptive run to a tenth of the tolerance (:func:`fvi_cli.studies.tolerance.search.solve`)
    is the reference, so that equal steps cannot miss features which it resolves. Every method is
    tried on few steps. Then the method with the least expected time is run again, with the number
    of steps that follows from its error and its order. N is a power of two times the least number
    of steps whose grid contains all break points of the forcing.

    The tolerance holds in `norm`, the first of equal methods is preferred, and where the tolerance
    is out of reach the best run is returned. `log` is called with a line for every run.
    Returned are the method, its run and the adaptive run.
    """
    unit = math.sqrt(scene.final_time) if norm == "l2" else 1.0
    witness = solve(
        scene,
        tolerance=None if tolerance is None else WITNESS * tolerance / unit,
        relative=None if relative is None else WITNESS * relative,
        log=log,
    )
    known = witness.assessment
    if known is None:  # pragma: no cover - a solved run has one
        raise ValueError("tolerance: no run was made")
    size = float(np.abs(witness.position).max())
    target = unit * (relative or 0.0) * size if tolerance is None else tolerance
    own, lines = unit * known.estimate, list(known.attempts)

    def result(
        method: AnyMethod, run: Trajectory, outcome: Outcome, estimate: float, reason: str = ""
    ) -> tuple[AnyMethod, Trajectory, Trajectory]:
        is_unreliable = outcome == "unreliable"
        assessment = Assessment(
            outcome=outcome,
            tolerance=target,
            estimate=estimate,
            reason=reason,
            time=known.time if is_unreliable else None,
            place=known.place if is_unreliable else None,
            attempts=tuple(lines),
        )
        return method, replace(run, assessment=assessment), witness

    if known.outcome == "unreliable" or not own <= ENOUGH * target:
        run = integrate(scene, methods[0], max(_first_steps(scene, methods[0]), 1))
        outcome: Outcome = "unreliable" if known.outcome == "unreliable" else "refused"
        return result(methods[0], run, outcome, own, known.reason)
    candidates = [
        _Candidate(method=method, next_steps=_first_steps(scene, method)) for method in methods
    ]
    while one := _next_candidate(candidates, scene, available_bytes):
        n_steps = one.next_steps
        run = integrate(scene, one.method, n_steps)
        before, error, words = one.error, math.inf, str(run.status)
        if run.status == "ok":
            error = error_norm(run.position, witness(run.time), run.step_size, norm)
            words = f"error {error:.2g}"
        lines.append(f"{method_name(one.method)}, N = {n_steps}: {words}")
        log(lines[-1])
        one.run, one.error = run, error if math.isfinite(error) else math.inf
        if one.error + own <= target:
            return result(one.method, run, "met", one.error + own)
        factor = 2
        if one.error < RESOLVED * unit * size:
            # an error below this that falls no more is round-off
            one.stalled += one.error > STILL * before
            order = order_on(scene, one.method)
            wanted = (one.error / (AIMED_AT * target)) ** (1 / (order if order > 0 else 1.0))
            doublings = math.ceil(math.log2(max(wanted, 1.0)))
            factor = 1 << max(1, min(doublings, int(math.log2(FARTHEST))))
        one.next_steps = 0 if one.stalled > 1 else factor * n_steps
    best = min(candidates, key=lambda one: one.error)
    if best.run is None:
        raise ValueError("no number of equal steps puts every break point on the grid")
    reason = f"{target:.2g} is out of reach of these methods on equal steps, with "
    reason += f"{MOST_STEPS} steps at most and the available memory"
    if math.isfinite(best.error):
        reason += f": the best error reached is {best.error:.2g}"
    return result(best.method, best.run, "refused", best.error + own, reason)


def _first_steps(scene: Scene, method: AnyMethod) -> int:
    """The least number of steps that is tried; 0: no grid contains every break point."""
    base = nearest_fitting(scene.break_points, scene.final_time, 1)[1]
    if not base and isinstance(method, Method) and method.cq == "gauss":
        # Gauss methods allow break points between the points of the grid
        base = 1
    return base << max(0, math.ceil(math.log2(FIRST_STEPS / base))) if base else 0


def _next_candidate(
    candidates: Sequence[_Candidate], scene: Scene, available_bytes: int | None
) -> _Candidate | None:
    """The candidate with the cheapest next run, untried ones first; None: no run fits in memory."""
    options: list[tuple[float, _Candidate]] = []
    for one in candidates:
        if 0 < one.next_steps <= MOST_STEPS:
            n_steps, size = one.next_steps, 32 * (1 + scene.dimension) * one.next_steps
            if available_bytes is None or size <= available_bytes:
                work = n_steps * getattr(one.method, "degree", 1)
                options.append((-1.0 if one.run is None else work, one))
    return min(options, key=lambda option: option[0])[1] if options else None
