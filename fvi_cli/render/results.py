"""What the commands print, write and compare, for whatever kind of result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from fvi_cli import reports as tables
from fvi_cli.errors import RequestError
from fvi_cli.render import cost as cost_reports
from fvi_cli.render import runs as reports
from fvi_cli.render import stability as stability_reports
from fvi_cli.reports import hard_cases as hard_case_tables
from fvi_cli.reports.stability import stability_text
from fvi_cli.runner.campaign import Outcome, Plan
from fvi_cli.storage import StoredFile
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.hard_cases.case import HardCaseReport
from fvi_cli.studies.order import OrderTable
from fvi_cli.studies.stability_study import StabilityTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Result: TypeAlias = Outcome | OrderTable | StabilityTable | CostTable | Plan
Results: TypeAlias = Sequence[Result] | HardCaseReport
Kind = TypeVar("Kind")


def as_text(results: Results | StoredFile, *, name: str | None = None) -> str:
    """What a terminal shows of `results`.

    Parameters
    ----------
    results
        Outcomes of runs, order tables, tables of stability or cost, plans (each a list of one
        kind), the report of the hard cases, or the contents of a result file.
    name
        Name of the whole in the heading; default that of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name.
    """
    if isinstance(results, HardCaseReport):
        return hard_case_tables.report_text(results)
    if isinstance(results, StoredFile):
        return reports.contents_as_text(results)
    if outcomes := _of(results, Outcome):
        return reports.runs_as_text(outcomes)
    if plans := _of(results, Plan):
        return reports.plans_as_text(plans)
    title = name or _only_name(results)
    if orders := _of(results, OrderTable):
        return tables.summary_text(title, orders)
    if stabilities := _of(results, StabilityTable):
        return stability_text(title, stabilities)
    if costs := _of(results, CostTable):
        return cost_reports.costs_as_text(title, costs)
    raise RequestError("there is nothing to show")


def figures(results: Results, *, name: str | None = None) -> dict[str, Figure]:
    """Figures of outcomes, of a study of stability, or of cost, by name; none is written.

    Parameters
    ----------
    results
        Outcomes, or tables of stability or cost.
    name
        Their names begin with it; default the name of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or where there is no picture.
    """
    title = name or _only_name(results)
    if not isinstance(results, HardCaseReport):
        if outcomes := _of(results, Outcome):
            from fvi_cli.plotting import figures_for

            return figures_for(reports.studies(outcomes), name=title)
        if stabilities := _of(results, StabilityTable):
            from fvi_cli.plotting.stability import stability_figures

            return stability_figures(title, stabilities)
        if costs := _of(results, CostTable):
            from fvi_cli.plotting.cost import cost_figure

            return {f"{title}-cost": cost_figure(costs)}
    raise RequestError(
        "there are figures of outcomes, of tables of stability and of tables of cost only"
    )


def write(results: Results, output: Path | str, *, name: str | None = None) -> list[Path]:
    """Write tables and figures as the commands do; returns the paths.

    Of outcomes: the tables of ``fvi convergence`` and the figures of ``fvi plot``. Of tables of
    stability and cost, and of the report of the hard cases: what their commands write.

    Parameters
    ----------
    results
        What is written.
    output
        Folder; tables go to ``tables/`` in it, figures to ``figures/``.
    name
        Files begin with it; default the name of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or for plans, which are not kept.
    StorageError
        If the folder or a file cannot be written.
    """
    folder = Path(output)
    if isinstance(results, HardCaseReport):
        return hard_case_tables.write_report(folder, results)
    title = name or _only_name(results)
    if outcomes := _of(results, Outcome):
        written = tables.write_tables(folder / "tables", title, reports.order_tables(outcomes))
        return written + reports.write_figures(figures(outcomes, name=title), folder)
    if orders := _of(results, OrderTable):
        return tables.write_tables(folder / "tables", title, orders)
    if stabilities := _of(results, StabilityTable):
        return stability_reports.write(title, stabilities, folder)[1]
    if costs := _of(results, CostTable):
        return cost_reports.write_costs(folder, title, costs)
    raise RequestError("plans, and nothing at all, are not written")


def compare(results: Results, output: Path | str, *, name: str | None = None) -> list[str]:
    """One line for everything in which stored tables and figures differ, as ``--check`` tells.

    Parameters
    ----------
    results
        Outcomes, order tables, tables of stability, or the report of the hard cases. Costs are
        never the same twice.
    output, name
        As for :func:`write`.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or for tables of cost and plans.
    """
    folder = Path(output)
    if isinstance(results, HardCaseReport):
        return hard_case_tables.compare_with_report(folder, results)
    title = name or _only_name(results)
    if outcomes := _of(results, Outcome):
        made = reports.order_tables(outcomes)
        differences = tables.compare_with_tables(folder / "tables", title, made)
        return differences + reports.compare_figures(figures(outcomes, name=title), folder)
    if orders := _of(results, OrderTable):
        return tables.compare_with_tables(folder / "tables", title, orders)
    if stabilities := _of(results, StabilityTable):
        return stability_reports.compare(title, stabilities, folder)
    raise RequestError("times are never the same twice, and plans are not kept: nothing to compare")


def _of(results: Results, kind: type[Kind]) -> list[Kind]:
    """The results, if they are of this kind.

    Raises
    ------
    RequestError
        For a mixture.
    """
    listed: list[object] = [] if isinstance(results, HardCaseReport) else list(results)
    found = [one for one in listed if isinstance(one, kind)]
    if found and len(found) < len(listed):
        raise RequestError("results of different kinds: give them one kind after the other")
    return found


def _only_name(results: Results) -> str:
    """The name of the only experiment."""
    names: set[str] = set()
    for one in [] if isinstance(results, HardCaseReport) else results:
        owner = one.run if isinstance(one, Plan) else one
        experiment = owner.experiment
        names.add(experiment if isinstance(experiment, str) else experiment.name)
    if len(names) != 1:
        raise RequestError(
            f"name: needed, there are {len(names)} experiments: {', '.join(sorted(names))}"
            if names
            else "name: needed, there is nothing that has one"
        )
    return names.pop()
