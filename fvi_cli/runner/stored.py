"""The result file of a request: which runs are stored, and which are missing."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence

from fvi_cli.errors import StorageError
from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.request import Request
from fvi_cli.runner.settings import Settings
from fvi_cli.storage import Store, open_results, read_results
from fvi_cli.studies.experiment import FinishedRun

_logger = logging.getLogger(__name__)


def reusable(found: FinishedRun | None, request: Request) -> FinishedRun | None:
    """A stored run, or None; a refused search is repeated, unless the request is a result file."""
    is_refused = found is not None and found.run.is_search and found.status == "refused"
    return None if is_refused and request.stored is None else found


@contextlib.contextmanager
def stored_runs(request: Request, settings: Settings, *, writes: bool = False) -> Iterator[Store]:
    """The result file of a request.

    A command that `writes` locks the file, and may add runs.
    """
    is_fresh = settings.fresh and request.stored is None
    path = settings.path_of(request)
    opened = (
        open_results(settings.output, path.stem, fresh=is_fresh)
        if writes
        else read_results(path, fresh=is_fresh, may_be_missing=request.stored is None)
    )
    with opened as store:
        yield store


def report_missing(outcomes: Sequence[Outcome], results: Store) -> None:
    """Warn of requested runs that the result file lacks.

    Raises
    ------
    StorageError
        If none of the runs of an experiment can be used, such as those of an older version.
    """
    for outcome in outcomes:
        if outcome.missing and not outcome.finished:
            raise StorageError(
                f"{results.path}: none of the {outcome.missing} runs of {outcome.experiment.name} "
                "is stored for these settings and this version of fvi; compute them with fvi run "
                f"and their configuration, which fvi show {results.path} --config prints"
            )
        if outcome.missing:
            _logger.warning(
                "%s: %d runs of %s are missing; run its configuration to compute them",
                results.path,
                outcome.missing,
                outcome.experiment.name,
            )
