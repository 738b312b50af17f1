"""Common parts of commands: options, reading of configurations, output, and exit code."""

from __future__ import annotations

import functools
import inspect
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fvi_cli.cli import options
from fvi_cli.cli.exits import CHECK_FAILED, DONE, RUN_FAILED, guarded

if TYPE_CHECKING:
    from fvi_cli.config import LoadedConfig
    from fvi_cli.render.results import Results
    from fvi_cli.runner.progress import Task

    Show = Callable[[LoadedConfig, Any], None]

_logger = logging.getLogger("fvi_cli")

RUNS = ("output", "overrides", "workers", "dask", "shard", "fresh", "dry_run", "json")
STUDY = ("output", "overrides", "dry_run", "check", "json")
"""Options of commands that compute runs, and of other studies."""
WHOLE = "1/1"


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
    shard: options.Shard = WHOLE
    dry_run: options.DryRun = False
    fresh: options.Fresh = False
    json: options.Json = False
    quiet: options.Quiet = False
    verbose: options.Verbose = False
    document: dict[str, list[object]] = field(init=False, default_factory=dict)
    failures: list[str] = field(init=False, default_factory=list)

    def gather(self, sources: Sequence[str]) -> list[LoadedConfig]:
        """Read and check configurations, with the changes by options."""
        from fvi_cli.runner.request import gather

        return gather(sources, self.overrides or ())

    def runs(self, sources: Sequence[str], show: Show | None, **more: Any) -> int:
        """Compute and show the runs of configurations; returns the exit code."""
        from fvi_cli.runner.compute import plan, run

        compute = functools.partial(
            run, workers=self.workers, dask=self.dask, keep=not self.check, **more
        )
        if self.shard != WHOLE:
            # parts of others are missing
            show = lambda config, _: self.wrote([self.output / f"{config.name}.partial"])  # noqa: E731
        shared = {name: getattr(self, name) for name in ("output", "fresh", "shard")}
        return self.each(sources, plan, compute, show, **shared)

    def each(
        self,
        sources: Sequence[str],
        tasks: Callable[..., Sequence[Task]],
        compute: Callable[..., Any],
        show: Show | None = None,
        **settings: Any,
    ) -> int:
        """Compute and show the results of every configuration; returns the exit code.

        With ``--dry-run`` print the tasks.
        """
        from fvi_cli.render.results import failures

        configs = self.gather(sources)
        if self.dry_run:
            listed = [task.row for config in configs for task in tasks(config, **settings)]
            self.print_rows(tasks=listed)
            return DONE
        for config in configs:
            results = compute(config, progress=not self.quiet, **settings)
            if words := failures(results):
                self.failures.append(f"{config.name}: {words}")
            (show or self.show)(config, results)
        return self.close()

    def print_rows(self, **rows: Sequence[Mapping[str, object]]) -> None:
        """Print rows under one name, as a document or as columns."""
        from fvi_cli.render.json import document
        from fvi_cli.render.runs import columns_of

        ((_, own),) = rows.items()
        print(document(**rows) if self.json else columns_of(own, memory_bytes=","))

    def show(self, config: LoadedConfig, results: Results) -> None:
        """Print and write results, or with ``--check`` find differences from stored ones."""
        from fvi_cli import reports
        from fvi_cli.render.results import report_on, write

        report = report_on(results, config.name)
        for sheet in report.sheets if self.json else ():
            self.collect(sheet.name, [dict(row) for row in sheet.rows])
        if self.check:
            self.collect("differences", reports.compare(self.output / "tables", report))
            return
        if not self.json:
            print(reports.to_text(report.shown(verbose=self.verbose)), "", sep="\n")
        self.wrote(write(results, self.output, name=config.name))

    def wrote(self, paths: Sequence[Path]) -> None:
        """Name the files that were written."""
        self.collect("files", [path.as_posix() for path in paths])
        if not self.json and paths:
            print(*paths, sep="\n")

    def collect(self, name: str, rows: Sequence[object]) -> None:
        """Keep rows for the JSON document."""
        self.document.setdefault(name, []).extend(rows)

    def close(self) -> int:
        """Print the JSON document or the outcome of a check; returns the exit code."""
        differences = self.document.get("differences", [])
        if self.json:
            from fvi_cli.render.json import document

            print(document(**self.document))
        elif self.check:
            print(*(differences or ["up to date"]), sep="\n")
        for line in self.failures:
            _logger.error("%s", line)
        if self.failures:
            return RUN_FAILED
        return CHECK_FAILED if differences else DONE


class Command(NamedTuple):
    """A command as typer registers it."""

    name: str
    panel: str  # under which heading it is listed
    callback: Callable[..., None]


COMMANDS: list[Command] = []
"""All commands, in the order of the help."""


def command(panel: str, *shared: str) -> Callable[[Callable[..., int]], None]:
    """Make a function of a :class:`Call` a command with these of its options, after its own."""

    def register(body: Callable[..., int]) -> None:
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
        COMMANDS.append(Command(body.__name__.rstrip("_"), panel, guarded(called)))

    return register
