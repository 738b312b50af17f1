"""Jobs and results in the form in which they are sent to another process: without functions."""

from __future__ import annotations

import functools
import io
import pickle
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import fvi_cli
from fvi_cli.errors import ExecutorError
from fvi_cli.runner.executors.executor import compute_soundly
from fvi_cli.runner.executors.jobs import ComputeJob, Crash, Job, References, Results
from fvi_cli.scenes.records.inputs import inputs_in, keep_numbers
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage.digests import SOLVER_VERSION
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.reference import Reference

VERSION = f"fvi {fvi_cli.__version__} (solver {SOLVER_VERSION})"

PortableJob = tuple[str, bytes]
"""The version of the program that sends a job, and the job with its references as a pickle."""

PortableResults = list[dict[str, Any] | Reference | Crash | None]
"""Results; finished runs are mappings of their fields without the run."""


class _Pickler(pickle.Pickler):
    """Leaves out the problem of an experiment, which the receiver builds from its specification."""

    def reducer_override(self, value: Any) -> Any:
        return (_revived, (_described(value),)) if isinstance(value, Experiment) else NotImplemented


def portable_job(job: Job, references: References) -> PortableJob:
    """The job for another process."""
    buffer = io.BytesIO()
    _Pickler(buffer).dump((replace(job, needs=None), references))
    return VERSION, buffer.getvalue()


@functools.lru_cache(maxsize=8)
def _described(experiment: Experiment) -> bytes:
    """An experiment without problem and members; the same text for all of its jobs."""
    kept = {
        name: dict(value) if isinstance(value, Mapping) else value
        for name, value in _fields_of(experiment).items()
        if name not in ("problem", "members")
    }
    given = [experiment.problem_specification, *(one.values for one in experiment.members)]
    return pickle.dumps((kept, dict(inputs_in(given))))


def _fields_of(value: Any) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(value)}


@functools.lru_cache(maxsize=8)
def _revived(described: bytes) -> Experiment:
    """The inverse of :func:`_described`; builds the problem."""
    values, inputs = pickle.loads(described)  # noqa: S301 - made by the parent process
    for numbers in inputs.values():
        keep_numbers(numbers)
    return Experiment(problem=build_problem(values["problem_specification"]), **values)


def compute_portable(compute: ComputeJob, portable: PortableJob) -> PortableResults:
    """Compute a job that another process has sent.

    Raises
    ------
    ExecutorError
        If the sender has another version, whose numbers may differ.
    """
    version, content = portable
    if version != VERSION:
        raise ExecutorError(f"it has {VERSION} in place of {version}; install the same everywhere")
    job, references = pickle.loads(content)  # noqa: S301 - made by the parent process
    return [
        _fields_of(one) | {"run": _choice(one.run)} if isinstance(one, FinishedRun) else one
        for one in compute_soundly(job, references, compute)
    ]


def _choice(run: Run) -> dict[str, Any]:
    return {"method": run.method, "n_steps": run.n_steps}


def returned_results(job: Job, results: PortableResults) -> Results:
    """The results, with the runs of the job or, for a search, the run that it chose."""
    return [
        _returned(run, **one) if isinstance(one, dict) else one
        for run, one in zip(job.runs, results, strict=True)
    ]


def _returned(sent: Run, run: dict[str, Any], **result: Any) -> FinishedRun:
    if run != _choice(sent):
        sent = sent.experiment.chosen_run(**run, member=sent.member)
    return FinishedRun(run=sent, **result)
