"""The result file of a request: which runs are stored, and why others are computed."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Sequence

from fvi_cli.errors import StorageError
from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.request import Request
from fvi_cli.runner.settings import Settings
from fvi_cli.storage import Reasons, Store, open_results, read_results
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

_logger = logging.getLogger(__name__)

FRESH = "--fresh"

Why = Callable[[Run], str]
"""Returns the reason why a run that is not stored is computed."""


def reusable(found: FinishedRun | None, request: Request) -> FinishedRun | None:
    """A stored run, or None; a refused search is repeated, unless the request is a result file."""
    is_refused = found is not None and found.run.is_search and found.status == "refused"
    return None if is_refused and request.stored is None else found


@contextlib.contextmanager
def stored_runs(
    request: Request, settings: Settings, *, writes: bool = False
) -> Iterator[tuple[Store, Why]]:
    """The result file of a request, opened once, and the reasons for runs that it lacks.

    A command that `writes` locks the file, and may add runs.
    """
    is_fresh = settings.fresh and request.stored is None
    path = settings.path_of(request)
    opened = (
        open_results(settings.output, path.stem, fresh=is_fresh, waits=settings.waits)
        if writes
        else read_results(path, fresh=is_fresh, may_be_missing=request.stored is None)
    )
    with opened as store:

        def requested() -> Iterator[Run]:
            listed = settings.runs_of(request).values()
            return (run for runs in listed for run in runs if not run.is_search)

        reasons = Reasons(stored=store, requested=requested)
        yield store, (lambda run: FRESH) if is_fresh else reasons.of


def report_missing(outcomes: Sequence[Outcome], results: Store) -> None:
    """Warn of requested runs that the result file lacks.

    Raises
    ------
    StorageError
        If none of the runs of an experiment can be used, such as those of an older version.
    """
    for outcome in outcomes:
        if outcome.missing and not outcome.finished:
            raise StorageError(_unusable(outcome.experiment, results))
        if outcome.missing:
            _logger.warning(
                "%s: %d runs of %s are missing; run its configuration to compute them",
                results.path,
                outcome.missing,
                outcome.experiment.name,
            )


def _unusable(experiment: Experiment, results: Store) -> str:
    """A message: why no run of an experiment can be used, and what to do."""
    runs = experiment.runs()
    reasons = Reasons(stored=results, requested=lambda: runs)
    found = sorted({reasons.of(run) for run in runs})
    return (
        f"{results.path}: none of the {len(runs)} runs of {experiment.name} can be used "
        f"({'; '.join(found)}); compute them with fvi run and their configuration, which "
        f"fvi show {results.path} --config prints"
    )
