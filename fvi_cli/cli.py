"""The command line: parse, call, print.

Exit codes: 0 done; 1 a run failed and its configuration did not expect it; 2 a request or
configuration that cannot be carried out; 3 a check did not hold; 130 interrupted. Standard output
carries results, standard error everything else.

The rest of the project is imported inside the commands, so that ``--help`` is quick.
"""

from __future__ import annotations

import functools
import logging
import os
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn, ParamSpec

import typer

import fvi_cli
from fvi_cli.errors import FviError, RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fvi_cli.campaign import Outcome, Settings

DONE, RUN_FAILED, WRONG_REQUEST, CHECK_FAILED, BROKEN_PIPE, INTERRUPTED = 0, 1, 2, 3, 141, 130

DEFAULT_TABLES = ("table-1", "table-2", "full-order")
DEFAULT_FIGURES = (
    "saturation",
    "damped-oscillator-comparison",
    "damped-oscillator",
    "bagley-torvik-1-2",
    "bagley-torvik-3-2",
    "bagley-torvik-3-2-long",
    "corrected-bdf3",
)

P = ParamSpec("P")

app = typer.Typer(
    name="fvi",
    help="Experiments with fractional variational integrators.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Configs = Annotated[
    list[str],
    typer.Argument(metavar="CONFIG", help="Files, or names of shipped configurations."),
]
Sources = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="CONFIG|FILE.h5",
        help="Files, names of shipped configurations, or results of `fvi run`.",
    ),
]
Output = Annotated[
    Path, typer.Option("--output", metavar="DIR", help="Folder for everything that is written.")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY.PATH=VALUE", help="Change an entry of the configuration; repeatable."
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="List every run and what would be done with it; no more.")
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Compute again what is stored already.")]
FailFast = Annotated[
    bool, typer.Option("--fail-fast", help="Stop at the first run that fails unexpectedly.")
]
AllowUnstable = Annotated[
    bool, typer.Option("--allow-unstable", help="Compute runs that are predicted to blow up.")
]
Workers = Annotated[
    int, typer.Option("--workers", min=1, metavar="N", help="Processes on this machine.")
]
Quiet = Annotated[
    bool,
    typer.Option(
        "-q", "--quiet", help="No progress, no remarks: results on stdout, errors on stderr."
    ),
]
Verbose = Annotated[
    bool, typer.Option("-v", "--verbose", help="Say more; show tracebacks of unexpected errors.")
]
RESULTS = Path("results")

_logger = logging.getLogger("fvi_cli")


def main() -> None:
    """Entry point of the command ``fvi``."""
    signal.signal(signal.SIGTERM, _interrupt)
    app(prog_name="fvi")


def _interrupt(signal_number: int, frame: object) -> NoReturn:
    """Let a termination leave through the same door as Ctrl-C: finished runs are kept."""
    raise KeyboardInterrupt


def _guarded(command: Callable[P, int]) -> Callable[P, None]:
    """Turn the value of `command`, and whatever it raises, into an exit code."""

    @functools.wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
        verbose = bool(kwargs.get("verbose"))
        _configure_logging(quiet=bool(kwargs.get("quiet")), verbose=verbose)
        try:
            code = command(*args, **kwargs)
            sys.stdout.flush()
        except RequestError as error:
            # as they are: the line may begin with file:line:column, as editors understand it
            _say(*error.complaints)
            code = WRONG_REQUEST
        except FviError as error:
            _say(f"fvi: {error}")
            code = WRONG_REQUEST
        except KeyboardInterrupt:
            _say("fvi: interrupted; finished runs are stored, the same command goes on from there")
            code = INTERRUPTED
        except BrokenPipeError:
            # whoever read the result has gone; the interpreter would complain once more at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = BROKEN_PIPE
        except OSError as error:
            # a folder that is not there, a full disk, no permission
            place = f"{error.filename}: " if error.filename else ""
            _say(f"fvi: {place}{error.strerror or error}")
            code = WRONG_REQUEST
        except Exception as error:
            # the last line of defence: nobody should have to read a traceback unasked
            if verbose:
                traceback.print_exc()
            _say(f"fvi: unexpected {type(error).__name__}: {error}")
            if not verbose:
                _say("fvi: this is a mistake of the program; -v shows where it happened")
            code = RUN_FAILED
        raise typer.Exit(code)

    return guarded


