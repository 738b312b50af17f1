"""What errors are measured against: an exact solution, or a refined run that states its error."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.problem import DerivativeProblem, Problem

Array = NDArray[np.float64]

REFERENCE_METHOD = Method(cq="gauss", degree=4, start="series")
LEAST_STEPS = 256
MOST_STEPS = 2**14
SUFFICIENT = 2e-14


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """Values to compare with on the grids of a ladder.

    Parameters
    ----------
    values
        Function of the times of a grid, shape ``(n,)`` to ``(n, d)``; nan where nothing is known.
    error
        Estimated error of the values in the maximum norm; 0 for an exact solution, nan where
        nothing is known.
    source
        What the reader of a table is told.
    """

    values: Callable[[Array], Array]
    error: float
    source: str

    @property
    def is_known(self) -> bool:
        """Whether there is anything to compare with."""
        return not math.isnan(self.error)


def find_reference(problem: Problem | DerivativeProblem, steps: tuple[int, ...]) -> Reference:
    """The exact solution where it is known, otherwise a refined run.

    The refined run is made by the Gauss method of degree 4 with a start series on a grid that
    contains all grids of the ladder; it is doubled until two runs agree to 2e-14 of the largest
    value, or further than that no more, or N reaches 16384. The difference of the last two is
    stated as its error, although the finer one, which is used, is usually much better. Where the
    smallest common grid is larger than that, every grid gets a refinement of its own.

    A refined run that does not reach the end leaves nothing to compare with; the source says why.
    """
    if problem.exact is not None:
        return Reference(values=problem.exact, error=0.0, source=problem.exact_source)
    if isinstance(problem, DerivativeProblem):  # pragma: no cover - always brings its own
        raise ValueError("exact: a fractional derivative needs its exact value")
    try:
        return _refined(problem.scene, steps)
    except _ReferenceFailedError as failure:
        dimension = problem.scene.dimension
        return Reference(
            values=lambda times: np.full((times.size, dimension), np.nan),
            error=math.nan,
            source=f"none (no exact solution is known, and {failure})",
        )


class _ReferenceFailedError(Exception):
    """A refined run that did not reach the end."""


def _refined(scene: Scene, steps: tuple[int, ...]) -> Reference:
    common = math.lcm(*steps)
    base = common if common <= MOST_STEPS else min(steps)
    finest, values, error = _doubled(scene, base)
    source = f"refined run ({REFERENCE_METHOD.case}, N = {finest}, estimated error {error:.1e})"
    if common <= MOST_STEPS:
        return Reference(values=lambda t: _picked(scene, t, values), error=error, source=source)

    @functools.lru_cache(maxsize=len(steps))
    def refinement(n_steps: int) -> Array:
        return _run(scene, n_steps * max(2, math.ceil(finest / n_steps)))

    for n_steps in steps:
        refinement(n_steps)

    def at(times: Array) -> Array:
        places = times / scene.final_time
        own = next(n for n in steps if np.abs(places * n - np.rint(places * n)).max() < 1e-6)
        return _picked(scene, times, refinement(own))

    source = (
        f"refined runs ({REFERENCE_METHOD.case}, N >= {finest} for every grid of its own, "
        f"estimated error {error:.1e})"
    )
    return Reference(values=at, error=error, source=source)


def _doubled(scene: Scene, base: int) -> tuple[int, Array, float]:
    """N, positions and estimated error of a run on multiples of `base`, doubled while it pays."""
    n_steps = base * max(1, math.ceil(LEAST_STEPS / base))
    coarse = _run(scene, n_steps)
    error, finest, values = math.inf, n_steps, coarse
    while 2 * n_steps <= max(MOST_STEPS, 2 * base):
        fine = _run(scene, 2 * n_steps)
        difference = float(np.abs(fine[::2] - coarse).max())
        if difference >= error:
            break
        error, finest, values = difference, 2 * n_steps, fine
        if difference <= SUFFICIENT * float(np.abs(fine).max()):
            break
        n_steps, coarse = 2 * n_steps, fine
    return finest, values, error


def _picked(scene: Scene, times: Array, values: Array) -> Array:
    """The values of a fine grid at the times of a coarse one."""
    index = np.rint(times / scene.final_time * (values.shape[0] - 1)).astype(int)
    return np.asarray(values[index])


def _run(scene: Scene, n_steps: int) -> Array:
    trajectory = integrate(scene, REFERENCE_METHOD, n_steps)
    if trajectory.status != "ok":
        raise _ReferenceFailedError(f"the refined run {trajectory.status}: {trajectory.message}")
    return trajectory.position
