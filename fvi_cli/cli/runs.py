"""What every command begins with that runs, and how its results are told."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fvi_cli.cli.exits import DONE, exit_code, verdict
from fvi_cli.cli.options import (
    RESULTS,
    AllowUnstable,
    Dask,
    DryRun,
    FailFast,
    Fresh,
    Output,
    Overrides,
    Quiet,
    Verbose,
    Wait,
    Workers,
)

if TYPE_CHECKING:
    from fvi_cli.render.results import Results
    from fvi_cli.runner.outcome import Outcome
    from fvi_cli.runner.plan import PlannedRun
    from fvi_cli.runner.request import Request
    from fvi_cli.runner.settings import Settings


@dataclass(kw_only=True, eq=False)
class Runs:
    """What the shared options of a command ask for, and what came of it so far.

    Parameters
    ----------
    settings
        How everything is run.
    overrides, allow_unstable
        What is changed in configurations.
    is_dry, is_verbose
        The options ``--dry-run`` and ``--verbose``.
    requests
        What is run; none before :meth:`gather`.
    outcomes, differences
        Of the requests that are finished.
    """

    settings: Settings
    overrides: Sequence[str]
    allow_unstable: bool
    is_dry: bool
    is_verbose: bool
    requests: Sequence[Request] = ()
    outcomes: list[Outcome] = field(default_factory=list)
    differences: list[str] = field(default_factory=list)

    def gather(self, sources: Sequence[str]) -> None:
        """Read and check configurations, with ``--set`` and ``--allow-unstable``."""
        from fvi_cli.runner.request import gather

        self.requests = gather(
            sources,
            self.overrides,
            allow_unstable=self.allow_unstable,
            checks_member=self.settings.shard.checks_member,
        )

    def plans(self) -> list[PlannedRun]:
        """What would be done with every run."""
        from fvi_cli.runner.plan import plan_runs

        return plan_runs(self.requests, self.settings)

    def show_plans(self) -> int:
        """Print the plans; returns the exit code."""
        from fvi_cli.render.plans import plans_as_text

        print(plans_as_text(self.plans(), in_full=self.is_verbose))
        return DONE

    def finished(self) -> Iterator[tuple[Request, list[Outcome]]]:
        """Every request with its outcomes, as soon as it is finished."""
        from fvi_cli.runner.run import run_requests

        for request, computed in run_requests(self.requests, self.settings):
            self.outcomes += computed
            yield request, computed

    def succeeded(self) -> Iterator[tuple[str, list[Outcome]]]:
        """The same by name, but for a failure that ends the command."""
        for request, computed in self.finished():
            if not self.settings.ends_with(computed):
                yield request.name, computed

    def tell(self, results: Results, name: str) -> None:
        """Print and write results, or compare them if nothing is kept."""
        output, anew = self.settings.output, self.settings.fresh
        is_check = not self.settings.keep
        self.differences += tell(results, name, output, is_check=is_check, anew=anew)

    @property
    def code(self) -> int:
        """Exit code of the command."""
        return (DONE if self.settings.keep else verdict(self.differences)) or exit_code(
            self.outcomes
        )


def begin(
    output: Output = RESULTS,
    overrides: Overrides = None,
    workers: Workers = 1,
    dask: Dask = None,
    wait: Wait = False,
    dry_run: DryRun = False,
    fresh: Fresh = False,
    fail_fast: FailFast = False,
    allow_unstable: AllowUnstable = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    *,
    check: bool = False,
) -> Runs:
    """What these options ask for; a command may have ``--check`` among its own."""
    from fvi_cli.runner.settings import Settings

    settings = Settings(
        output=output,
        workers=workers,
        dask=dask,
        fresh=fresh,
        fail_fast=fail_fast,
        show_progress=not quiet,
        keep=not check,
        waits=wait,
    )
    return Runs(
        settings=settings,
        overrides=overrides or (),
        allow_unstable=allow_unstable,
        is_dry=dry_run,
        is_verbose=verbose,
    )


def with_runs(command: Callable[..., int]) -> Callable[..., int]:
    """Give a command the options of :func:`begin` behind its own, and what they ask for."""
    _, *own = inspect.signature(command, eval_str=True).parameters.values()
    *shared, _ = inspect.signature(begin, eval_str=True).parameters.values()

    @functools.wraps(command)
    def begun(**options: Any) -> int:
        common = {one.name: options.pop(one.name) for one in shared}
        runs = begin(**common, check=options.get("check", False))
        return command(runs, **options)

    begun.__signature__ = inspect.Signature([*own, *shared])  # type: ignore[attr-defined]
    return begun


def tell(
    results: Results, name: str | None, output: Path, *, is_check: bool, anew: bool = False
) -> list[str]:
    """Print and write results, or with ``--check`` say in what the stored ones differ."""
    from fvi_cli.render.results import compare, show, write

    if is_check:
        return compare(results, output, name=name)
    paths = write(results, output, name=name, anew=anew)
    show(results, name=name)
    print("", *paths, "", sep="\n")
    return []
