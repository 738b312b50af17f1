"""The runs of a request: recalled or computed, and kept if that is wanted."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence

from fvi_cli.runner.compute import compute_runs
from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.plan import check_memory
from fvi_cli.runner.request import Request
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import recall, stored_runs
from fvi_cli.runner.tolerance import run_tolerance_searches

_logger = logging.getLogger(__name__)


def run_requests(
    requests: Sequence[Request], settings: Settings
) -> Iterator[tuple[Request, list[Outcome]]]:
    """Run one request after the other; none after an unexpected failure if that ends the command.

    Yields
    ------
    tuple of Request and list of Outcome
        As soon as its runs are finished.
    """
    for request in requests:
        outcomes = run_request(request, settings)
        yield request, outcomes
        if settings.ends_with(outcomes):
            return


def run_request(request: Request, settings: Settings) -> list[Outcome]:
    """Recall or compute every run of one request; keep what is computed if that is wanted.

    Raises
    ------
    StorageError
        If results cannot be read or written.
    RequestError
        If as many runs as there are processes would take more memory than there is.
    """
    check_memory(request, settings)
    experiments = request.loaded.experiments
    is_kept = settings.keep and request.stored is None
    checkpoints = settings.checkpoints(request)
    with stored_runs(request, settings, writes=is_kept) as (store, why):
        if request.stored is not None:
            return recall(experiments, store)
        keep = store.add if is_kept else None
        if settings.fresh and checkpoints is not None:
            every = (run for one in experiments for run in (*one.runs(), *one.searches()))
            checkpoints.remove(every)
        try:
            searched = run_tolerance_searches(
                experiments, settings, chosen=store.chosen, keep=keep, checkpoints=checkpoints
            )
            rest = [experiment for experiment in experiments if experiment not in searched]
            outcomes = dict(searched)
            if rest and settings.ends_with([*searched.values()]):
                _logger.error("stopped at the first unexpected failure (--fail-fast)")
                outcomes |= {one: Outcome(experiment=one, finished=()) for one in rest}
            elif rest:
                computed = compute_runs(
                    rest,
                    settings,
                    title=request.name,
                    known=store.finished,
                    why=why,
                    keep=keep,
                    checkpoints=checkpoints,
                )
                outcomes |= {one.experiment: one for one in computed}
            return [outcomes[experiment] for experiment in experiments]
        finally:
            if is_kept:
                # also on Ctrl-C: what is finished is there for the next time
                # a part of few packs may be empty, which those who wait for its file need not know
                store.consolidate(request.loaded, even_empty=settings.shard.count > 1)
