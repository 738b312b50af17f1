"""Steps that are chosen during the run: what is asked for, and the shortest and the first."""

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


def first_step(scene: Scene) -> float:
    """First step after the start and after every break point."""
    is_smooth = not scene.break_points and start_power(scene, at_start=True) is None
    ends = 0.0, *scene.break_points, scene.final_time
    shortest_part = min(b - a for a, b in itertools.pairwise(ends))
    first = (SMOOTH_FIRST_STEP if is_smooth else FIRST_STEP) * scene.final_time
    return min(first, 0.1 * shortest_part)


def shortest_step(scene: Scene) -> float:
    """Shortest step of adaptive runs."""
    return min(SHORTEST_STEP * scene.final_time, first_step(scene))
