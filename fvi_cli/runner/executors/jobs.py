"""Jobs, into which the computation of a command is divided, and their results."""

from __future__ import annotations

import logging
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

import fvi_cli
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.runner.executors.batches import Batch, Pack, batches_of, pack_of
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.reference import Reference, needs_refined_run

_logger = logging.getLogger(__name__)

JobKind = Literal["run", "reference"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """Runs or searches of one batch, or the references of all scenes of a pack."""

    runs: Batch
    kind: JobKind = "run"
    """For ``reference`` `runs` has one run for each scene."""
    needs: Job | None = None
    """The job that must have ended before; None: there is none."""

    @property
    def is_reference(self) -> bool:
        """Whether the job computes references."""
        return self.kind == "reference"

    @property
    def title(self) -> str:
        """The job in one line, named by its first run."""
        return self.runs[0].title

    @property
    def n_steps(self) -> int:
        """Number of steps of all runs together."""
        return sum(run.n_steps for run in self.runs)

    @property
    def pack(self) -> Pack:
        """The pack of the job; one process should compute a pack, since it keeps its problems."""
        first = self.runs[0]
        return (self,) if self.is_reference and first.member is None else pack_of(first)


@dataclass(frozen=True, kw_only=True)
class Crash:
    """Why there is no result: an unexpected exception, or the end of a process."""

    message: str
    """Its message, where it happened, and what to do about it."""
    trace: str = ""


Result = FinishedRun | Reference | Crash | None
Results = Sequence[Result]
"""One result for each run of a job; None (reference): the scene has an exact solution."""
References = Sequence[Reference | None]
"""References for the errors of runs; None: the process that computes the run finds it."""
ComputeJob = Callable[[Job, References], Results]
"""Computes a job; other processes can only call a function that is importable by name."""
Lookup = Callable[[Run], Reference | Crash | None]
"""Returns the reference of a run if it is known by now."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FinishedJob:
    """A job with its results."""

    job: Job
    results: Results

    @property
    def finished(self) -> tuple[FinishedRun, ...]:
        """Its runs; those that were not computed are ``failed``, with the reason."""
        return tuple(
            lost_run(run, one.message) if isinstance(one, Crash) else one
            for run, one in zip(self.job.runs, self.results, strict=True)
            if isinstance(one, FinishedRun | Crash)
        )

    @property
    def stored(self) -> tuple[FinishedRun, ...]:
        """Its runs that are to be stored; crashed runs are not, since no method failed."""
        return tuple(one for one in self.results if isinstance(one, FinishedRun))

    @property
    def lost(self) -> frozenset[Run]:
        """Runs that were not computed because of a crash."""
        pairs = zip(self.job.runs, self.results, strict=True)
        return frozenset(run for run, one in pairs if isinstance(one, Crash))


def jobs_of(runs: Sequence[Run], known: Callable[[Run], bool] = lambda run: False) -> list[Job]:
    """Jobs for runs, in the order of their batches; `known` says whether a reference is stored.

    One job computes the reference of a scene for all methods and steps; for a sweep one job
    computes the references of all members of a pack.
    """
    found: list[Job] = []
    scenes: dict[tuple[object, ...], dict[object, Run]] = {}
    for run in filter(needs_refined_run, runs):
        scenes.setdefault(_shared(run), {}).setdefault(run.member, run)
    references: dict[tuple[object, ...], Job | None] = {}
    for batch in batches_of(runs):
        needs, key = None, _shared(batch[0])
        if key in scenes and key not in references:
            own = tuple(run for run in scenes.pop(key).values() if not known(run))
            references[key] = Job(runs=own, kind="reference") if own else None
            found += [one for one in [references[key]] if one is not None]
        needs = references.get(key)
        found.append(Job(runs=batch, needs=needs))
    return found


def _shared(run: Run) -> tuple[object, ...]:
    """Key of the reference job of a run: equal for runs that share the job."""
    return (run.experiment,) if run.member is None else pack_of(run)


@dataclass(kw_only=True, eq=False)
class JobQueue:
    """Waiting jobs by their packs; a job is ready when the job that it needs has ended."""

    packs: dict[Pack, deque[Job]]
    open: set[Job]
    """Jobs that have not ended."""
    begun: set[Pack] = field(default_factory=set)

    @classmethod
    def in_order(cls, jobs: Iterable[Job]) -> JobQueue:
        """A queue for one process: jobs in their given order."""
        packs: dict[Pack, deque[Job]] = {}
        for job in jobs:
            packs.setdefault(job.pack, deque()).append(job)
        return cls(packs=packs, open={job for own in packs.values() for job in own})

    @classmethod
    def longest_first(cls, jobs: Iterable[Job]) -> JobQueue:
        """A queue for several processes: references, then packs in descending order of steps."""
        queue = cls.in_order(jobs)

        def steps(job: Job) -> tuple[bool, int]:
            return not job.is_reference, -job.n_steps

        def all_steps(own: Iterable[Job]) -> tuple[bool, int]:
            firsts, counts = zip(*map(steps, own), strict=True)
            return min(firsts), sum(counts)

        ordered = sorted(queue.packs.items(), key=lambda one: all_steps(one[1]))
        queue.packs = {pack: deque(sorted(own, key=steps)) for pack, own in ordered}
        return queue

    def take(self, latest: Pack | None) -> Job | None:
        """A ready job of the pack `latest`, else of a pack not begun, else of any pack, or None."""
        pack = latest if latest is not None and self._is_ready(latest) else None
        if pack is None:
            ready = filter(self._is_ready, self.packs)
            pack = any_ready = next(ready, None)
            if any_ready in self.begun:
                pack = next((one for one in ready if one not in self.begun), any_ready)
        if pack is None:
            return None
        self.begun.add(pack)
        job = self.packs[pack].popleft()
        if not self.packs[pack]:
            del self.packs[pack]
        return job

    def _is_ready(self, pack: Pack) -> bool:
        return pack in self.packs and self.packs[pack][0].needs not in self.open


def crash(error: Exception) -> Crash:
    """Report on an exception: its message, and the last line of this package in its traceback."""
    package = Path(fvi_cli.__file__).parent
    place = "".join(
        f" in {Path(frame.filename).relative_to(package.parent).as_posix()}:{frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)
        if package in Path(frame.filename).parents
    ).rpartition(" in ")[2]
    return Crash(
        message=f"unexpected {type(error).__name__}{f' in {place}' if place else ''}: {error}; "
        "this is a mistake of the program, please report it with the configuration",
        trace="".join(traceback.format_exception(error)),
    )


def describe_crash(run: Run, error: Exception) -> str:
    """Message on an exception within a run; its traceback is logged at the debug level."""
    found = crash(error)
    _logger.debug("%s: %s", run.title, found.trace)
    return found.message


def no_memory(error: MemoryError) -> Crash:
    """The crash of a job for which there was not enough memory."""
    return Crash(message="not enough memory" + (f": {error}" if str(error) else ""))


def lost_run(run: Run, message: str) -> FinishedRun:
    """A finished run with status ``failed`` that has only its start and the message."""
    scene = run.problem.scene
    start = np.zeros(1) if scene is None else scene.initial_position
    return FinishedRun(
        run=run,
        trajectory=Trajectory(
            time=np.zeros(1),
            position=start[None],
            n_steps=run.n_steps,
            step_size=run.step_size,
            status="failed",
            message=message,
        ),
        error=float("nan"),
        floor=0.0,
        status="failed",
    )
