"""What errors are measured against: an exact solution, or a refined run that states its error."""

from __future__ import annotations

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
        Function of the times of a grid, shape ``(n,)`` to ``(n, d)``.
    error
        Estimated error of the values in the maximum norm; 0 for an exact solution.
    source
        What the reader of a table is told.
    """

    values: Callable[[Array], Array]
    error: float
    source: str


def find_reference(problem: Problem | DerivativeProblem, steps: tuple[int, ...]) -> Reference:
    """The exact solution where it is known, otherwise a refined run.

    The refined run is made by the Gauss method of degree 4 with a start series on a grid that
    contains all grids of the ladder; it is doubled until two runs agree to 2e-14 of the largest
    value, or further than that no more, or N reaches 16384. The difference of the last two is
    stated as its error, although the finer one, which is used, is usually much better.

    Raises
    ------
    ValueError
        If the grids of the ladder have no common refinement below 16384 steps, or no refined
        run reaches the end.
    """
    if problem.exact is not None:
        return Reference(values=problem.exact, error=0.0, source=problem.exact_source)
    if isinstance(problem, DerivativeProblem):  # pragma: no cover - always brings its own
        raise ValueError("exact: a fractional derivative needs its exact value")
    return _refined(problem.scene, steps)


def _refined(scene: Scene, steps: tuple[int, ...]) -> Reference:
    common = math.lcm(*steps)
    if common > MOST_STEPS:
        raise ValueError(
            f"exact: no exact solution is known, and the smallest grid that contains all of "
            f"{list(steps)} has {common} steps, more than {MOST_STEPS}; give `exact` as an "
            "expression, or a ladder of powers of two times one number"
        )
    n_steps = common * max(1, math.ceil(LEAST_STEPS / common))
    coarse = _run(scene, n_steps)
    best: tuple[float, int, Array] | None = None
    while 2 * n_steps <= max(MOST_STEPS, 2 * common):
        fine = _run(scene, 2 * n_steps)
        difference = float(np.abs(fine[::2] - coarse).max())
        if best is not None and difference >= best[0]:
            break
        best = (difference, 2 * n_steps, fine)
        if difference <= SUFFICIENT * float(np.abs(fine).max()):
            break
        n_steps, coarse = 2 * n_steps, fine
    if best is None:  # pragma: no cover - the loop runs at least once
        raise ValueError("exact: no refined run was made")
    error, finest, values = best

    def at(times: Array) -> Array:
        index = np.rint(times / scene.final_time * finest).astype(int)
        return np.asarray(values[index])

    source = f"refined run ({REFERENCE_METHOD.case}, N = {finest}, estimated error {error:.1e})"
    return Reference(values=at, error=error, source=source)


def _run(scene: Scene, n_steps: int) -> Array:
    trajectory = integrate(scene, REFERENCE_METHOD, n_steps)
    if trajectory.status != "ok":
        raise ValueError(f"exact: the refined reference {trajectory.status}: {trajectory.message}")
    return trajectory.position
