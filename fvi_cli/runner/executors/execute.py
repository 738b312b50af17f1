"""Compute jobs: members of a sweep together, searches and other runs individually."""

from __future__ import annotations

import logging

from fvi_cli.runner.executors.jobs import Job, References, Results
from fvi_cli.studies.reference import refined_references
from fvi_cli.studies.study import execute_batch

_logger = logging.getLogger(__name__)


def execute_job(job: Job, references: References = ()) -> Results:
    """The results of a job: of its runs with given references, or new references."""
    if job.is_reference:
        return refined_references(job.runs)
    first = job.runs[0]
    return execute_batch(
        job.runs,
        references,
        log=lambda line: _logger.info("%s: %s", first.name, line),
    )
