"""What would be done with every run of a request, and the memory that it takes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from fvi_cli.config.machine import run_bytes, shortage
from fvi_cli.errors import RequestError
from fvi_cli.runner.request import STORED_SUFFIX, Request, Source, requested
from fvi_cli.runner.work import batches_of, pack_size
from fvi_cli.storage.identity import identity_of
from fvi_cli.storage.store import Store
from fvi_cli.studies.experiment import Run

_SHARD: Final = re.compile(r"([0-9]{1,6})/([0-9]{1,6})")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedRun:
    """The plan for one run."""

    run: Run
    # "reuse" a stored result, "compute", or "leave out" (a run that another shard computes, or that
    # is missing in the result file of the request)
    action: str

    @property
    def finds_steps(self) -> bool:
        """Whether a search will choose method and number of steps, which are not known now."""
        return self.run.is_search

    @property
    def memory_bytes(self) -> int | None:
        """Memory that the run takes by itself; None where its steps are not known."""
        run = self.run
        return None if self.finds_steps else run_bytes(run.experiment, run.method, run.n_steps)


def plan(
    source: Source,
    *,
    output: Path | str = "results",
    workers: int = 1,
    fresh: bool = False,
    shard: str = "1/1",
) -> list[PlannedRun]:
    """What :func:`run` would do with every run; writes no file."""
    request, (number, count) = requested(source), shard_named(shard)
    check_memory_together(request, workers)
    store = Store(result_file(request, output))
    runs = [run for one in request.loaded.experiments for run in one.runs()]
    is_read = request.stored is not None
    missing = [run for run in runs if not store.has(identity_of(run)) or (fresh and not is_read)]
    batches = [] if is_read else batches_of(runs)[number - 1 :: count]
    others = set(missing)
    own = others & {run for batch in batches for run in batch.runs}
    return [
        PlannedRun(
            run=run,
            action="compute" if run in own else "leave out" if run in others else "reuse",
        )
        for run in runs
    ]


def group_alike(plans: Sequence[PlannedRun]) -> list[list[PlannedRun]]:
    """Groups of plans: members with the same plan form one group, any other plan its own."""
    groups: dict[tuple[object, ...], list[PlannedRun]] = {}
    for one in plans:
        run = one.run
        shared = (run.experiment, run.method, run.n_steps, one.action)
        groups.setdefault((run,) if run.member is None else shared, []).append(one)
    return list(groups.values())


def result_file(request: Request, output: Path | str | None) -> Path | None:
    """Where the runs of a request are, or would be, stored; None: nowhere."""
    if request.stored is not None:
        return request.stored
    return None if output is None else Path(output) / f"{request.name}{STORED_SUFFIX}"


def shard_named(text: str) -> tuple[int, int]:
    """The numbers I and N of a text ``I/N``, of which I counts from 1.

    Raises
    ------
    RequestError
        If the text names no part.
    """
    found = _SHARD.fullmatch(text)
    number, count = map(int, found.groups()) if found else (0, 0)
    if not 1 <= number <= count:
        raise RequestError(
            f"--shard {text}: is not I/N with I from 1 to N, such as 2/4 for the second of four "
            "parts"
        )
    return number, count


def check_memory_together(request: Request, workers: int) -> None:
    """Refuse if the longest runs do not fit in memory together; single runs are checked before."""
    if workers == 1 or request.stored is not None:
        return
    sizes = [
        run_bytes(one, method, n_steps, members=pack_size(one))
        for one in request.loaded.experiments
        for method in one.methods
        for n_steps in one.steps
    ]
    if words := shortage(sum(sorted(sizes)[-workers:]), " at the same time"):
        raise RequestError(
            f"--workers {workers}: the longest runs of {request.name} {words}; fewer processes "
            "need less"
        )
