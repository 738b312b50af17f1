"""Steps that are chosen during the run, by the local error."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

from fvi_cli.integrator.meshes.samples import ForceSamples

FIRST_STEP = 1e-7
"""First step of a stretch on which the motion begins like a power of t, relative to T."""
SMOOTH_FIRST_STEP = 1e-3
"""First step where the motion is smooth, relative to T; it is rejected if it is too long."""
SHORTEST_STEP = 1e-11
"""Steps are never shorter than this, relative to T."""
STEPS_PER_OCTAVE = 4
"""Step sizes are powers of the fourth root of 2, so that the tables of a size are used again."""
GROWTH = 8.0
SHRINKAGE = 0.3
REJECTED_SHRINKAGE = 0.2
SAFETY = 0.85
UNSOLVED = 0.25  # in place of the ratio by the error, for a step without a solution
ROUND_OFF = 1e-14
"""Relative to the position; no step is rejected for a smaller error."""


@dataclass(frozen=True, kw_only=True)
class AdaptiveSteps:
    r"""Steps that are chosen for a tolerance.

    A step is accepted if its error est is at most the tolerance: what the Legendre coefficients of
    its velocity leave out, what shows between its stages
    (:mod:`~fvi_cli.integrator.local_error.defect`) and what two looks find between those
    points (:mod:`~fvi_cli.integrator.local_error.looks`). The next size is
    :math:`0.85\, h\, (tol / est)^{1/(m+1)}`, at most eight times as long; while steps grow, the
    order m + 1 is that which successive estimates show, but not less than half of it.

    Parameters
    ----------
    tolerance
        Local tolerance, in the unit of length of the scene. The error of the whole run is
        usually far smaller, see ``docs/explanation/mathematics.md``.
    first_step
        In the unit of time; None: 1e-7 T where the start is singular, 1e-3 T elsewhere.
    most_steps
        A run with more steps than this fails.
    points
        Further points of the mesh, ascending, where a force is less smooth than elsewhere.
    may_miss
        How far a force that no point of a step sees may move the scene until its end, a length;
        no more than the tolerance.
    max_step
        Longest step, in the unit of time.
    samples
        Samples of the formulas of the force; None: they are taken by each run that needs them.

    Raises
    ------
    ValueError
        For a tolerance or a step that is not positive.
    """

    tolerance: float
    first_step: float | None = None
    most_steps: int = 10**7
    points: tuple[float, ...] = ()
    may_miss: float = math.inf
    max_step: float = math.inf
    samples: ForceSamples | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("tolerance", "first_step"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise ValueError(f"{name}: {value!r} is not allowed; it must be positive")
        if not self.max_step > 0:
            raise ValueError(f"max_step: {self.max_step!r} is not allowed; it must be positive")
        if self.most_steps < 1:
            raise ValueError(f"most_steps: {self.most_steps} is not allowed; it must be positive")


class StepController:
    """Sizes of successive steps of one run.

    Each break point inside (0, T) becomes a point of the mesh. A motion that is singular begins
    like a fractional power of t, at 0 and after break points.
    """

    def __init__(
        self,
        steps: AdaptiveSteps,
        *,
        final_time: float,
        breaks: tuple[float, ...],
        stages: int,
        is_singular: bool,
    ) -> None:
        self._tolerance, self._exponent = steps.tolerance, 1.0 / (stages + 1)
        self._breaks = {*breaks, final_time}
        inside = {one for one in steps.points if 0 < one < final_time}
        self._ends = sorted(self._breaks | inside)
        self._final_time = final_time
        relative = FIRST_STEP if is_singular else SMOOTH_FIRST_STEP
        self._first = steps.first_step or relative * final_time
        lengths = [b - a for a, b in itertools.pairwise([0.0, *sorted(self._breaks)])]
        self._first = min(self._first, 0.1 * min(lengths), steps.max_step)
        self._longest = steps.max_step
        self.shortest_step = min(SHORTEST_STEP * final_time, 1e-2 * self._first)
        self._size = self._first
        self._before = math.inf, 0.0  # size and estimate of the step before; none: it is fresh
        self._intended = self._first
        # where the next step begins, and whether that is the start or a break point
        self.time, self.is_fresh = 0.0, True
        self.rejected = 0  # number of rejected steps
        self.is_stuck = False  # not even a step of the shortest size could be solved
        self._reaches_end = False

    @property
    def is_finished(self) -> bool:
        """Whether the end of the run is reached."""
        return not self._ends

    def propose(self) -> float:
        """Size of the next step to try."""
        left = self._ends[0] - self.time
        size = self._intended = self._rounded(min(self._size, self._longest))
        self._reaches_end = size >= left * (1 - 1e-12)
        if self._reaches_end:
            return left
        if 2 * size > left:
            return 0.5 * left
        return size

    def tolerance_for(self, scale: float) -> float:
        """Local tolerance for positions of this size, a length."""
        return max(self._tolerance, ROUND_OFF * scale)

    def _rounded(self, size: float) -> float:
        ratio = math.log2(size / self._final_time)
        return float(
            self._final_time * 2.0 ** (math.floor(STEPS_PER_OCTAVE * ratio) / STEPS_PER_OCTAVE)
        )

    def judge(self, size: float, estimate: float, scale: float = 0.0) -> bool:
        """Whether a step with this estimate of its error is accepted; sets the next size.

        The estimate is infinite if the step could not be solved; below :data:`ROUND_OFF` times
        `scale`, the size of the position, it does not count. A step of the shortest size is
        accepted if it could be solved.
        """
        solved = math.isfinite(estimate)
        tolerance = self.tolerance_for(scale)
        factor = (tolerance / max(estimate, 1e-300)) ** self._exponent if solved else UNSOLVED
        if solved and (estimate <= tolerance or size <= self.shortest_step):
            at_end = self._reaches_end
            self.time = self._ends[0] if at_end else self.time + size
            # steps that grow behind a singular point err by the power with which the motion begins;
            # half of the order is left to the points, whose error is like the square of this one
            shorter, less = self._before
            if size >= 2 * shorter and less > 0 and estimate < tolerance:
                seen = math.log(max(estimate, less) / less, size / shorter)
                factor **= min(2.0, max(1.0, 1.0 / (self._exponent * max(seen, 1e-300))))
            self._before = size, estimate
            self._size = size * min(GROWTH, max(SHRINKAGE, SAFETY * factor))
            self.is_fresh = at_end and self._ends.pop(0) in self._breaks
            if at_end:
                # a step that was cut short at a point says little about the size that is possible
                self._size = max(self._size, self._intended)
            if self.is_fresh:
                self._size, self._before = self._first, (math.inf, 0.0)
            return True
        self.rejected += 1
        if size <= self.shortest_step:
            self.is_stuck = True
        shorter = size * max(REJECTED_SHRINKAGE, min(0.7, 0.8 * factor))
        self._size = max(shorter, self.shortest_step)
        return False
