"""How trajectories are judged: against exact solutions, by energies, and against one another."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

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


def relative_error(setting: Setting) -> Judge:
    """Largest error on the grid over the largest exact position."""

    def judge(trajectory: Trajectory) -> float:
        exact = exact_positions(setting)
        return largest_ratio(trajectory.position - exact, exact)

    return judge


def largest_ratio(difference: Array, scale: Array) -> float:
    """The largest absolute value of one over that of the other."""
    return float(np.abs(difference).max() / np.abs(scale).max())


def accurate(quantity: str, limit: float, setting: Setting) -> Claim:
    """The claim that the relative error against the exact solution is at most `limit`."""
    return Claim(quantity, limit, (setting,), relative_error(setting))


def largest_accurate(quantity: str, limit: float, settings: Sequence[Setting]) -> Claim:
    """The same of the largest error in several settings."""
    judges = [relative_error(setting) for setting in settings]

    def judge(*trajectories: Trajectory) -> float:
        return max(one(run) for one, run in zip(judges, trajectories, strict=True))

    return Claim(quantity, limit, settings, judge)


def largest_energy(*trajectories: Trajectory) -> float:
    """The largest energy on the way over that at the start, in excess of 1."""
    excess = []
    for trajectory in trajectories:
        if trajectory.energy is None:
            raise ValueError("hard case: a trajectory without energy cannot be judged by it")
        excess.append(float(trajectory.energy.max() / trajectory.energy[0] - 1.0))
    return max(excess)
