"""A method and a number of steps for a tolerance, with an error estimate that is checked."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import nearest_fitting
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.planning.plan import planned_bytes, planned_seconds
from fvi_cli.planning.resolution import Resolution, find_resolution
from fvi_cli.studies.accuracy_results import Choice, Reached
from fvi_cli.studies.candidates import Candidate, least_steps, usual_candidates
from fvi_cli.studies.experiment import Norm
from fvi_cli.studies.step_doubling import difference_norm, round_off_floor

Array = NDArray[np.float64]
MOST_RUNS: Final = 24
MOST_STEPS: Final = 2**22

MARGIN: Final = 1.0
"""A prediction must stay below this share of the tolerance for a number of steps to be tried."""

BETTER: Final = 0.6
"""Another method is turned to when it is predicted to take less than this share of the time."""

FAR_OFF: Final = 1e5
"""Guesses that exceed the tolerance by more are believed without a run."""

GREW: Final = 4.0
"""Differences that grow by more than this are not those of round-off."""

STILL: Final = 0.6
"""A difference of more than this share of the one before has not fallen."""


def likely_choices(
    scene: Scene,
    methods: Sequence[AnyMethod],
    tolerance: float,
    norm: Norm = "max",
    *,
    available_bytes: int | None = None,
    allow_unstable: bool = False,
) -> list[Choice]:
    """What :func:`reach_tolerance` would try, quickest first; nothing is integrated.

    Methods that are not thought to reach the tolerance are left out.
    """
    search = _search(scene, tolerance, norm, available_bytes, allow_unstable=allow_unstable)
    candidates = search.candidates(methods) if search.base else []
    options = [option for c in candidates if (option := search.option(c)) is not None]
    return [
        Choice(method=option.candidate.method, n_steps=option.n_steps, seconds=option.seconds)
        for option in sorted(options, key=lambda option: option.seconds)
    ]


def reach_tolerance(
    scene: Scene,
    methods: Sequence[AnyMethod],
    tolerance: float,
    norm: Norm = "max",
    *,
    available_bytes: int | None = None,
    allow_unstable: bool = False,
    tell: Callable[[str], object] = lambda line: None,
) -> Reached:
    """Find a method and a number of steps whose estimated error is below `tolerance`.

    The method that is predicted to be the quickest is run on N/2 and N steps; what they differ by
    corrects the predictions, and the next method and N are chosen by them, until an estimate lies
    below the tolerance. N is a power of two times the least number of steps on whose grid all
    break points of the forcing lie. No N is accepted on which a method does not see what moves in
    the scene (:func:`fvi_cli.planning.resolution.find_resolution`).

    Parameters
    ----------
    scene
        What is integrated.
    methods
        The candidates; the first of equals is preferred.
    tolerance
        Largest error of the position in `norm`.
    norm
        ``max``, ``final`` or ``l2``.
    available_bytes
        Memory that a run may take; None: as much as it likes.
    allow_unstable
        Run methods on numbers of steps on which they are predicted to blow up.
    tell
        Is told of every run in a line.

    Returns
    -------
    Reached
        A tolerance below the floor of round-off, or one that cannot be reached with the steps and
        memory there are, is refused.
    """
    search = _search(scene, tolerance, norm, available_bytes, allow_unstable=allow_unstable)
    return search.result(methods, tell)


def _search(
    scene: Scene,
    tolerance: float,
    norm: Norm,
    available_bytes: int | None,
    *,
    allow_unstable: bool,
) -> _Search:
    return _Search(
        scene=scene,
        tolerance=tolerance,
        norm=norm,
        available_bytes=available_bytes,
        allow_unstable=allow_unstable,
        base=nearest_fitting(scene, 1)[1],
        resolution=find_resolution(scene, tolerance),
    )


@dataclass(frozen=True, kw_only=True)
class _Next:
    """A candidate with the steps that it is thought to need, and the seconds until then."""

    candidate: Candidate
    n_steps: int
    seconds: float


def _comparison(chosen: _Next, ranked: Sequence[_Next]) -> str:
    """Why this one: the time it was thought to take, and the other one that came closest."""
    others = [option for option in ranked if option.candidate is not chosen.candidate]
    if not others:
        return ""
    other = others[0]
    return (
        f", thought to take {chosen.seconds:.2g} s and {other.candidate.method.case} "
        f"{other.seconds:.2g} s on N = {other.n_steps}"
    )


@dataclass(kw_only=True, eq=False)
class _Search:
    """The runs so far; only the finest of every method is kept."""

    scene: Scene
    tolerance: float
    norm: Norm
    available_bytes: int | None
    allow_unstable: bool
    base: int
    resolution: Resolution
    attempts: list[str] = field(default_factory=list)
    scale: float = 0.0
    tell: Callable[[str], object] = lambda line: None
    _why: str = ""
    _last: Candidate | None = None
    _exhausted: dict[AnyMethod, str] = field(default_factory=dict)
    _latest: dict[AnyMethod, tuple[int, Trajectory]] = field(default_factory=dict)

    def candidates(self, methods: Sequence[AnyMethod]) -> list[Candidate]:
        """The methods with what is expected of them."""
        return usual_candidates(self.scene, methods, self.norm, self.resolution)

    def result(self, methods: Sequence[AnyMethod], tell: Callable[[str], object]) -> Reached:
        """Search, and tell of every run."""
        self.tell = tell
        candidates = self.candidates(methods)
        if not self.base:
            return self._refused(
                candidates[0], 1, "no number of steps puts every break point on the grid"
            )
        self.scale = float(np.abs(self.scene.initial_position).max())
        least = self._least(candidates[0])
        if self._floor(least) > self.tolerance:
            return self._refused(candidates[0], least, self._below_floor(least))
        current: Candidate | None = None
        while len(self.attempts) < MOST_RUNS:
            chosen = self._choose(candidates, current)
            if chosen is None:
                return self._refused(self._last or candidates[0], 0, self._why_not())
            current, n = chosen.candidate, chosen.n_steps
            if self._floor(n) > self.tolerance:
                self._exhausted[current.method] = self._below_floor(n)
                continue
            latest = self._latest.get(current.method)
            # after a run that was compared, one doubling after the other: any may do
            n = n if latest is None or not current.differences else min(n, 2 * latest[0])
            if latest is None or latest[0] != n // 2:
                self._run(current, n // 2)
            trajectory = self._run(current, n)
            estimate = current.estimate(n)
            if self._floor(n) > self.tolerance:
                self._exhausted[current.method] = self._below_floor(n)
            elif estimate <= self.tolerance:
                return self._accepted(current, n, trajectory, max(estimate, self._floor(n)))
            elif self._stands_still(current, n):
                self._exhausted[current.method] = self._no_further(current, n)
            self._spread(candidates, current)
        return self._refused(current or candidates[0], 0, f"{MOST_RUNS} runs were not enough")

    def _floor(self, n_steps: int) -> float:
        return round_off_floor(self.scale, n_steps, self.scene.final_time, self.norm)

    def _least(self, candidate: Candidate) -> int:
        """The least N on the way from the base by doubling that sees all, and can be halved."""
        wanted = max(least_steps(candidate.method, self.resolution), 2 * self.base)
        return self.base << math.ceil(math.log2(wanted / self.base))

    def _choose(self, candidates: Sequence[Candidate], current: Candidate | None) -> _Next | None:
        options = [option for c in candidates if (option := self.option(c)) is not None]
        if not options:
            return None
        # round-off grows with N: a method that takes fewer steps may do
        above = [option for option in options if self._floor(option.n_steps) <= self.tolerance]
        ranked = sorted(above or options, key=lambda option: option.seconds)
        best = ranked[0]
        own = [option for option in options if option.candidate is current]
        chosen = own[0] if own and best.seconds > BETTER * own[0].seconds else best
        self._why = _comparison(chosen, ranked)
        return chosen

    def option(self, candidate: Candidate) -> _Next | None:
        """How far this candidate would have to go, and what that would take; None: too much."""
        if candidate.method in self._exhausted:
            return None
        n = self._least(candidate)
        latest = self._latest.get(candidate.method)
        if latest is not None:
            n = max(n, 2 * latest[0])
        final_time = self.scene.final_time
        while candidate.predicted(n, final_time) > MARGIN * self.tolerance or (
            n <= MOST_STEPS and self._is_unstable(candidate.method, n // 2)
        ):
            if self._is_worth_a_try(candidate, n):
                break
            n *= 2
            if n > MOST_STEPS:
                return None
        if n > MOST_STEPS or not self._has_room(candidate.method, n):
            return None
        first = latest[0] * 2 if latest is not None and candidate.differences else n // 2
        runs = (n // first).bit_length()
        seconds = runs * planned_seconds(self.scene, candidate.method, n)
        return _Next(candidate=candidate, n_steps=n, seconds=seconds)

    def _is_worth_a_try(self, candidate: Candidate, n_steps: int) -> bool:
        """Whether more steps would drown in round-off, and only a guess asks for them."""
        if candidate.differences or self._floor(2 * n_steps) <= self.tolerance:
            return False
        guess = candidate.predicted(n_steps, self.scene.final_time)
        return self._floor(n_steps) <= self.tolerance and guess < FAR_OFF * self.tolerance

    def _is_unstable(self, method: AnyMethod, n_steps: int) -> bool:
        """Whether a run is predicted to blow up; Gauss methods feed no mode of any scene."""
        if self.allow_unstable or getattr(method, "cq", "") == "gauss":
            return False
        return predict_stability(self.scene, method, n_steps).verdict == "unstable"

    def _has_room(self, method: AnyMethod, n_steps: int) -> bool:
        if self.available_bytes is None:
            return True
        return planned_bytes(self.scene, method, n_steps) <= self.available_bytes

    def _run(self, candidate: Candidate, n_steps: int) -> Trajectory:
        """Run, and compare with the run on half as many steps if that was the last one."""
        method = candidate.method
        began = time.perf_counter()
        trajectory = integrate(self.scene, method, n_steps)
        seconds = time.perf_counter() - began
        before = self._latest.get(method)
        line = f"{method.case} N = {n_steps}: {seconds:.2g} s"
        if before is not None and 2 * before[0] == n_steps:
            difference = difference_norm(trajectory, before[1], self.norm)
            candidate.differences[n_steps] = difference
            line += f", {difference:.2g} from N = {before[0]}"
        if trajectory.status == "ok":
            self.scale = max(self.scale, float(np.abs(trajectory.position).max()))
        else:
            line += f", {trajectory.status}"
        self._latest[method] = (n_steps, trajectory)
        self._last = candidate
        self.attempts.append(line)
        self.tell(line)
        return trajectory

    def _spread(self, candidates: Sequence[Candidate], measured: Candidate) -> None:
        """Correct all guesses by what was measured of one."""
        n_steps, _ = self._latest[measured.method]
        found = measured.correction(n_steps, self.scene.final_time)
        for candidate in candidates:
            candidate.correct(*found)

    def _stands_still(self, candidate: Candidate, n_steps: int) -> bool:
        """Whether doubling has not helped: twice where little is left, four times otherwise."""
        differences = [candidate.differences.get(n_steps >> k, math.inf) for k in range(5)]
        if not math.isfinite(differences[0]):
            return False
        pairs = list(itertools.pairwise(differences))
        if any(a > GREW * b for a, b in pairs[:2]):
            # a motion that is not resolved yet is new with every doubling
            return False
        fallen = [a < STILL * b for a, b in pairs]
        few = differences[0] < 1e-6 * self.scale
        return not any(fallen[:2] if few else fallen) and all(
            map(math.isfinite, differences[: 3 if few else 5])
        )

    def _accepted(
        self, candidate: Candidate, n: int, trajectory: Trajectory, estimate: float
    ) -> Reached:
        runs = len(self.attempts)
        message = (
            f"{candidate.method.case} on N = {n} steps{self._why}: estimated error "
            f"{estimate:.2g} (N against N/2) for a tolerance of {self.tolerance:g}, after "
            f"{runs} runs"
        )
        return Reached(
            method=candidate.method,
            n_steps=n,
            trajectory=trajectory,
            estimate=estimate,
            verdict="ok",
            message=message,
            attempts=tuple(self.attempts),
        )

    def _refused(self, candidate: Candidate, n_steps: int, message: str) -> Reached:
        latest = self._latest.get(candidate.method)
        finite = [e for n in candidate.differences if math.isfinite(e := candidate.estimate(n))]
        return Reached(
            method=candidate.method,
            n_steps=n_steps or (latest[0] if latest else max(1, self.base)),
            trajectory=None if latest is None else latest[1],
            estimate=min(finite, default=math.nan),
            verdict="refused",
            message=f"tolerance {self.tolerance:g}: {message}",
            attempts=tuple(self.attempts),
        )

    def _below_floor(self, n_steps: int) -> str:
        return f"below the floor {self._floor(n_steps):.2g} of round-off on N = {n_steps} steps"

    def _no_further(self, candidate: Candidate, n_steps: int) -> str:
        return (
            f"below the floor {candidate.differences[n_steps]:.2g}: more steps than N = {n_steps} "
            f"of {candidate.method.case} change the position no less"
        )

    def _why_not(self) -> str:
        """Why every method is out: what stopped the first one, or that they would need too much."""
        for reason in self._exhausted.values():
            return reason
        words = f"no method is predicted to reach it in {MOST_STEPS} steps and the memory there is"
        return f"{words}; {self.resolution.reason}" if self.resolution.reason else words
