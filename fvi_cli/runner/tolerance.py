"""Experiments that ask for a tolerance: their runs are recalled, or chosen and computed."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from fvi_cli.config.machine import machine_bytes
from fvi_cli.runner.compute import Keep
from fvi_cli.runner.executors.executor import crash, lost_run, no_memory
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import Chosen, no_choice, reusable
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.tolerance.experiment_run import run_for_tolerance

_logger = logging.getLogger(__name__)


def run_tolerance_searches(
    experiments: Sequence[Experiment],
    settings: Settings,
    *,
    chosen: Chosen = no_choice,
    keep: Keep | None = None,
) -> dict[Experiment, Outcome]:
    """Recall or compute the run of every experiment with a tolerance.

    One after the other, in this process: every run of a search depends on those before it.

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
    """
    outcomes: dict[Experiment, Outcome] = {}
    has_failed = False
    for experiment in experiments:
        if not experiment.needs_search:
            continue
        if has_failed:
            # nothing is begun after an unexpected failure (--fail-fast)
            outcomes[experiment] = Outcome(experiment=experiment, finished=())
            continue
        finished = reusable(chosen(experiment))
        if finished is None:
            finished, is_result = _searched(experiment)
            if keep is not None and is_result:
                keep([finished])
        else:
            _logger.info("%s: stored", experiment.name)
        outcomes[experiment] = Outcome(experiment=finished.run.experiment, finished=(finished,))
        has_failed = settings.fail_fast and is_unexpected_failure(finished)
    return outcomes


def _searched(experiment: Experiment) -> tuple[FinishedRun, bool]:
    """The run that a search comes to, and whether that is a result which is to be kept."""

    def tell(line: str) -> None:
        _logger.info("%s: %s", experiment.name, line)

    is_result = True
    try:
        finished = run_for_tolerance(experiment, available_bytes=machine_bytes(), tell=tell)
    except MemoryError as error:
        finished, is_result = _lost(experiment, no_memory(error)), False
    except Exception as error:
        told = crash(error)
        _logger.debug("%s: %s", experiment.name, told.trace)
        finished, is_result = _lost(experiment, told.message), False
    for remark in finished.trajectory.remarks:
        if remark.startswith("stability:"):
            _logger.warning("%s: %s", finished.run.title, remark)
    if is_unexpected_failure(finished):
        _logger.warning("%s: %s", experiment.name, finished.trajectory.message)
    return finished, is_result


def _lost(experiment: Experiment, message: str) -> FinishedRun:
    """The run that would have been tried first in place of the one that was not found."""
    if experiment.accuracy is None:
        raise ValueError(f"{experiment.name}: it has a ladder")
    (run,) = experiment.with_choice(experiment.accuracy.candidates[0], 1).runs()
    return lost_run(run, message)
