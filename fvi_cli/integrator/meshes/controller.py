"""Steps that are chosen during the run, by the local error."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.graded import start_power

FIRST_STEP = 1e-7
"""First step of a stretch on which the motion begins like a power of t, relative to T."""
SMOOTH_FIRST_STEP = 1e-3
"""First step where the motion is smooth, relative to T; it is rejected if it is too long."""
SHORTEST_STEP = 1e-11
"""Steps are never shorter than this, relative to T, but for parts that are."""
MOST_SHORTEST = 256.0
"""Bound on ``shortest_step * sum(1 / h_n)`` of an adaptive run, for which its memory is chosen."""
STEPS_PER_OCTAVE = 4
"""Step sizes are powers of the fourth root of 2, so that the tables of a size are used again."""
SAFETY, SHRINKAGE, GROWTH = 0.9, 0.2, 32.0
"""The next size is 0.9 of the one that the estimate allows, 0.2 to 32 times the last one.

Five small problems at four tolerances take 465 steps, rejected ones included; safety .8 to .95 and
growth 8 to 1,000 take 463 to 513."""
ROUND_OFF = 1e-14
"""Relative to the position; no step is rejected for a smaller error."""


@dataclass(frozen=True, kw_only=True)
class AdaptiveSteps:
    r"""Steps that are chosen for a tolerance.

    A step is accepted if its error est is at most the tolerance: what the Legendre coefficients of
    its velocity leave out, what shows between its stages
    (:mod:`~fvi_cli.integrator.meshes.local_error`) and what two looks find between those points
    (:mod:`~fvi_cli.integrator.meshes.looks`). The next size is
    :math:`0.9\, h\, (tol / est)^{1/(m+1)}`, at most 32 times as long. Break points and samples
    of a force are points of the mesh.

    Parameters
    ----------
    tolerance
        Local tolerance, in the unit of length of the scene. The error of the whole run is
        usually far smaller, see ``docs/explanation/mathematics.md``.
    most_steps
        A run with more steps than this fails.
    may_miss
        How far a force that no point of a step sees may move the scene until its end, a length;
        no more than the tolerance.
    max_step
        Longest step, in the unit of time.

    Raises
    ------
    ValueError
        For a tolerance or a step that is not positive.
    """

    tolerance: float
    most_steps: int = 10**7
    may_miss: float = math.inf
    max_step: float = math.inf

    def __post_init__(self) -> None:
        for name in ("tolerance", "max_step", "most_steps"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: {getattr(self, name)!r} is not allowed; it must be > 0")


class StepController:
    """Sizes of successive steps of one run by a method of m stages.

    Break points are points of the mesh; a motion that is singular begins like a fractional power
    of t there, and at 0. So are samples of the force, where it is continuous.
    """

    def __init__(self, steps: AdaptiveSteps, scene: Scene, stages: int) -> None:
        self._tolerance, self._exponent = steps.tolerance, 1.0 / (stages + 1)
        self._final_time = final_time = scene.final_time
        self._breaks = {*scene.break_points, final_time}
        samples = () if scene.forcing is None else scene.forcing.samples
        knots = {float(t) for one in samples for t in one.knots if 0.0 < t < final_time}
        self._ends = sorted(self._breaks | knots)
        is_smooth = not scene.break_points and start_power(scene, at_start=True) is None
        shortest_part = min(b - a for a, b in itertools.pairwise([0.0, *sorted(self._breaks)]))
        first = (SMOOTH_FIRST_STEP if is_smooth else FIRST_STEP) * final_time
        self._first, self._longest = min(first, 0.1 * shortest_part), steps.max_step
        self.shortest_step = min(SHORTEST_STEP * final_time, self._first)
        self._size = self._intended = self._first
        # where the next step begins, and whether that is the start or a break point
        self.time, self.is_fresh = 0.0, True
        self.rejected = 0  # number of rejected steps
        self.is_stuck = False  # not even a step of the shortest size could be solved

    @property
    def is_finished(self) -> bool:
        """Whether the end of the run is reached."""
        return not self._ends

    def propose(self) -> float:
        """Size of the next step to try."""
        left = self._ends[0] - self.time
        octaves = math.log2(min(self._size, self._longest) / self._final_time)
        octaves = math.floor(STEPS_PER_OCTAVE * octaves) / STEPS_PER_OCTAVE
        size = self._intended = self._final_time * 2.0**octaves
        return left if size >= left * (1 - 1e-12) else min(size, 0.5 * left)

    def tolerance_for(self, scale: float) -> float:
        """Local tolerance for positions of this size, a length."""
        return max(self._tolerance, ROUND_OFF * scale)

    def judge(self, size: float, estimate: float, scale: float = 0.0) -> bool:
        """Whether a step with this estimate of its error is accepted; sets the next size.

        The estimate is infinite if the step could not be solved; below :data:`ROUND_OFF` times
        `scale`, the size of the position, it does not count. A step of the shortest size is
        accepted if it could be solved.
        """
        tolerance, is_solved = self.tolerance_for(scale), math.isfinite(estimate)
        factor = (tolerance / max(estimate, 1e-300)) ** self._exponent if is_solved else 0.0
        is_accepted = is_solved and (estimate <= tolerance or size <= self.shortest_step)
        self._size = size * min(GROWTH, max(SHRINKAGE, SAFETY * factor))
        if not is_accepted:
            self.rejected += 1
            self.is_stuck = size <= self.shortest_step
            self._size = max(self._size, self.shortest_step)
            return False
        self.is_fresh = False
        if size < self._ends[0] - self.time:
            self.time += size
            return True
        # a step that was cut short at a point says little about the size that is possible
        self._size = max(self._size, self._intended)
        self.time = self._ends.pop(0)
        if self.time in self._breaks:
            self.is_fresh, self._size = True, self._first
        return True
