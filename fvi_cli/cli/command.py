"""Common parts of commands: options, reading of requests, output, and exit code."""

from __future__ import annotations

import functools
import inspect
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fvi_cli.cli.exits import CHECK_FAILED, DONE, RUN_FAILED, guarded
from fvi_cli.cli.options import (
    RESULTS,
    Check,
    Dask,
    DryRun,
    Formats,
    Fresh,
    Json,
    Output,
    Overrides,
    Quiet,
    Shard,
    Style,
    Verbose,
    Workers,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fvi_cli.render.results import Results
    from fvi_cli.runner.request import Request, Task

_logger = logging.getLogger("fvi_cli")

ALWAYS = ("quiet", "verbose")
CONFIGURED = ("output", "overrides", "dry_run", "json")
COMPUTED = (*CONFIGURED, "workers", "dask", "fresh")
"""Shared options: of all commands, of those that read configurations, that compute runs."""


@dataclass(kw_only=True, eq=False)
class Call:
    """One call of a command: its shared options, and its results so far."""

    output: Output = RESULTS
    check: Check = False
    formats: Formats = None
    style: Style = None
    overrides: Overrides = None
    workers: Workers = 1
    dask: Dask = None
    shard: Shard = "1/1"
    dry_run: DryRun = False
    fresh: Fresh = False
    json: Json = False
    quiet: Quiet = False
    verbose: Verbose = False
    stores_runs: bool = field(init=False, default=False)
    requests: Sequence[Request] = field(init=False, default=())
    files: list[Path] = field(init=False, default_factory=list)
    rows: dict[str, list[object]] = field(init=False, default_factory=dict)
    differences: list[str] = field(init=False, default_factory=list)
    failures: dict[str, int] = field(init=False, default_factory=dict)

    def gather(self, sources: Sequence[str]) -> Sequence[Request]:
        """Read and check configurations, with the changes by options."""
        from fvi_cli.runner.request import gather

        results = (lambda name: self.output / f"{name}.h5") if self.stores_runs else None
        self.requests = gather(sources, self.overrides or (), results=results)
        return self.requests

    @property
    def keep(self) -> bool:
        """Whether computed runs are stored."""
        return not self.check

    @property
    def progress(self) -> bool:
        """Whether a progress bar is drawn."""
        return not self.quiet

    def options_of(self, called: Callable[..., object]) -> dict[str, Any]:
        """The shared options that are arguments of a function of the api."""
        names = inspect.signature(called).parameters
        return {name: getattr(self, name) for name in names if hasattr(self, name)}

    def show_plans(self) -> int:
        """Print the plan of every run."""
        from fvi_cli.render.json import plans_as_json
        from fvi_cli.render.plans import plans_as_text
        from fvi_cli.runner.plan import plan

        options = self.options_of(plan)
        plans = [one for request in self.requests for one in plan(request, **options)]
        print(plans_as_json(plans) if self.json else plans_as_text(plans))
        return DONE

    def show_tasks(self, tasks_of: Callable[[Request], Sequence[Task]]) -> int:
        """Print the tasks: results other than runs that would be computed."""
        from fvi_cli.render.json import document
        from fvi_cli.render.runs import columns_of_words

        rows = [asdict(task) for request in self.requests for task in tasks_of(request)]
        if self.json:
            print(document({"tasks": rows}))
        else:
            print(columns_of_words([list(rows[0]), *(list(row.values()) for row in rows)]))
        return DONE

    def note(self, results: Results) -> None:
        """Count failures in the results, which determine the exit code."""
        from fvi_cli.render.results import result_kind

        kind, found = result_kind(results)
        if failed := len(kind.failures(found)):
            self.failures[kind.words] = self.failures.get(kind.words, 0) + failed

    def each(
        self,
        compute: Callable[..., Any],
        show: Callable[[Any, Request], None] | None = None,
        *,
        report: Callable[[Any, Request], Any] | None = None,
        tasks: Callable[[Request], Sequence[Task]] | None = None,
        **options: object,
    ) -> int:
        """Compute every request and show the results; returns the exit code.

        `compute` is a function of the api; it gets a request, its arguments among the shared
        options, and `options`. `report` converts the results for output; `show` prints them
        (default :meth:`show`). With ``--dry-run`` the command prints `tasks`, or plans of runs.
        """
        from fvi_cli.render.figures import drawn_as

        if self.dry_run:
            return self.show_plans() if tasks is None else self.show_tasks(tasks)
        options |= self.options_of(compute)
        with drawn_as(self.formats or (), self.style):
            for request in self.requests:
                results = compute(request, **options)
                self.note(results)
                found = results if report is None else report(results, request)
                (show or self.show)(found, request)
        return self.close()

    def show(
        self,
        results: Results,
        request: Request | None = None,
        *,
        also: Callable[[], list[Path]] = list,
    ) -> None:
        """Print and write results, or with ``--check`` find differences from stored ones.

        `also` writes further files.
        """
        from fvi_cli.render.results import compare, json_rows, summary_of, write

        name = None if request is None else request.name
        paths = list[Path]()
        if self.check:
            self.differences += compare(results, self.output, name=name)
        else:
            paths = write(results, self.output, name=name)
            paths += also()
        self.files += paths
        if self.json:
            self.collect(json_rows(results, name))
        elif not self.check:
            print(summary_of(results, name=name), "", *paths, "", sep="\n")

    def show_figures(self, drawn: Mapping[str, Figure]) -> None:
        """Write figures."""
        from fvi_cli.render.figures import write_figures

        paths = write_figures(drawn, self.output, formats=self.formats or ())
        self.files += paths
        if not self.json:
            print(*paths, sep="\n")

    def collect(self, rows: Mapping[str, Sequence[object]]) -> None:
        """Keep rows for the JSON document."""
        for name, own in rows.items():
            self.rows.setdefault(name, []).extend(own)

    def close(self) -> int:
        """Print the JSON document or the outcome of a check; returns the exit code."""
        from fvi_cli.render.json import document

        if self.json:
            paths = {"files": [path.as_posix() for path in self.files]}
            print(
                document(
                    {**({"differences": self.differences} if self.check else paths), **self.rows}
                )
            )
        elif self.check:
            print(*(self.differences or ["up to date"]), sep="\n")
        if self.differences:
            _logger.error("stale: %d differences", len(self.differences))
        for words, count in self.failures.items():
            _logger.error("%d %s", count, words)
        if self.failures:
            return RUN_FAILED
        return CHECK_FAILED if self.differences else DONE


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command: its function, its options among those of :class:`Call`, and examples."""

    body: Callable[..., int]
    shared: tuple[str, ...]
    examples: str

    @property
    def name(self) -> str:
        """The name of the command on the command line."""
        return self.body.__name__.rstrip("_").replace("_", "-")

    @property
    def summary(self) -> str:
        """The first line of its help."""
        return (self.body.__doc__ or "").partition("\n")[0]

    def callback(self) -> Callable[..., None]:
        """The function for typer, with the shared options after the command's own."""
        _, *own = inspect.signature(self.body, eval_str=True).parameters.values()
        known = inspect.signature(Call, eval_str=True).parameters.values()
        shared = [one for one in known if one.name in (*self.shared, *ALWAYS)]

        @functools.wraps(self.body)
        def begun(**options: Any) -> int:
            call = Call(**{one.name: options.pop(one.name) for one in shared})
            call.stores_runs = "fresh" in self.shared
            return self.body(call, **options)

        begun.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in (*own, *shared)]
        )
        return guarded(begun)


def command(*shared: str, examples: str = "") -> Callable[[Callable[..., int]], Command]:
    """Make a function of a :class:`Call` a command with these shared options."""
    return lambda body: Command(body=body, shared=shared, examples=examples)
