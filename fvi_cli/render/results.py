"""What is printed, drawn, written and compared of results of whatever kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from fvi_cli import reports
from fvi_cli.errors import RequestError
from fvi_cli.render.cost import costs_as_text, write_costs
from fvi_cli.render.figures import compare_figures, write_figures
from fvi_cli.render.plans import plans_as_text
from fvi_cli.render.runs import contents_as_text, runs_as_text
from fvi_cli.reports import hard_cases
from fvi_cli.reports.stability import (
    compare_stability_tables,
    stability_text,
    write_stability_tables,
)
from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.plan import PlannedRun
from fvi_cli.storage import StoredFile
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.hard_cases.case import HardCaseReport
from fvi_cli.studies.order import OrderTable
from fvi_cli.studies.order import order_tables as tables_of_orders
from fvi_cli.studies.stability_study import StabilityTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Result: TypeAlias = Outcome | OrderTable | StabilityTable | CostTable | PlannedRun
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
        return hard_cases.report_text(results)
    if isinstance(results, StoredFile):
        return contents_as_text(results)
    if outcomes := _of(results, Outcome):
        return runs_as_text(outcomes)
    if plans := _of(results, PlannedRun):
        return plans_as_text(plans)
    title = name or _only_name(results)
    if orders := _of(results, OrderTable):
        return reports.summary_text(title, orders)
    if stabilities := _of(results, StabilityTable):
        return stability_text(title, stabilities)
    if costs := _of(results, CostTable):
        return costs_as_text(title, costs)
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

            return figures_for(studies(outcomes), name=title)
        if stabilities := _of(results, StabilityTable):
            from fvi_cli.plotting.stability import stability_figures

            return stability_figures(title, stabilities)
        if costs := _of(results, CostTable):
            from fvi_cli.plotting.cost import cost_figure

            return {f"{title}-cost": cost_figure(costs)}
    raise RequestError(
        "there are figures of outcomes, of tables of stability and of tables of cost only"
    )


def write(
    results: Results, output: Path | str, *, name: str | None = None, anew: bool = False
) -> list[Path]:
    """Write tables and figures as the commands do; returns the paths.

    Tables of orders, and figures, that agree with what is stored leave it as it is.

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
    anew
        Write whatever is stored.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or for plans, which are not kept.
    StorageError
        If the folder or a file cannot be written.
    """
    folder = Path(output)
    if isinstance(results, HardCaseReport):
        return hard_cases.write_report(folder, results)
    title = name or _only_name(results)
    if outcomes := _of(results, Outcome):
        made = order_tables(outcomes)
        written = reports.write_tables(folder / "tables", title, made, anew=anew)
        return written + write_figures(figures(outcomes, name=title), folder, anew=anew)
    if orders := _of(results, OrderTable):
        return reports.write_tables(folder / "tables", title, orders, anew=anew)
    if stabilities := _of(results, StabilityTable):
        written = write_stability_tables(folder / "tables", title, stabilities)
        return written + write_figures(figures(stabilities, name=title), folder, anew=anew)
    if costs := _of(results, CostTable):
        return write_costs(folder, title, costs)
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
        return hard_cases.compare_with_report(folder, results)
    title = name or _only_name(results)
    if outcomes := _of(results, Outcome):
        made = order_tables(outcomes)
        differences = reports.compare_with_tables(folder / "tables", title, made)
        return differences + compare_figures(figures(outcomes, name=title), folder)
    if orders := _of(results, OrderTable):
        return reports.compare_with_tables(folder / "tables", title, orders)
    if stabilities := _of(results, StabilityTable):
        differences = compare_stability_tables(folder / "tables", title, stabilities)
        return differences + compare_figures(figures(stabilities, name=title), folder)
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
        owner = one.run if isinstance(one, PlannedRun) else one
        experiment = owner.experiment
        names.add(experiment if isinstance(experiment, str) else experiment.name)
    if len(names) != 1:
        raise RequestError(
            f"name: needed, there are {len(names)} experiments: {', '.join(sorted(names))}"
            if names
            else "name: needed, there is nothing that has one"
        )
    return names.pop()


def order_tables(outcomes: Sequence[Outcome]) -> list[OrderTable]:
    """Tables of orders as ``fvi convergence`` makes them, one for every experiment.

    Of a sweep one for every member.
    """
    return [table for one in outcomes for table in tables_of_orders(one.experiment, one.finished)]


def studies(outcomes: Sequence[Outcome]) -> list[tuple[Experiment, tuple[FinishedRun, ...]]]:
    """Experiments with their finished runs."""
    return [(outcome.experiment, outcome.finished) for outcome in outcomes]