def _configure_logging(*, quiet: bool, verbose: bool) -> None:
    from fvi_cli.progress import configure_logging

    configure_logging(logging.ERROR if quiet else logging.DEBUG if verbose else logging.INFO)


def _say(*lines: str) -> None:
    for line in lines:
        print(line, file=sys.stderr)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        print(f"fvi {fvi_cli.__version__}")
        raise typer.Exit(DONE)


@app.command()
@_guarded
def run(
    configs: Configs,
    output: Output = RESULTS,
    overrides: Overrides = None,
    workers: Workers = 1,
    dry_run: DryRun = False,
    fresh: Fresh = False,
    fail_fast: FailFast = False,
    allow_unstable: AllowUnstable = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Compute every method of a configuration on every step size; store what comes out."""
    from fvi_cli import campaign, reports

    settings = campaign.Settings(
        output=output,
        workers=workers,
        fresh=fresh,
        fail_fast=fail_fast,
        show_progress=not quiet,
    )
    requests = campaign.gather(configs, overrides or (), allow_unstable=allow_unstable)
    if dry_run:
        print(reports.plans_as_text(campaign.plan(requests, settings)))
        return DONE
    outcomes: list[Outcome] = []
    for request in requests:
        computed = campaign.answer(request, settings)
        outcomes += computed
        print(reports.runs_as_text(computed))
        print(settings.path_of(request))
        if _stop(settings, computed):
            break
    return _code(outcomes)


@app.command()
@_guarded
def convergence(
    sources: Sources = None,
    output: Output = RESULTS,
    check: Annotated[
        bool,
        typer.Option("--check", help="Compare with the stored tables and write nothing."),
    ] = False,
    overrides: Overrides = None,
    workers: Workers = 1,
    dry_run: DryRun = False,
    fresh: Fresh = False,
    fail_fast: FailFast = False,
    allow_unstable: AllowUnstable = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Make tables of orders; without argument those of the paper and of full order."""
    from fvi_cli import campaign, reports
    from fvi_cli.output import tables

    directory = output / "tables"
    settings = campaign.Settings(
        output=output,
        workers=workers,
        fresh=fresh,
        fail_fast=fail_fast,
        show_progress=not quiet,
        keep=not check,
    )
    requests = campaign.gather(
        sources or DEFAULT_TABLES, overrides or (), allow_unstable=allow_unstable
    )
    if dry_run:
        print(reports.plans_as_text(campaign.plan(requests, settings)))
        return DONE
    outcomes: list[Outcome] = []
    differences: list[str] = []
    for request in requests:
        computed = campaign.answer(request, settings)
        outcomes += computed
        if _stop(settings, computed):
            break
        made = reports.order_tables(computed)
        if check:
            differences += tables.compare_with_tables(directory, request.name, made)
        else:
            written = tables.write_tables(directory, request.name, made)
            print(tables.summary_text(request.name, made), *written, "", sep="\n")
    return (_verdict(differences) if check else DONE) or _code(outcomes)


@app.command()
@_guarded
def plot(
    sources: Sources = None,
    output: Output = RESULTS,
    check: Annotated[
        bool,
        typer.Option("--check", help="Compare with what the stored figures show; write nothing."),
    ] = False,
    overrides: Overrides = None,
    workers: Workers = 1,
    dry_run: DryRun = False,
    fresh: Fresh = False,
    fail_fast: FailFast = False,
    allow_unstable: AllowUnstable = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Draw figures, from stored runs where there are any; without argument those of the paper."""
    from fvi_cli import campaign, reports
    from fvi_cli.output import figures

    settings = campaign.Settings(
        output=output,
        workers=workers,
        fresh=fresh,
        fail_fast=fail_fast,
        show_progress=not quiet,
        keep=not check,
        may_replace=False,
    )
    requests = campaign.gather(
        sources or DEFAULT_FIGURES, overrides or (), allow_unstable=allow_unstable
    )
    if dry_run:
        print(reports.plans_as_text(campaign.plan(requests, settings)))
        return DONE
    outcomes: list[Outcome] = []
    differences: list[str] = []
    if not sources:
        differences += _draw(figures.sketches(), output, check=check)
    for request in requests:
        computed = campaign.answer(request, settings)
        outcomes += computed
        if _stop(settings, computed):
            break
        studies = reports.studies(computed)
        for line in figures.left_out(studies):
            _logger.warning("%s", line)
        drawn = figures.figures_for(studies, name=request.name)
        differences += _draw(drawn, output, check=check)
    return (_verdict(differences) if check else DONE) or _code(outcomes)


@app.command()
@_guarded
def check(
    configs: Configs,
    overrides: Overrides = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Validate configurations and compute nothing."""
    from fvi_cli import campaign

    for request in campaign.gather(configs, overrides or ()):
        runs = sum(len(experiment.runs()) for experiment in request.loaded.experiments)
        experiments = len(request.loaded.experiments)
        what = f"{_counted(experiments, 'experiment')}, {_counted(runs, 'run')}"
        print(f"{request.loaded.path}: valid, {what}")
    return DONE


@app.command()
@_guarded
def show(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="Results of `fvi run`.")],
    config: Annotated[
        bool, typer.Option("--config", help="Print the configuration that made the file.")
    ] = False,
    verbose: Verbose = False,
) -> int:
    """List what a result file holds, or print the configuration that made it."""
    from fvi_cli import reports
    from fvi_cli.output.storage import list_runs, read_configuration

    if file.suffix in (".yaml", ".yml"):
        raise RequestError(
            f"{file}: is not a result file of fvi; `fvi check` and `fvi run` take configurations"
        )
    if not config:
        print(reports.contents_as_text(list_runs(file)))
        return DONE
    configuration = read_configuration(file)
    print(configuration.text, end="")
    for override in configuration.overrides:
        _logger.warning("made with --set %s", override)
    return DONE


