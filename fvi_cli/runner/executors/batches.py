"""Runs that are computed, and stored, together: members of a sweep that share method and N."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fvi_cli.config.memory import machine_bytes
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.loop.checkpoint import RunKeeper
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.observations.observe import integrate_observed_members
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.members import members_at_a_time
from fvi_cli.studies.study import (
    assessed,
    assessed_pair,
    execute,
    is_refused,
    kept_on_the_way,
    prediction_of,
    references_of,
    refused,
    with_remark_on_thinning,
)
from fvi_cli.studies.tolerance.experiment_run import run_for_tolerance

if TYPE_CHECKING:
    from fvi_cli.runner.executors.checkpoints import CheckpointFolder

_logger = logging.getLogger(__name__)

Pack = tuple[object, ...]

LEAST_PACK, LARGEST_PACK, PACKS = 8, 64, 16
"""Members side by side gain little beyond the largest pack, which is what a worker takes, and what
an interruption loses; smaller sweeps are dealt into so many packs, for that many workers."""


FOR_OBSERVATIONS = 4
"""So many times the memory takes a member whose steps are kept, with those of a second run."""


def batches_of(runs: Sequence[Run]) -> list[tuple[Run, ...]]:
    """The runs in the groups that are computed together.

    A run that belongs to no sweep stands alone, in its place. Members of a sweep are dealt into
    packs, so that a batch on the finest grid takes at most
    :data:`fvi_cli.studies.members.BATCH_BYTES` of memory; a batch is one pack with one method and
    one number of steps. Who is in a pack depends on the experiment alone, for the last digits of a
    member depend on its neighbours: the numbers are the same wherever they are computed. The
    batches of a pack follow each other, for they share what errors are measured against.
    """
    packs: dict[Pack, dict[tuple[object, ...], list[Run]]] = {}
    for run in runs:
        packs.setdefault(pack_of(run), {}).setdefault((run.method, run.n_steps), []).append(run)
    return [tuple(batch) for pack in packs.values() for batch in pack.values()]


def pack_of(run: Run) -> Pack:
    """Which runs stay together: the same for all members of a pack, with any method and N."""
    if run.member is None:
        return run.experiment, run.method, run.n_steps
    if run.is_search:
        return run.experiment, run.member
    return run.experiment, run.member.number // pack_size(run.experiment)


def pack_size(experiment: Experiment) -> int:
    """How many members of a sweep are computed together at most; 1 where nothing is swept.

    Also 1 where impacts are asked for: these members share nothing.
    """
    if one_by_one_words(experiment):
        return 1
    problem = experiment.problem
    dimension = problem.scene.dimension if isinstance(problem, Problem) else 1
    members = max(1, len(experiment.members))
    shared = max(LEAST_PACK, -(-members // PACKS))
    steps = max(experiment.steps, default=1)
    if not experiment.observations.is_empty:
        steps *= FOR_OBSERVATIONS
    together = members_at_a_time(steps, dimension)
    return min(members, shared, LARGEST_PACK, together)


def one_by_one_words(experiment: Experiment) -> str:
    """Why members of a sweep share nothing; empty where they may."""
    if experiment.accuracy or not (experiment.members and experiment.observations.impacts):
        return ""
    return (
        f"the {len(experiment.members)} members are integrated one by one, because `impacts` is "
        "asked for; without it they would be integrated in batches"
    )


def search_title(search: Run) -> str:
    """A search, or the run that it came to, in one line."""
    return search.experiment.name + (f" ({search.member.label})" if search.member else "")


def _searched(search: Run, checkpoints: CheckpointFolder | None) -> FinishedRun:
    """The run that a search comes to."""
    return run_for_tolerance(
        search,
        available_bytes=machine_bytes(),
        log=lambda line: _logger.info("%s: %s", search_title(search), line),
        checkpoints=None if checkpoints is None else checkpoints.of(search),
    )


def execute_batch(
    batch: tuple[Run, ...], checkpoints: CheckpointFolder | None = None
) -> list[FinishedRun]:
    """Compute every run of a batch and its error, in the order of the batch.

    Members of a sweep are integrated together; one that diverges or is refused does not disturb
    the others.
    """
    first = batch[0]
    if first.is_search:
        return [_searched(run, checkpoints) for run in batch]
    observations = first.experiment.observations

    def keeper(run: Run) -> RunKeeper | None:
        is_single_run = len(batch) == 1 and observations.is_empty
        return None if checkpoints is None else checkpoints.of(run, is_single_run=is_single_run)

    is_single = len(batch) == 1 or first.experiment.grading != 1.0
    if (
        first.member is None
        or not isinstance(first.problem, Problem)
        or (not observations.is_empty and (is_single or observations.impacts))
    ):
        return [execute(run, keeper(run)) for run in batch]
    members = tuple(run.member for run in batch if run.member is not None)
    references = references_of(members, first.experiment.steps, first.experiment.grading)
    predictions = [prediction_of(run) for run in batch]
    going = {
        run.problem.scene: run
        for run, prediction in zip(batch, predictions, strict=True)
        if isinstance(run.problem, Problem) and not is_refused(run, prediction)
    }
    if not observations.is_empty:
        requests = [run.observations for run in going.values()]
        pairs = iter(integrate_observed_members(list(going), first.method, first.n_steps, requests))
        return [
            refused(run, prediction, reference)
            if is_refused(run, prediction)
            else assessed_pair(run, next(pairs), prediction, reference)
            for run, prediction, reference in zip(batch, predictions, references, strict=True)
        ]
    every = kept_on_the_way(first)
    if first.experiment.grading == 1.0:
        computed = iter(
            integrate_members(
                list(going),
                first.method,
                first.n_steps,
                every=every,
                checkpoints=lambda scene: keeper(going[scene]),
            )
        )
    else:
        computed = iter(
            [
                integrate(scene, run.method, run.steps, every=every, checkpoints=keeper(run))
                for scene, run in going.items()
            ]
        )
    return [
        refused(run, prediction, reference)
        if is_refused(run, prediction)
        else assessed(run, with_remark_on_thinning(next(computed)), prediction, reference)
        for run, prediction, reference in zip(batch, predictions, references, strict=True)
    ]
