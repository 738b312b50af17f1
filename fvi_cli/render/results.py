"""How results of every kind are printed, drawn, written and compared."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from fvi_cli import reports
from fvi_cli.errors import RequestError
from fvi_cli.render.runs import contents_as_text, runs_as_text
from fvi_cli.reports import Report
from fvi_cli.reports.kinds.cost import cost_report
from fvi_cli.reports.kinds.fit import fit_report
from fvi_cli.reports.kinds.orders import order_report
from fvi_cli.reports.kinds.quantities import quantities_report
from fvi_cli.reports.kinds.stability import stability_report
from fvi_cli.reports.kinds.vibration import mode_report, response_report
from fvi_cli.runner.outcome import Outcome
from fvi_cli.storage import StoredFile
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.fits.result import FitResult
from fvi_cli.studies.order import OrderTable
from fvi_cli.studies.order import tables_of_members as tables_of_orders
from fvi_cli.studies.study import StabilityTable
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table = OrderTable | StabilityTable | CostTable | FitResult | ModeTable | ResponseTable
Result = Outcome | Table | Report | StoredFile
Results = Result | Sequence[Result]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of result: its report, its figures, and what counts as a failure."""

    report: Callable[[str, Any], Report]
    drawing: str = ""  # function of the name and the results, in a module of plotting.kinds
    failed: Callable[[Any], int] = lambda found: 0  # number of failures in one result
    failure: str = ""  # their name


KINDS: Final[Mapping[type, Kind]] = {
    Outcome: Kind(
        report=lambda name, found: order_report(name, order_tables(found)),
        failed=lambda one: len(one.unexpected),
        failure="runs failed unexpectedly",
    ),
    OrderTable: Kind(report=order_report),
    Report: Kind(report=lambda name, found: found[0]),
    StabilityTable: Kind(
        report=stability_report,
        drawing="stability.stability_figures",
    ),
    CostTable: Kind(
        report=cost_report,
        drawing="convergence.cost_figures",
        failed=lambda one: len(one.unexpected),
        failure="runs failed unexpectedly",
    ),
    FitResult: Kind(
        report=fit_report,
        drawing="fits.fit_figures",
        failed=lambda one: not one.is_converged,
        failure="fits did not converge",
    ),
    ModeTable: Kind(
        report=mode_report,
        drawing="spectra.mode_figures",
        failed=lambda one: not one.is_complete,
        failure="tables may lack modes",
    ),
    ResponseTable: Kind(report=response_report, drawing="spectra.response_figures"),
}


def as_text(results: Results, *, name: str | None = None) -> str:
    """What a terminal shows of `results`: of one kind, or the contents of a result file.

    Their `name` is by default that of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name.
    """
    kind, found = _sorted(results)
    if kind is StoredFile:
        return contents_as_text(found[0])
    if kind is Outcome:
        return runs_as_text(found)
    return reports.to_text(report_on(results, name).shown())


def report_on(results: Results, name: str | None = None) -> Report:
    """The report on results of one kind; for outcomes the report on orders."""
    kind, found = _sorted(results)
    if kind not in KINDS:
        raise RequestError("there is no report on what a result file holds")
    return KINDS[kind].report(name or _only_name(found), found)


def figures(results: Results, *, name: str | None = None) -> dict[str, Figure]:
    """Figures of outcomes, fits, or tables that have some, by name; none is written.

    Their names begin with `name`, by default that of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or where there is no picture.
    """
    kind, found = _sorted(results)
    title = name or _only_name(found)
    if kind is Outcome:
        from fvi_cli.plotting import draw_figures

        return draw_figures(studies(found), name=title)[0]
    if kind not in KINDS or not KINDS[kind].drawing:
        raise RequestError(
            "only outcomes, fits, and tables of stability, cost, modes and responses have figures"
        )
    module, _, function = KINDS[kind].drawing.partition(".")
    draw = getattr(importlib.import_module(f"fvi_cli.plotting.kinds.{module}"), function)
    return dict(draw(title, found))


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
    kind, found = _sorted(results)
    report, folder = report_on(results, name), Path(output)
    title = name or _only_name(found)
    paths = reports.write(folder / "tables", report)
    if kind is Outcome or KINDS[kind].drawing:
        paths += write_figures(figures(results, name=title), folder, formats=formats)
    if kind is ModeTable:
        from fvi_cli.storage.mode_shapes import write_mode_shapes

        paths.append(folder / f"{title}-modes.h5")
        write_mode_shapes(paths[-1], found)
    return paths


def write_figures(
    drawn: Mapping[str, Figure], output: Path, *, formats: Sequence[str] = ()
) -> list[Path]:
    """Write figures under ``figures/`` in `output`, as PNG or in `formats`; returns the paths."""
    if not drawn:
        return []
    # a slow import, which tables do not need
    from fvi_cli.plotting import FORMATS, save_figure

    forms, folder = list(dict.fromkeys(formats or FORMATS[:1])), output / "figures"
    return [p for name, one in drawn.items() for p in save_figure(one, folder, name, forms)]


def failures(results: Results) -> str:
    """How many of the results failed that were not expected to, in words; empty: none."""
    kind, found = _sorted(results)
    count = sum(map(KINDS[kind].failed, found))
    return f"{count} {KINDS[kind].failure}" if count else ""


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
    if all(one.trajectory.observed is None for one in finished):
        raise RequestError(
            f"{title}: no quantities, events or impacts are asked for; give for example "
            "quantities: {top: ax}"
        )
    return quantities_report(title, finished)


def studies(outcomes: Sequence[Outcome]) -> list[tuple[Experiment, tuple[FinishedRun, ...]]]:
    """Experiments with their finished runs."""
    return [(outcome.experiment, outcome.finished) for outcome in outcomes]


def _sorted(results: Results) -> tuple[type, list[Any]]:
    """The kind of `results`, and the results one by one; none at all are outcomes."""
    found = list(results) if isinstance(results, Sequence) else [results]
    kinds = {type(one) for one in found} or {Outcome}
    if len(kinds) > 1:
        raise RequestError("results of different kinds: call once for each kind")
    return kinds.pop(), found


def _only_name(found: Sequence[Any]) -> str:
    """The name of the only experiment; a report has its own."""
    experiments = [getattr(one, "experiment", one) for one in found]
    names = sorted({one if isinstance(one, str) else one.name for one in experiments})
    if len(names) != 1:
        raise RequestError(
            f"name: needed, there are {len(names)} experiments: {', '.join(names)}"
            if names
            else "name: missing; the results have no name of their own"
        )
    return names[0]
