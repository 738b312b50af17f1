"""Jobs are computed: members of a sweep together, searches and other runs individually."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from fvi_cli.config.memory import machine_bytes
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.observations.observe import integrate_observed_members
from fvi_cli.integrator.observations.observer import Pair
from fvi_cli.integrator.run.checkpoint import RunKeeper, part_of
from fvi_cli.integrator.stability.prediction import StabilityPrediction
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.runner.executors.batches import Batch, search_title
from fvi_cli.runner.executors.checkpoints import CheckpointFolder
from fvi_cli.runner.executors.jobs import Job, References, Results
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.reference import Reference
from fvi_cli.studies.study import (
    assessed,
    assessed_pair,
    execute,
    is_refused,
    prediction_of,
    reference_of,
    refined_references,
    refused,
    thinning_of,
    with_remark_on_thinning,
)
from fvi_cli.studies.tolerance.experiment_run import run_for_tolerance

_logger = logging.getLogger(__name__)


def execute_job(
    job: Job, references: References = (), checkpoints: CheckpointFolder | None = None
) -> Results:
    """Compute the runs of a job against given references, in their order, or find these.

    Members of a sweep are integrated together; one that diverges or is refused does not disturb
    the others.
    """
    if job.is_reference:
        return refined_references(job.runs)
    batch = job.runs
    first = batch[0]
    if first.is_search:
        return [_searched(run, checkpoints) for run in batch]
    observations = first.experiment.observations
    given = dict(zip(batch, references or [None] * len(batch), strict=True))
    kept = (
        None if checkpoints is None else checkpoints.of(batch, is_single_run=observations.is_empty)
    )
    is_single = len(batch) == 1 or first.experiment.grading != 1.0
    if (
        first.member is None
        or not isinstance(first.problem, Problem)
        or (not observations.is_empty and (is_single or observations.impacts))
    ):
        return list(map(execute, batch, [_own(kept, batch, run) for run in batch], given.values()))
    predictions = {run: prediction_of(run) for run in batch}
    going = [run for run in batch if not is_refused(run, predictions[run])]
    scenes = [run.problem.scene for run in going if isinstance(run.problem, Problem)]
    every, method, n_steps = thinning_of(first), first.method, first.n_steps
    found: Sequence[Trajectory | Pair]
    if not observations.is_empty:
        each = [run.observations for run in going]
        found = integrate_observed_members(scenes, method, n_steps, each, checkpoints=kept)
    elif first.experiment.grading == 1.0:
        found = integrate_members(scenes, method, n_steps, every=every, checkpoints=kept)
    else:
        found = [
            integrate(scene, method, run.steps, every=every, checkpoints=_own(kept, batch, run))
            for scene, run in zip(scenes, going, strict=True)
        ]
    computed = dict(zip(going, found, strict=True))
    return [
        _assessed(run, computed.get(run), predictions[run], given[run] or reference_of(run))
        for run in batch
    ]


def _own(kept: RunKeeper | None, batch: Batch, run: Run) -> RunKeeper | None:
    """Where a run of a batch that is integrated individually keeps its checkpoint."""
    return kept if len(batch) == 1 else part_of(kept, f"from {batch.index(run)}")


def _assessed(
    run: Run,
    found: Trajectory | Pair | None,
    prediction: StabilityPrediction,
    reference: Reference,
) -> FinishedRun:
    if found is None:
        return refused(run, prediction, reference)
    if isinstance(found, Trajectory):
        return assessed(run, with_remark_on_thinning(found), prediction, reference)
    return assessed_pair(run, found, prediction, reference)


def _searched(search: Run, checkpoints: CheckpointFolder | None) -> FinishedRun:
    """The run that a search comes to."""
    return run_for_tolerance(
        search,
        available_bytes=machine_bytes(),
        log=lambda line: _logger.info("%s: %s", search_title(search), line),
        checkpoints=None if checkpoints is None else checkpoints.of((search,)),
    )
