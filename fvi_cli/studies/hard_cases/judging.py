"""How trajectories are judged: against exact solutions, by energies, and against one another."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.linear_response import match_scene
from fvi_cli.studies.hard_cases.case import Claim, Setting

Judge = Callable[..., float]

LAPLACE = "residues and branch-cut integral of the Laplace transform"


@functools.lru_cache(maxsize=512)
def exact_positions(setting: Setting) -> Array:
    """The exact solution on the grid, by closed form or inversion of the Laplace transform.

    Raises
    ------
    ValueError
        If none is known.
    """
    solution = match_scene(setting.scene)
    if solution is None:
        raise ValueError("hard case: no exact solution of this scene is known")
    step_size = setting.scene.final_time / setting.n_steps
    return solution.position(step_size * np.arange(setting.n_steps + 1, dtype=float))


def largest_ratio(difference: Array, scale: Array) -> float:
    """The largest absolute value of one over that of the other."""
    return float(np.abs(difference).max() / np.abs(scale).max())


def accurate(quantity: str, limit: float, *settings: Setting) -> Claim:
    """The claim that errors on the grid over the largest exact position are at most `limit`."""

    def judge(*trajectories: Trajectory) -> float:
        found = zip(map(exact_positions, settings), trajectories, strict=True)
        return max(largest_ratio(run.position - exact, exact) for exact, run in found)

    return Claim(quantity, limit, settings, judge)


def against(
    quantity: str,
    limit: float,
    setting: Setting,
    exact: Callable[[Array], Array],
    *,
    parts: int | None = None,
) -> Claim:
    """The same against a function of the time, on the grid or at the ends of parts of it."""

    def judge(trajectory: Trajectory) -> float:
        last = trajectory.time.size - 1
        shown = last * np.arange((parts or last) + 1) // (parts or last)
        known = exact(trajectory.time[shown])
        return largest_ratio(trajectory.position[shown, 0] - known, known)

    return Claim(quantity, limit, (setting,), judge)


def largest_energy(*trajectories: Trajectory) -> float:
    """The largest energy on the way over that at the start, in excess of 1."""
    excess = []
    for trajectory in trajectories:
        if trajectory.energy is None:
            raise ValueError("hard case: a trajectory without energy cannot be judged by it")
        excess.append(float(trajectory.energy.max() / trajectory.energy[0] - 1.0))
    return max(excess)
