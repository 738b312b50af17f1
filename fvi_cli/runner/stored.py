"""What a request finds in its result file: which runs are stored, and why others are not."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.request import Request
from fvi_cli.runner.settings import Settings
from fvi_cli.storage import NEW, Reasons, holds_runs, place_of, read_results
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

_logger = logging.getLogger(__name__)

FRESH = "--fresh"

Known = Callable[[Run], FinishedRun | None]
"""Gives back a run that was finished before, or None."""
Chosen = Callable[[Experiment], FinishedRun | None]
"""Gives back the run that was chosen earlier for the tolerance of an experiment, or None."""
Why = Callable[[Run], str]
"""Says why a run is computed that was not found."""


def no_run(run: Run) -> FinishedRun | None:
    """No run is known."""
    return None


def no_choice(experiment: Experiment) -> FinishedRun | None:
    """Nothing was chosen earlier."""
    return None


def is_kept(request: Request, settings: Settings) -> bool:
    """Whether runs are written; says so where stored runs of another problem are in their place."""
    path = settings.path_of(request)
    if request.stored is not None or not settings.keep or not holds_runs(path):
        return settings.keep
    with read_results(path) as results:
        others = results.of_another_problem(
            first for e in request.loaded.experiments for first in _some_run(e)
        )
    if others and settings.may_replace:
        _logger.warning(
            "%s: %d stored runs belong to another problem of this name and are replaced; "
            "another name or --output keeps them",
            path,
            others,
        )
    elif others:
        _logger.warning(
            "%s: %d stored runs belong to another problem of this name and stay; "
            "what is computed now is not kept",
            path,
            others,
        )
    return settings.may_replace or not others


@contextlib.contextmanager
def chosen_runs(request: Request, settings: Settings) -> Iterator[Chosen]:
    """Look-up of runs that were chosen for a tolerance; writes nothing."""
    path = settings.path_of(request)
    is_fresh = settings.fresh and request.stored is None
    if is_fresh or not holds_runs(path):
        yield no_choice
        return
    with read_results(path) as results:
        yield results.chosen


@contextlib.contextmanager
def stored_runs(request: Request, settings: Settings) -> Iterator[Known]:
    """Look-up of stored runs that writes nothing."""
    path = settings.path_of(request)
    is_fresh = settings.fresh and request.stored is None
    if is_fresh or not holds_runs(path):
        yield no_run
        return
    with read_results(path) as results:
        yield results.finished


@contextlib.contextmanager
def reasons(request: Request, settings: Settings) -> Iterator[Why]:
    """Function that says why a run is computed that was not found; writes nothing."""
    path = settings.path_of(request)
    if settings.fresh:
        yield lambda run: FRESH
    elif not holds_runs(path):
        yield lambda run: NEW
    else:
        with read_results(path) as stored:
            asked = {place_of(run) for e in request.loaded.experiments for run in e.runs()}
            yield Reasons(stored=stored, asked=asked).of


def recall(experiments: Sequence[Experiment], path: Path) -> list[Outcome]:
    """Read the runs of a result file, and compute nothing."""
    with read_results(path) as results:
        outcomes = []
        for experiment in experiments:
            found = [results.finished(run) for run in experiment.runs()]
            if experiment.needs_search:
                found = [results.chosen(experiment)]
            finished = tuple(one for one in found if one is not None)
            own = finished[0].run.experiment if experiment.needs_search and finished else experiment
            outcomes.append(Outcome(experiment=own, finished=finished))
    for outcome in outcomes:
        if outcome.missing:
            _logger.warning(
                "%s: %d runs of %s are missing; run its configuration to compute them",
                path,
                outcome.missing,
                outcome.experiment.name,
            )
    return outcomes


def _some_run(experiment: Experiment) -> list[Run]:
    """One run, whichever: all have the problem in common."""
    if experiment.needs_search:
        return experiment.with_choice(experiment.methods[0], 1).runs()
    return experiment.runs()[:1]
