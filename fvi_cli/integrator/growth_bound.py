"""When a run is far outside of anything that its scene can do."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.stability import RESOLVED, exact_growth
from fvi_cli.integrator.stability_determinant import independent_systems
from fvi_cli.integrator.stepping import Stepped, StepProblem

Array = NDArray[np.float64]

TOLERATED_FACTOR = 1e8
"""How far a position may go beyond what start values and forces move in the time of the run."""


@dataclass(frozen=True, kw_only=True)
class GrowthBound:
    r"""The bound :math:`|x(t)| \le C e^{\sigma t}` that no sound run leaves.

    Parameters
    ----------
    size
        C: 1e8 times the sum of start position, way at the start velocity and way under the
        largest force; infinite for a scene that nothing moves.
    rate
        The growth of the exact linear scene and a quarter more; 0 for a nonlinear one.
    """

    size: float
    rate: float

    def at(self, time: Array) -> Array:
        """The bound at each time."""
        with np.errstate(over="ignore"):
            return np.asarray(self.size * np.exp(self.rate * time))


def growth_bound(problem: StepProblem) -> GrowthBound:
    """The bound of the run that `problem` describes."""
    scene, h = problem.scene, problem.step_size
    final_time = scene.final_time
    way = final_time * np.abs(np.linalg.solve(scene.inertia.mass, problem.momentum)).max()
    force = 0.0
    if problem.moments is not None:
        force += float(np.abs(problem.moments.sum(axis=1)).max()) / h
    for known in (problem.memory.known_force, problem.extra_force):
        if known is not None:
            force += float(np.abs(known).max())
    moved = final_time**2 * force * float(np.linalg.norm(np.linalg.inv(scene.inertia.mass), 2))
    scale = float(np.abs(problem.position).max() + way + moved)
    rate = 0.0
    if scene.is_linear:
        # a mode may grow that much faster and still be the truth, not resolved well
        rate = (1.0 + RESOLVED) * max(
            exact_growth(part, final_time, h) for part in independent_systems(scene)
        )
    size = TOLERATED_FACTOR * scale
    return GrowthBound(size=size if 0 < size < math.inf else math.inf, rate=rate)


def cut_at_bound(problem: StepProblem, stepped: Stepped, bound: GrowthBound) -> Stepped:
    """What was finished up to the first position outside of `bound`; all of it without one."""
    n = stepped.position.shape[0]
    time = problem.step_size * np.arange(n, dtype=float)
    with np.errstate(invalid="ignore"):
        outside = np.abs(stepped.position).max(axis=1) > bound.at(time)
    if not outside.any():
        return stepped
    first = int(outside.argmax())
    return replace(
        stepped,
        position=stepped.position[: first + 1],
        momentum=stepped.momentum[: first + 1],
        samples=stepped.samples[:first],
        end_force=stepped.end_force[: first + 1],
        failure=(
            f"diverged: |x| = {np.abs(stepped.position[first]).max():.3g} after step {first - 1}, "
            f"t = {time[first]:.6g}, is {TOLERATED_FACTOR:.0e} times beyond what the scene can do"
        ),
    )
