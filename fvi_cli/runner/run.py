"""The runs of a request: recalled or computed, and kept if that is wanted."""

from __future__ import annotations

from fvi_cli.runner.compute import compute_runs
from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.plan import check_memory
from fvi_cli.runner.request import Request
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import recall, stored_runs


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
        if settings.fresh and checkpoints is not None:
            every = (run for one in experiments for run in (*one.runs(), *one.searches()))
            checkpoints.remove(every)
        try:
            return compute_runs(
                experiments,
                settings,
                title=request.name,
                store=store,
                is_kept=is_kept,
                why=why,
                checkpoints=checkpoints,
            )
        finally:
            if is_kept:
                # also on Ctrl-C: what is finished is there for the next time
                # a part of few packs may be empty, which those who wait for its file need not know
                store.consolidate(request.loaded, even_empty=settings.shard.count > 1)
