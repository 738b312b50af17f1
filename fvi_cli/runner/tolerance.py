"""Experiments that ask for a tolerance: their runs are recalled, or chosen and computed."""

from __future__ import annotations

import contextlib
import functools
import logging
from collections.abc import Sequence

from fvi_cli.config.memory import machine_bytes
from fvi_cli.runner.compute import Keep
from fvi_cli.runner.executors.checkpoints import CheckpointFolder
from fvi_cli.runner.executors.executor import Batch, ComputeBatch
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import Chosen, reusable
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.tolerance.experiment_run import run_for_tolerance

_logger = logging.getLogger(__name__)


def run_tolerance_searches(
    experiments: Sequence[Experiment],
    settings: Settings,
    *,
    chosen: Chosen,
    keep: Keep | None = None,
    checkpoints: CheckpointFolder | None = None,
) -> dict[Experiment, Outcome]:
    """Recall or compute the run of every experiment with a tolerance, or of each of its members.

    Every run of a search depends on those before it; members are independent of each other.

    Parameters
    ----------
    experiments
        All experiments of a configuration; those with a ladder are left alone.
    settings
        How.
    chosen
        Looks up what is stored.
    keep
        Is given every run that is computed, as soon as it is finished.
    checkpoints
        Where the runs of a search keep their checkpoints, and may have some from before.
    """
    outcomes: dict[Experiment, Outcome] = {}
    has_failed = False
    searches = settings.shard.searches_of(experiments)
    for experiment in experiments:
        if not experiment.needs_search:
            continue
        finished: list[FinishedRun] = []
        if not has_failed:
            listed = searches[experiment]
            finished = _searched(experiment, listed, settings, chosen, keep, checkpoints)
        # nothing is begun after an unexpected failure (--fail-fast)
        has_failed |= settings.fail_fast and any(map(is_unexpected_failure, finished))
        own = experiment if experiment.members or not finished else finished[0].run.experiment
        outcomes[experiment] = Outcome(experiment=own, finished=tuple(finished))
    return outcomes


def search_batch(batch: Batch, checkpoints: CheckpointFolder | None = None) -> list[FinishedRun]:
    """The runs that searches come to."""
    found = []
    for search in batch:

        def tell(line: str, name: str = _name(search)) -> None:
            _logger.info("%s: %s", name, line)

        own = None if checkpoints is None else checkpoints.of(search)
        found.append(
            run_for_tolerance(search, available_bytes=machine_bytes(), tell=tell, checkpoints=own)
        )
    return found


def _searched(
    experiment: Experiment,
    searches: Sequence[Run],
    settings: Settings,
    chosen: Chosen,
    keep: Keep | None,
    checkpoints: CheckpointFolder | None,
) -> list[FinishedRun]:
    """The runs of all searches of an experiment, in their order."""
    done: dict[object, FinishedRun] = {}
    waiting: list[Batch] = []
    for search in searches:
        earlier = reusable(chosen(search))
        if earlier is None:
            waiting.append((search,))
        else:
            done[search.member] = earlier
    if done:
        count = f"{len(done)} of {len(done) + len(waiting)} " if experiment.members else ""
        _logger.info("%s: %sstored", experiment.name, count)
    compute: ComputeBatch = search_batch
    if checkpoints is not None:
        checkpoints.remove(search for search in searches if search.member in done)
        for (search,) in waiting:
            if words := checkpoints.resumed(search):
                _logger.info("%s: %s", _name(search), words)
        compute = functools.partial(search_batch, checkpoints=checkpoints)
    wanted = settings.show_progress and len(waiting) > 1
    with (
        progress_bar(experiment.name, len(waiting), wanted=wanted) as advance,
        contextlib.closing(settings.executor().compute(waiting, compute)) as computed,
    ):
        for batch in computed:
            (finished,) = batch.finished
            if keep is not None and batch.results:
                keep(batch.results)
                if checkpoints is not None:
                    checkpoints.remove(s for s in searches if s.member is finished.run.member)
            done[finished.run.member] = finished
            advance("" if finished.run.member is None else finished.run.member.label)
            _report(finished)
            if settings.fail_fast and is_unexpected_failure(finished):
                break
    return [done[member] for member in experiment.members or (None,) if member in done]


def _report(finished: FinishedRun) -> None:
    for remark in finished.trajectory.remarks:
        if remark.startswith("stability:"):
            _logger.warning("%s: %s", finished.run.title, remark)
    if is_unexpected_failure(finished):
        _logger.warning("%s: %s", _name(finished.run), finished.trajectory.message)


def _name(run: Run) -> str:
    """Of a search, or of the run that it came to."""
    return run.experiment.name + ("" if run.member is None else f" ({run.member.label})")
