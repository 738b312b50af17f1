"""The time that a job will take, from timing its beginning and the extra cost of its outputs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.advance import on_progress
from fvi_cli.integrator.meshes.mesh import graded_mesh
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.observations.impacts.run import integrate_with_impacts
from fvi_cli.integrator.observations.observe import integrate_requested
from fvi_cli.integrator.observations.request import Observations
from fvi_cli.integrator.run.on_mesh import AnySteps

FIRST_STEPS = 16
"""Steps of the warm-up run, which imports modules and makes shared tables, and least steps of the
timed beginning of a job (guessed)."""
MOST_SECONDS, MOST_WITH_IMPACTS = 0.5, 2.0
"""Time after which the timed beginning is stopped; longer with impacts, which may come late
(guessed)."""
PATIENCE = 4.0
"""After so many times that time a job is stopped even if it has made too few steps (guessed)."""
AGAIN_SECONDS = 0.125
"""Time for steps that are computed twice more, with and without all outputs (guessed)."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Numbers of finished steps over time, and the extra cost of outputs."""

    n_steps: tuple[int, ...]  # increasing, up to the stop or the end of the run
    seconds: tuple[float, ...]
    is_quadratic: bool  # whether every step sums over all earlier steps
    multiple: float = 1.0  # seconds with all outputs over seconds without outputs

    def at(self, n_steps: int) -> float:
        """Seconds of `n_steps` steps: interpolated, or extrapolated from the second half."""
        sizes, taken = np.array(self.n_steps, dtype=float), np.array(self.seconds)
        ahead = n_steps - sizes[-1]
        if ahead <= 0.0 or sizes.size == 1:
            found = np.interp(n_steps, sizes, taken) * max(1.0, n_steps / sizes[-1])
            return float(self.multiple * found)
        middle = sizes[0] + (sizes[-1] - sizes[0]) / 2.0
        ends = np.array([sizes[0], middle, sizes[-1]])
        slopes = np.diff(np.interp(ends, sizes, taken)) / np.diff(ends)
        found = taken[-1] + slopes[-1] * ahead
        if self.is_quadratic:
            rise = (slopes[1] - slopes[0]) / (ends[2] - ends[0])
            found += max(rise, 0.0) * ahead * (n_steps - middle)
        return float(self.multiple * found)


ShortJob = Callable[[int, bool], object]
"""Computes so many steps, with all requested outputs (True) or without outputs."""


class _EnoughError(Exception):
    """Stops a run that was measured for long enough."""


def time_job(
    run: ShortJob,
    n_steps: int,
    *,
    n_runs: int = 1,
    is_quadratic: bool = False,
    most_seconds: float = MOST_SECONDS,
) -> Timing:
    """Time the beginning of a job; seconds are those of one of its `n_runs` members.

    Processor seconds are measured, since the machine may be busy.
    """
    run(min(FIRST_STEPS, n_steps), True)
    samples: list[tuple[int, float]] = []
    began = time.process_time()

    def note(done: int, of: int) -> None:
        taken = time.process_time() - began
        if not samples or done > samples[-1][0]:
            # a graded start has more steps than n_steps
            samples.append((done * n_steps // of, taken))
        ahead = samples[-1][0] - samples[0][0]
        # a graded start may begin with many short steps, which do not count as progress
        if taken > most_seconds and (
            ahead >= FIRST_STEPS or (ahead and taken > PATIENCE * most_seconds)
        ):
            raise _EnoughError

    try:
        with on_progress(note, seconds_between=0.0):
            run(n_steps, False)
        samples.append((n_steps, time.process_time() - began))
    except _EnoughError:
        pass
    done, seconds = samples[-1]
    again = max(1, int(done * min(1.0, AGAIN_SECONDS / max(seconds, 1e-9))))

    def timed(*, is_whole: bool) -> float:
        began = time.process_time()
        run(again, is_whole)
        return time.process_time() - began

    multiple = timed(is_whole=True) / timed(is_whole=False)
    each = {done: taken / n_runs for done, taken in samples}
    return Timing(
        n_steps=tuple(each),
        seconds=tuple(each.values()),
        is_quadratic=is_quadratic,
        multiple=multiple,
    )


def short_job(
    scenes: Sequence[Scene],
    method: AnyMethod,
    n_steps: int,
    *,
    observations: Sequence[Observations] = (),
    every: int = 1,
    diagnostics: DiagnosticsRequest = NO_DIAGNOSTICS,
    grading: float = 1.0,
) -> ShortJob:
    """The first steps of a run or of a batch of members, with all requested outputs or none.

    Steps have the size of those of the whole job; on graded meshes fewer steps cover the whole
    motion. Impacts are not outputs: they belong to the motion.
    """
    requested = observations or [Observations()] * len(scenes)

    def run(short: int, is_whole: bool) -> object:
        own, its = scenes, list[AnySteps]([short] * len(scenes))
        if grading != 1.0:
            its = [graded_mesh(one.final_time, short, grading, one.break_points) for one in scenes]
        elif short < n_steps:
            share = short / n_steps
            own = [replace(one, final_time=share * one.final_time) for one in scenes]
        requests = [_until(one, own[0].final_time) for one in requested]
        first = requests[0]
        if not is_whole and first.impacts and isinstance(method, Method):
            return integrate_with_impacts(
                own[0],
                method,
                short,
                first.impacts,
                coordinates=first.coordinates,
                parameters=first.parameters,
            )
        if not is_whole:
            requests = [Observations()] * len(scenes)
        return integrate_requested(
            own,
            method,
            its,
            requests,
            every=every,
            diagnostics=diagnostics if is_whole else NO_DIAGNOSTICS,
            with_steps=not requested[0].is_empty,
        )

    return run


def _until(request: Observations, final_time: float) -> Observations:
    if request.times is None:
        return request
    times = request.times[request.times <= final_time]
    return replace(request, times=times if times.size else np.array([final_time]))
