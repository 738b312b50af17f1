"""The loop over jobs, common to computations in this process, in processes and on a cluster."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

from fvi_cli.runner.executors.batches import Pack
from fvi_cli.runner.executors.jobs import (
    ComputeJob,
    Crash,
    FinishedJob,
    Job,
    JobQueue,
    Lookup,
    References,
    Result,
    Results,
    crash,
    no_memory,
)

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Died:
    """The process that computed a job has died, `times` times."""

    message: str
    times: int = 1


Answer = Results | Crash | Died
"""The results of a job, or why there are none; a crash is that of all its runs."""


@dataclass(kw_only=True, eq=False)
class Executor(ABC):
    """Computes jobs; subclasses say where."""

    is_parallel: ClassVar[bool] = True
    """Whether several jobs are computed at a time; then the longest packs are computed first."""
    compute_job: ComputeJob = field(init=False, repr=False)

    def compute(
        self, jobs: Sequence[Job], compute: ComputeJob, lookup: Lookup = lambda run: None
    ) -> Generator[FinishedJob, None, None]:
        """Compute every job and yield each as soon as it is finished.

        Closing the generator, or an exception in the loop that reads it, ends all running jobs.
        An exception of `compute` becomes the result of the run that caused it, not of other runs. A
        job whose process has died is computed once more after all others, by itself; if its process
        dies again, the job is lost. `lookup` gives the references of runs once the jobs that they
        need have been yielded.
        """
        if not jobs:
            return
        self.compute_job = compute
        queue = JobQueue.longest_first(jobs) if self.is_parallel else JobQueue.in_order(jobs)
        running, suspects, deaths = set[Job](), deque[Job](), Counter[Job]()
        try:
            while True:
                while (room := self.room())[0]:
                    job = queue.take(room[1])
                    if job is None and not running and suspects:
                        job = suspects.popleft()
                    if job is None:
                        break
                    whole, references, lost = _with_references(job, lookup)
                    if lost is not None:
                        yield lost
                    if whole is not None:
                        running.add(whole)
                        self.send(whole, references)
                if not running:
                    break
                for job, answer in self.answers():
                    running.discard(job)
                    found = answer
                    if isinstance(found, Died):
                        is_suspect = job not in deaths
                        deaths[job] += found.times
                        if is_suspect:
                            suspects.append(job)
                            continue
                        found = Crash(message=f"{found.message}, {deaths[job]} times")
                    queue.open.discard(job)
                    yield _finished(job, found)
        finally:
            self.stop()

    @abstractmethod
    def room(self) -> tuple[bool, Pack | None]:
        """Whether a job can be sent, and the latest pack of the process that would compute it."""

    @abstractmethod
    def send(self, job: Job, references: References) -> None:
        """Start the computation of a job by :attr:`compute_job`."""

    @abstractmethod
    def answers(self) -> Iterable[tuple[Job, Answer]]:
        """Wait for finished jobs and return their answers; may be empty."""

    @abstractmethod
    def stop(self) -> None:
        """End running jobs and idle processes."""


def _with_references(job: Job, lookup: Lookup) -> tuple[Job | None, References, FinishedJob | None]:
    """Job of the runs with references; references; finished job of runs that lost theirs."""
    if job.is_reference:
        return job, (), None
    pairs = [(run, lookup(run)) for run in job.runs]
    whole = [(run, one) for run, one in pairs if not isinstance(one, Crash)]
    if len(whole) == len(pairs):
        return job, [one for _, one in whole], None
    lost = [(run, one) for run, one in pairs if isinstance(one, Crash)]
    broken = replace(job, runs=tuple(run for run, _ in lost))
    rest = replace(job, runs=tuple(run for run, _ in whole)) if whole else None
    return rest, [one for _, one in whole], _finished(broken, [one for _, one in lost])


def _finished(job: Job, answer: Results | Crash) -> FinishedJob:
    results = [answer] * len(job.runs) if isinstance(answer, Crash) else answer
    for run, one in zip(job.runs, results, strict=True):
        if isinstance(one, Crash) and one.trace:
            _logger.debug("%s: %s", run.title, one.trace)
    return FinishedJob(job=job, results=results)


def compute_soundly(job: Job, references: References, compute: ComputeJob) -> Results:
    """Compute the runs of a job; if that raises an exception, compute each run by itself.

    Raises
    ------
    MemoryError
        If there is not enough memory, which no single run has caused.
    """
    try:
        return compute(job, references)
    except MemoryError:
        raise
    except Exception as mistake:
        error = mistake
    if len(job.runs) == 1:
        return [crash(error)]
    _logger.debug("%d runs together: %s", len(job.runs), crash(error).trace)
    _logger.warning("%d runs are computed one by one: %s", len(job.runs), crash(error).message)
    found: list[Result] = []
    for index, run in enumerate(job.runs):
        own = replace(job, runs=(run,))
        found += compute_soundly(own, references[index : index + 1], compute)
    return found


@dataclass(kw_only=True, eq=False)
class InProcess(Executor):
    """Computes in this process, one job after the other, in their order."""

    is_parallel: ClassVar[bool] = False
    given: list[tuple[Job, References]] = field(init=False, default_factory=list)
    latest: Pack | None = field(init=False, default=None)

    def room(self) -> tuple[bool, Pack | None]:
        """As :meth:`Executor.room`: one job at a time."""
        return not self.given, self.latest

    def send(self, job: Job, references: References) -> None:
        """As :meth:`Executor.send`; :meth:`answers` computes the job."""
        self.given, self.latest = [(job, references)], job.pack

    def answers(self) -> Iterable[tuple[Job, Answer]]:
        """As :meth:`Executor.answers`."""
        ((job, references),) = self.given
        try:
            answer: Answer = compute_soundly(job, references, self.compute_job)
        except MemoryError as error:
            answer = no_memory(error)
        self.given = []
        return [(job, answer)]

    def stop(self) -> None:
        """As :meth:`Executor.stop`."""
        self.given = []
