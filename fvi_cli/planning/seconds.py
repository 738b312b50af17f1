"""How long a job will take: short runs of the very job, and how more steps of it grow dearer."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.mesh import graded_mesh
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.observations.observe import integrate_requested
from fvi_cli.integrator.observations.request import Observations
from fvi_cli.integrator.run.on_mesh import AnySteps

FIRST_STEPS, LONGER = 16, 4
"""Steps of the first short run, and how many times longer each other one is (guessed)."""
USUAL_BLOCKS = 1024
"""Steps from which on blocks are as long as in longer runs, or nearly."""
ENOUGH_SECONDS, MOST_SECONDS, TABLES_SECONDS = 0.1, 1.0, 3.0
"""No longer run is tried behind one that took so long, on so many steps, on fewer, and behind one
that made tables (guessed)."""
NOISY_SECONDS, REPEATED = 0.01, 3
"""Shorter runs are done so often, the least time counts (guessed)."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Seconds that runs of increasing numbers of steps took."""

    n_steps: tuple[int, ...]
    seconds: tuple[float, ...]
    is_quadratic: bool  # whether every step sums over all before it

    def at(self, n_steps: int) -> float:
        """Seconds of so many steps: between measured runs, or as the last of them go on."""
        sizes, taken = np.array(self.n_steps, dtype=float), np.maximum.accumulate(self.seconds)
        if n_steps <= sizes[-1] or sizes.size == 1:
            return float(np.interp(n_steps, sizes, taken) * max(1.0, n_steps / sizes[-1]))
        slopes = np.diff(taken) / np.diff(sizes)
        ahead = n_steps - sizes[-1]
        found = taken[-1] + slopes[-1] * ahead
        if self.is_quadratic and slopes.size > 1:
            rise = (slopes[-1] - slopes[-2]) / (sizes[-1] - sizes[-3])
            found += max(rise, 0.0) * ahead * (n_steps - sizes[-2])
        return float(found)


def time_runs(
    run: Callable[[int], object],
    n_steps: int,
    *,
    n_runs: int = 1,
    is_quadratic: bool,
    clock: Callable[[], float] = time.perf_counter,
) -> Timing:
    """Run few steps and more, up to `n_steps` or until a run takes long enough.

    Seconds are those of one of `n_runs` members. The first one is done twice: what it prepares
    for all others is left out.
    """
    sizes: list[int] = []
    taken: list[float] = []
    size, most = min(FIRST_STEPS, n_steps), MOST_SECONDS

    def timed() -> float:
        began = clock()
        run(size)
        return clock() - began

    run(size)
    while not sizes or (sizes[-1] < n_steps and (len(sizes) < 2 or taken[-1] < most)):
        least = timed()
        if least < NOISY_SECONDS:
            least = min(least, *(timed() for _ in range(REPEATED - 1)))
        sizes.append(size)
        taken.append(least)
        most = MOST_SECONDS if size < USUAL_BLOCKS else ENOUGH_SECONDS
        if len(taken) > 1 and taken[-1] > LONGER**2 * taken[-2]:
            # more than the square of its steps: it made tables that longer runs have as well
            most = TABLES_SECONDS
        size = min(LONGER * size, n_steps)
    each = tuple(one / n_runs for one in taken)
    return Timing(n_steps=tuple(sizes), seconds=each, is_quadratic=is_quadratic)


def short_job(
    scenes: Sequence[Scene],
    method: AnyMethod,
    n_steps: int,
    *,
    observations: Sequence[Observations],
    every: int = 1,
    diagnostics: DiagnosticsRequest = NO_DIAGNOSTICS,
    grading: float = 1.0,
) -> Callable[[int], object]:
    """The first steps of a run, or of a batch of members, with all its requested outputs.

    Steps have the size of the whole job; those of graded meshes go to the end of the motion.
    """

    def run(short: int) -> object:
        own, steps = scenes, list[AnySteps]([short] * len(scenes))
        if grading == 1.0:
            share = short / n_steps
            own = [replace(one, final_time=share * one.final_time) for one in scenes]
        else:
            steps = [
                graded_mesh(one.final_time, short, grading, one.break_points) for one in scenes
            ]
        requests = [_until(one, own[0].final_time) for one in observations]
        return integrate_requested(
            own, method, steps, requests, every=every, diagnostics=diagnostics
        )

    return run


def _until(request: Observations, final_time: float) -> Observations:
    if request.times is None:
        return request
    times = request.times[request.times <= final_time]
    return replace(request, times=times if times.size else np.array([final_time]))