@app.command()
@_guarded
def benchmark(
    output: Output = RESULTS,
    exponent: Annotated[
        int,
        typer.Option(
            "--exponent",
            min=8,
            max=22,
            metavar="E",
            help="Linear scenes take 2^E steps; fewer than 2^20 are a trial.",
        ),
    ] = 20,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Measure time, error and memory of the engine on this machine, beside the figures to meet."""
    from fvi_cli import reports

    print(*reports.write_benchmark(output, exponent), sep="\n")
    return DONE


@app.command()
@_guarded
def schema(verbose: Verbose = False) -> int:
    """Print the JSON schema of configurations, for editors."""
    import json

    from fvi_cli.config import json_schema

    print(json.dumps(json_schema(), indent=2))
    return DONE


@app.command()
@_guarded
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the experiment.")],
    kind: Annotated[
        str, typer.Option("--kind", metavar="KIND", help="Kind of the problem.")
    ] = "damped-oscillator",
    verbose: Verbose = False,
) -> int:
    """Write a commented configuration NAME.yaml to start from."""
    from fvi_cli import reports

    print(reports.write_starter(name, kind))
    return DONE


def _draw(figures: dict[str, Figure], output: Path, *, check: bool) -> list[str]:
    """Write figures and print their paths, or tell in what the stored ones differ."""
    from fvi_cli import reports

    if check:
        return reports.compare_figures(figures, output)
    for path in reports.write_figures(figures, output):
        print(path)
    return []


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _stop(settings: Settings, outcomes: Sequence[Outcome]) -> bool:
    return settings.fail_fast and any(outcome.unexpected for outcome in outcomes)


def _verdict(differences: Sequence[str]) -> int:
    """Exit code of a check; prints what differs."""
    for difference in differences:
        print(difference)
    if differences:
        _logger.error("stale: %d differences", len(differences))
        return CHECK_FAILED
    print("up to date")
    return DONE


def _code(outcomes: Sequence[Outcome]) -> int:
    """Exit code of runs; says on standard error what went wrong."""
    failed = [finished for outcome in outcomes for finished in outcome.unexpected]
    if failed:
        _logger.error("%d runs failed and their configuration did not expect it", len(failed))
    return RUN_FAILED if failed else DONE
