"""How results of every kind are printed, drawn, written and compared."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from fvi_cli import reports
from fvi_cli.errors import RequestError
from fvi_cli.render.figures import write_figures
from fvi_cli.render.json import fit_as_json, run_as_json
from fvi_cli.render.runs import contents_as_text, runs_as_text
from fvi_cli.reports import Report
from fvi_cli.reports.kinds.cost import cost_report
from fvi_cli.reports.kinds.fit import fit_report
from fvi_cli.reports.kinds.orders import order_report
from fvi_cli.reports.kinds.quantities import quantities_report
from fvi_cli.reports.kinds.stability import stability_report
from fvi_cli.reports.kinds.vibration import mode_report, response_report
from fvi_cli.reports.writers import to_text
from fvi_cli.runner.outcome import Outcome
from fvi_cli.storage import StoredFile
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.figure_settings import FigureSettings
from fvi_cli.studies.fits.result import FitResult
from fvi_cli.studies.order import OrderTable
from fvi_cli.studies.order import tables_of_members as tables_of_orders
from fvi_cli.studies.stability_study import StabilityTable
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table: TypeAlias = OrderTable | StabilityTable | CostTable | FitResult | ModeTable | ResponseTable
Result: TypeAlias = Outcome | Table | Report | StoredFile
Results: TypeAlias = Result | Sequence[Result]
Found: TypeAlias = Sequence[Any]
"""Results of one kind."""


@dataclass(frozen=True, kw_only=True)
class ResultKind:
    """A kind of result, and what is made of results of it."""

    # called with a name and the results; None for kinds without a report or without figures
    report: Callable[[str, Found], Report] | None = None
    figures: Callable[[str, Found], Mapping[str, Figure]] | None = None
    # what a terminal shows in place of the summary of the report
    text: Callable[[Found], str] | None = None
    # a line for each unexpected failure
    failures: Callable[[Found], list[str]] = lambda found: []
    words: str = "runs failed unexpectedly"  # said after the number of failures
    is_written: bool = True  # whether files are kept of it
    is_compared: bool = True  # whether these are the same on every run
    # writes further files, given the beginning of their paths and the results
    further: Callable[[Path, Found], list[Path]] = lambda beginning, found: []
    # where a JSON document says more than the report: its key, and the values for one result
    key: str = ""
    values: Callable[[Any], list[object]] = lambda one: []


def _drawing(module: str, name: str) -> Callable[[str, Found], Mapping[str, Figure]]:
    """A function of `plotting`, which is loaded when something is drawn."""
    return lambda title, found: getattr(importlib.import_module(module), name)(title, found)


def _outcome_figures(title: str, outcomes: Sequence[Outcome]) -> dict[str, Figure]:
    from fvi_cli.plotting import figures_for

    return figures_for(studies(outcomes), name=title)


def _mode_shapes(beginning: Path, tables: Sequence[ModeTable]) -> list[Path]:
    from fvi_cli.storage.mode_shapes import write_mode_shapes

    path = beginning.with_name(f"{beginning.name}-modes.h5")
    write_mode_shapes(path, tables)
    return [path]


KINDS: Mapping[type, ResultKind] = {
    Outcome: ResultKind(
        report=lambda name, found: order_report(name, order_tables(found)),
        figures=_outcome_figures,
        text=runs_as_text,
        failures=lambda found: [run.run.title for one in found for run in one.unexpected],
        key="runs",
        values=lambda outcome: [run_as_json(one) for one in outcome.finished],
    ),
    StoredFile: ResultKind(
        text=lambda found: contents_as_text(found[0]), is_written=False, is_compared=False
    ),
    Report: ResultKind(report=lambda name, found: found[0]),
    OrderTable: ResultKind(report=order_report),
    StabilityTable: ResultKind(
        report=stability_report,
        figures=_drawing("fvi_cli.plotting.kinds.stability", "stability_figures"),
        failures=lambda found: [row.failure for one in found for row in one.rows if row.failure],
    ),
    CostTable: ResultKind(
        report=cost_report,
        figures=_drawing("fvi_cli.plotting.kinds.convergence", "cost_figures"),
        failures=lambda found: [line for one in found for line in one.unexpected],
        is_compared=False,
    ),
    FitResult: ResultKind(
        report=fit_report,
        figures=_drawing("fvi_cli.plotting.kinds.fits", "fit_figures"),
        failures=lambda found: [one.name for one in found if not one.is_converged],
        words="fits did not converge",
        key="fits",
        values=fit_as_json,
    ),
    ModeTable: ResultKind(
        report=mode_report,
        figures=_drawing("fvi_cli.plotting.kinds.spectra", "mode_figures"),
        failures=lambda found: [one.name for one in found if not one.is_complete],
        words="tables may lack modes",
        further=_mode_shapes,
    ),
    ResponseTable: ResultKind(
        report=response_report,
        figures=_drawing("fvi_cli.plotting.kinds.spectra", "response_figures"),
    ),
}


def result_kind(results: Results) -> tuple[ResultKind, Found]:
    """The kind of `results`, and the results one by one; none at all are outcomes.

    Raises
    ------
    RequestError
        For a mixture.
    """
    found = [results] if isinstance(results, tuple(KINDS)) else list(results)  # type: ignore[arg-type]
    kinds = {type(one) for one in found} or {Outcome}
    if len(kinds) > 1:
        raise RequestError("results of different kinds: call once for each kind")
    return KINDS[kinds.pop()], found


def as_text(results: Results, *, name: str | None = None) -> str:
    """What a terminal shows of `results`: of one kind, or the contents of a result file.

    Their `name` is by default that of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name.
    """
    kind, found = result_kind(results)
    if kind.text is not None and found:
        return kind.text(found)
    return to_text(report_on(results, name).summary)


def summary_of(results: Results, *, name: str | None = None) -> str:
    """The summary of the report on `results`."""
    return to_text(report_on(results, name).summary)


def report_on(results: Results, name: str | None = None) -> Report:
    """The report on results of one kind; for outcomes the report on orders."""
    kind, found = result_kind(results)
    if kind.report is None:
        raise RequestError("contents of result files have no report")
    return kind.report(name or _only_name(found), found)


def json_rows(results: Results, name: str | None = None) -> dict[str, list[object]]:
    """Results as JSON values: runs and fits in full, of others the rows of their report."""
    kind, found = result_kind(results)
    if kind.key:
        return {kind.key: [row for one in found for row in kind.values(one)]}
    return {
        sheet.name: [dict(row) for row in sheet.rows] for sheet in report_on(results, name).sheets
    }


def figures(results: Results, *, name: str | None = None) -> dict[str, Figure]:
    """Figures of outcomes, fits, or tables that have some, by name; none is written.

    Their names begin with `name`, by default that of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or where there is no picture.
    """
    kind, found = result_kind(results)
    if kind.figures is None:
        raise RequestError(
            "only outcomes, fits, and tables of stability, cost, modes and responses have figures"
        )
    return dict(kind.figures(name or _only_name(found), found))


def write(
    results: Results,
    output: Path | str,
    *,
    name: str | None = None,
    formats: Sequence[str] = (),
) -> list[Path]:
    """Write tables and figures as the commands do, into folders of `output`; returns the paths.

    Of outcomes: the tables of ``fvi convergence`` and the figures of ``fvi plot``. Of everything
    else: what its command writes, of modes also their shapes, ``<name>-modes.h5``. Files begin with
    `name`, by default that of the only experiment. Pictures are PNG, or in these `formats`.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name.
    StorageError
        If the folder or a file cannot be written.
    """
    kind, found = result_kind(results)
    if not kind.is_written:
        raise RequestError("what a result file holds is not written")
    folder, title = Path(output), name or _only_name(found)
    drawn = kind.figures(title, found) if kind.figures else {}
    paths = reports.write(folder / "tables", report_on(results, title))
    paths += write_figures(drawn, folder, formats=formats)
    return paths + kind.further(folder / title, found)


def compare(results: Results, output: Path | str, *, name: str | None = None) -> list[str]:
    """One line for everything in which stored tables differ, as ``--check`` reports.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or for costs and what a file holds.
    """
    kind, found = result_kind(results)
    if not kind.is_compared:
        raise RequestError(
            "costs cannot be compared, as times differ from run to run, nor what a "
            "result file holds"
        )
    title = name or _only_name(found)
    return reports.compare(Path(output) / "tables", report_on(results, title))


def _only_name(found: Found) -> str:
    """The name of the only experiment; of a report none is needed."""
    names: set[str] = set()
    for one in found:
        if isinstance(one, Report):
            return ""
        experiment: Any = getattr(one, "experiment", one)
        names.add(experiment if isinstance(experiment, str) else experiment.name)
    if len(names) != 1:
        raise RequestError(
            f"name: needed, there are {len(names)} experiments: {', '.join(sorted(names))}"
            if names
            else "name: missing; the results have no name of their own"
        )
    return names.pop()


def order_tables(outcomes: Outcome | Sequence[Outcome]) -> list[OrderTable]:
    """Tables of orders as ``fvi convergence`` makes them, one for every experiment.

    Of a sweep one for every member.
    """
    listed = [outcomes] if isinstance(outcomes, Outcome) else outcomes
    return [table for one in listed for table in tables_of_orders(one.experiment, one.finished)]


def quantities(outcomes: Outcome | Sequence[Outcome], *, name: str | None = None) -> Report:
    """Quantities and events of all runs and a table of named members, as of ``fvi quantities``.

    The rows stand in its sheets; :func:`as_text` shows it, :func:`write` makes files of it.

    Raises
    ------
    RequestError
        Where none are asked for, or a name is needed.
    """
    listed = [outcomes] if isinstance(outcomes, Outcome) else list(outcomes)
    title = name or _only_name(listed)
    finished = [one for outcome in listed for one in outcome.finished]
    is_ensemble = any(
        isinstance(one, FigureSettings) and one.ensemble
        for outcome in listed
        for one in outcome.experiment.figures
    )
    if not is_ensemble and not any(one.trajectory.observed is not None for one in finished):
        raise RequestError(
            f"{title}: no quantities, events or impacts are asked for; give for example "
            "quantities: {top: ax}"
        )
    return quantities_report(title, finished)


def studies(outcomes: Sequence[Outcome]) -> list[tuple[Experiment, tuple[FinishedRun, ...]]]:
    """Experiments with their finished runs."""
    return [(outcome.experiment, outcome.finished) for outcome in outcomes]
