"""Common parts of commands: options, reading of requests, output, and exit code."""

from __future__ import annotations

import functools
import inspect
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fvi_cli.cli import options
from fvi_cli.cli.exits import CHECK_FAILED, DONE, RUN_FAILED, guarded

if TYPE_CHECKING:
    from fvi_cli.render.results import Results
    from fvi_cli.runner.outcome import Outcome
    from fvi_cli.runner.request import Request, Task

_logger = logging.getLogger("fvi_cli")

CONFIGURED = ("output", "overrides", "dry_run", "json")
COMPUTED = (*CONFIGURED, "workers", "dask", "fresh")
"""Options of commands that read configurations, and of those that compute runs."""


@dataclass(kw_only=True, eq=False)
class Call:
    """One call of a command: the options that it shares with others, and its results so far."""

    output: options.Output = Path("results")
    check: options.Check = False
    formats: options.Formats = None
    style: options.Style = None
    overrides: options.Overrides = None
    workers: options.Workers = 1
    dask: options.Dask = None
    shard: options.Shard = "1/1"
    dry_run: options.DryRun = False
    fresh: options.Fresh = False
    json: options.Json = False
    quiet: options.Quiet = False
    verbose: options.Verbose = False
    requests: Sequence[Request] = field(init=False, default=())
    files: list[Path] = field(init=False, default_factory=list)
    rows: dict[str, list[object]] = field(init=False, default_factory=dict)
    differences: list[str] = field(init=False, default_factory=list)
    failures: list[str] = field(init=False, default_factory=list)

    def gather(self, sources: Sequence[str], *, stores_runs: bool = False) -> Sequence[Request]:
        """Read and check configurations, with the changes by options."""
        from fvi_cli.runner.request import gather

        results = (lambda name: self.output / f"{name}.h5") if stores_runs else None
        self.requests = gather(sources, self.overrides or (), results=results)
        return self.requests

    def runs(self, request: Request, **more: bool) -> list[Outcome]:
        """Compute the runs of a request, or read those that are stored."""
        from fvi_cli.runner.compute import run

        outcomes = run(
            request,
            output=self.output,
            workers=self.workers,
            dask=self.dask,
            fresh=self.fresh,
            keep=not self.check,
            shard=self.shard,
            progress=not self.quiet,
            **more,
        )
        self.note(request, outcomes)
        return outcomes

    def note(self, request: Request, results: Results) -> None:
        """Keep failures in the results, which determine the exit code."""
        from fvi_cli.render.results import failures

        if words := failures(results):
            self.failures.append(f"{request.name}: {words}")

    def each(
        self,
        compute: Callable[[Request], Any],
        show: Callable[[Request, Any], None] | None = None,
        *,
        tasks: Callable[[Request], Sequence[Task]] | None = None,
    ) -> int:
        """Compute and show the results of every request; returns the exit code.

        With ``--dry-run`` print `tasks`, or plans of runs.
        """
        if self.dry_run:
            return self.show_plans() if tasks is None else self.show_tasks(tasks)
        for request in self.requests:
            (show or self.show)(request, compute(request))
        return self.close()

    def show_plans(self) -> int:
        """Print what would be done with every run."""
        from fvi_cli.render.json import document, planned_run
        from fvi_cli.render.plans import plans_as_text
        from fvi_cli.runner.plan import plan

        asked = {n: getattr(self, n) for n in ("output", "workers", "fresh", "shard")}
        plans = [one for request in self.requests for one in plan(request, **asked)]
        found = map(planned_run, plans)
        print(document(runs=list(found)) if self.json else plans_as_text(plans))
        return DONE

    def show_tasks(self, tasks: Callable[[Request], Sequence[Task]]) -> int:
        """Print results other than runs that would be computed."""
        from fvi_cli.render.json import document
        from fvi_cli.render.runs import columns_of

        rows = [asdict(task) for request in self.requests for task in tasks(request)]
        print(document(tasks=rows) if self.json else columns_of(rows))
        return DONE

    def show(self, request: Request, results: Results) -> None:
        """Print and write results, or with ``--check`` find differences from stored ones."""
        from fvi_cli import reports
        from fvi_cli.render.results import report_on, write
        from fvi_cli.reports.writers import to_text

        self.note(request, results)
        report = report_on(results, request.name)
        if self.json:
            self.collect({one.name: [dict(row) for row in one.rows] for one in report.sheets})
        if self.check:
            self.differences += reports.compare(self.output / "tables", report)
            return
        if not self.json:
            print(to_text(report.summary), "", sep="\n")
        self.wrote(write(results, self.output, name=request.name))

    def wrote(self, paths: Sequence[Path]) -> None:
        """Name the files that were written."""
        self.files += paths
        if not self.json and paths:
            print(*paths, sep="\n")

    def collect(self, rows: Mapping[str, Sequence[object]]) -> None:
        """Keep rows for the JSON document."""
        for name, own in rows.items():
            self.rows.setdefault(name, []).extend(own)

    def close(self) -> int:
        """Print the JSON document or the outcome of a check; returns the exit code."""
        if self.json:
            from fvi_cli.render.json import document

            files = [path.as_posix() for path in self.files]
            found = {"differences": self.differences} if self.check else {"files": files}
            print(document(**found, **self.rows))
        elif self.check:
            print(*(self.differences or ["up to date"]), sep="\n")
        if self.differences:
            _logger.error("stale: %d differences", len(self.differences))
        for line in self.failures:
            _logger.error("%s", line)
        if self.failures:
            return RUN_FAILED
        return CHECK_FAILED if self.differences else DONE


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command as typer registers it."""

    name: str
    panel: str  # under which heading it is listed
    examples: tuple[str, ...]
    callback: Callable[..., None]


def command(
    panel: str, *shared: str, examples: Sequence[str] = ()
) -> Callable[[Callable[..., int]], Command]:
    """Make a function of a :class:`Call` a command with these of its options, after its own."""

    def made(body: Callable[..., int]) -> Command:
        known = inspect.signature(Call, eval_str=True).parameters
        chosen = [known[name] for name in (*shared, "quiet", "verbose")]
        _, *own = inspect.signature(body, eval_str=True).parameters.values()

        @functools.wraps(body)
        def called(**given: Any) -> int:
            call = Call(**{one.name: given.pop(one.name) for one in chosen})
            return body(call, **given)

        called.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in (*own, *chosen)]
        )
        name = body.__name__.rstrip("_")
        return Command(name=name, panel=panel, examples=tuple(examples), callback=guarded(called))

    return made
