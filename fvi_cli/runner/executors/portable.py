"""Jobs and their results as they travel to another process: plain values, no functions."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from fvi_cli.errors import ExecutorError
from fvi_cli.runner.executors.executor import attempt
from fvi_cli.runner.executors.jobs import ComputeJob, Crash, Job, JobKind, References, Results
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage.code import Code, own_code
from fvi_cli.studies.cost import CostRow, ToleranceRow
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.reference import Reference


@dataclass(frozen=True, kw_only=True, eq=False)
class PortableJob:
    """A job that travels."""

    # the experiment without its problem, pickled; the same text for all of its jobs
    experiment: bytes
    runs: tuple[Mapping[str, Any], ...]  # the fields of every run, without the experiment
    kind: JobKind  # as of the job
    references: References  # what its runs are measured against
    code: Code  # of the program that sends it


PortableResults = list[dict[str, Any] | Reference | CostRow | ToleranceRow | Crash | None]
"""The fields of finished runs, without the runs; others as they are."""


def portable_job(job: Job, references: References) -> PortableJob:
    """The job for another process, where its problem is built anew from the specification."""
    return PortableJob(
        experiment=_portable_experiment(job.runs[0].experiment),
        runs=tuple(_fields_of(run, "experiment") for run in job.runs),
        kind=job.kind,
        references=references,
        code=own_code(),
    )


@functools.lru_cache(maxsize=8)
def _portable_experiment(experiment: Experiment) -> bytes:
    return pickle.dumps(
        {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in _fields_of(experiment, "problem").items()
            if name != "members"
        }
    )


def _fields_of(value: Any, left_out: str) -> dict[str, Any]:
    names = (field.name for field in fields(value))
    return {name: getattr(value, name) for name in names if name != left_out}


@functools.lru_cache(maxsize=8)
def _revived(portable: bytes) -> Experiment:
    """The experiment again, its problem built anew."""
    description = pickle.loads(portable)  # noqa: S301 - made by the parent process
    problem = build_problem(description["problem_specification"])
    return Experiment(problem=problem, **description)


def compute_portable(compute: ComputeJob, portable: PortableJob) -> PortableResults:
    """Compute a job that has travelled.

    Raises
    ------
    ExecutorError
        If it was sent by other code, whose numbers may be others.
    """
    differences = portable.code.differences(own_code())
    if differences:
        raise ExecutorError(f"it has {differences}; install the same on both sides")
    experiment = _revived(portable.experiment)
    runs = tuple(Run(experiment=experiment, **run) for run in portable.runs)
    job = Job(runs=runs, kind=portable.kind)
    return [
        _fields_of(one, "run") | _choice(one.run) if isinstance(one, FinishedRun) else one
        for one in attempt(job, portable.references, compute)
    ]


def _choice(run: Run) -> dict[str, Any]:
    return {"method": run.method, "n_steps": run.n_steps}


def returned_results(job: Job, results: PortableResults) -> Results:
    """The results, the runs being those that were sent out, or were chosen for them."""
    return [
        _returned(run, dict(one)) if isinstance(one, dict) else one
        for run, one in zip(job.runs, results, strict=True)
    ]


def _returned(run: Run, result: dict[str, Any]) -> FinishedRun:
    choice = {name: result.pop(name) for name in _choice(run)}
    if choice != _choice(run):
        run = run.experiment.chosen_run(**choice, member=run.member)
    return FinishedRun(run=run, **result)
