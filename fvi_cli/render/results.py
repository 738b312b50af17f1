"""What is printed, drawn, written and compared of results of whatever kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from fvi_cli import reports
from fvi_cli.errors import RequestError
from fvi_cli.render.figures import compare_figures, write_figures
from fvi_cli.render.plans import plans_as_text
from fvi_cli.render.runs import contents_as_text, runs_as_text
from fvi_cli.reports import Report
from fvi_cli.reports.kinds.cost import cost_report
from fvi_cli.reports.kinds.fit import fit_report
from fvi_cli.reports.kinds.hard_cases import hard_case_report
from fvi_cli.reports.kinds.orders import order_report
from fvi_cli.reports.kinds.quantities import quantities_report
from fvi_cli.reports.kinds.stability import stability_report
from fvi_cli.reports.kinds.vibration import mode_report, response_report
from fvi_cli.reports.writers.text import show as show_blocks
from fvi_cli.reports.writers.text import to_text
from fvi_cli.runner.outcome import Outcome
from fvi_cli.runner.plan import PlannedRun
from fvi_cli.storage import StoredFile
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.fits.result import FitResult
from fvi_cli.studies.hard_cases.case import HardCaseReport
from fvi_cli.studies.order import OrderTable
from fvi_cli.studies.order import order_tables as tables_of_orders
from fvi_cli.studies.stability_study import StabilityTable
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table: TypeAlias = OrderTable | StabilityTable | CostTable | FitResult | ModeTable | ResponseTable
Result: TypeAlias = Outcome | Table | PlannedRun
Results: TypeAlias = Result | Sequence[Result] | HardCaseReport | Report
Kind = TypeVar("Kind")


def as_text(results: Results | StoredFile, *, name: str | None = None) -> str:
    """What a terminal shows of `results`.

    Parameters
    ----------
    results
        Outcomes of runs, tables of orders, stability, cost, modes or responses, fits, plans (one
        of these, or a list of one kind), a report, or the contents of a result file.
    name
        Name of the whole in the heading; default that of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name.
    """
    if isinstance(results, StoredFile):
        return contents_as_text(results)
    if outcomes := _of(results, Outcome):
        return runs_as_text(outcomes)
    if plans := _of(results, PlannedRun):
        return plans_as_text(plans)
    return to_text(_report(results, name).summary)


def show(results: Results, *, name: str | None = None) -> None:
    """Print what :func:`as_text` gives of tables; on a terminal within its width.

    Parameters
    ----------
    results
        Tables of one kind, or a report.
    name
        As for :func:`as_text`.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name.
    """
    show_blocks(_report(results, name).summary)


def _report(results: Results, name: str | None) -> Report:
    """The report on results of one kind; of outcomes that on their orders."""
    if isinstance(results, Report):
        return results
    if isinstance(results, HardCaseReport):
        return hard_case_report(results)
    title = name or _only_name(results)
    if orders := _of(results, OrderTable) or order_tables(_of(results, Outcome)):
        return order_report(title, orders)
    if stabilities := _of(results, StabilityTable):
        return stability_report(title, stabilities)
    if costs := _of(results, CostTable):
        return cost_report(title, costs)
    if fits := _of(results, FitResult):
        return fit_report(title, fits)
    if modes := _of(results, ModeTable):
        return mode_report(title, modes)
    if responses := _of(results, ResponseTable):
        return response_report(title, responses)
    raise RequestError(
        "there are tables of orders, stability, cost, fits, modes, responses and the hard cases "
        "only"
    )


def figures(results: Results, *, name: str | None = None) -> dict[str, Figure]:
    """Figures of outcomes, fits, or tables that have some, by name; none is written.

    Parameters
    ----------
    results
        One or several outcomes or fits, or tables of stability, cost, modes or responses.
    name
        Their names begin with it; default the name of the only experiment.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or where there is no picture.
    """
    title = name or _only_name(results)
    if outcomes := _of(results, Outcome):
        from fvi_cli.plotting import figures_for

        return figures_for(studies(outcomes), name=title)
    if stabilities := _of(results, StabilityTable):
        from fvi_cli.plotting.stability import stability_figures

        return stability_figures(title, stabilities)
    if costs := _of(results, CostTable):
        from fvi_cli.plotting.ladders.cost import cost_figures

        return cost_figures(title, costs)
    if fits := _of(results, FitResult):
        from fvi_cli.plotting.fits import fit_figures

        return dict(fit_figures(title, fits))
    if modes := _of(results, ModeTable):
        from fvi_cli.plotting.spectra import mode_figures

        return mode_figures(title, modes)
    if responses := _of(results, ResponseTable):
        from fvi_cli.plotting.spectra import response_figures

        return response_figures(title, responses)
    raise RequestError(
        "there are figures of outcomes, of fits, and of tables of stability, cost, modes and "
        "responses only"
    )


def write(
    results: Results, output: Path | str, *, name: str | None = None, anew: bool = False
) -> list[Path]:
    """Write tables and figures as the commands do; returns the paths.

    Tables and figures that agree with what is stored leave it as it is.

    Of outcomes: the tables of ``fvi convergence`` and the figures of ``fvi plot``. Of everything
    else: what its command writes, of modes also their shapes, ``<name>-modes.h5``.

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
    if _of(results, PlannedRun):
        raise RequestError("plans are not written")
    folder, report = Path(output), _report(results, name)
    drawn = figures(results, name=name) if _is_drawn(results) else {}
    paths = reports.write(_tables(results, folder), report, anew=anew)
    paths += write_figures(drawn, folder, anew=anew)
    if modes := _of(results, ModeTable):
        from fvi_cli.storage.spectra.mode_shapes import write_mode_shapes

        paths.append(folder / f"{name or _only_name(results)}-modes.h5")
        write_mode_shapes(paths[-1], modes)
    return paths


def compare(results: Results, output: Path | str, *, name: str | None = None) -> list[str]:
    """One line for everything in which stored tables and figures differ, as ``--check`` tells.

    Parameters
    ----------
    results
        What :func:`write` would write. Costs are never the same twice.
    output, name
        As for :func:`write`.

    Raises
    ------
    RequestError
        If there is more than one experiment and no name, or for tables of cost and plans.
    """
    if any(isinstance(one, PlannedRun | CostTable) for one in _listed(results)):
        raise RequestError("times are never the same twice, and plans are not kept")
    folder = Path(output)
    differences = reports.compare(_tables(results, folder), _report(results, name))
    if not _is_drawn(results):
        return differences
    return differences + compare_figures(figures(results, name=name), folder)


def _is_drawn(results: Results) -> bool:
    """Whether figures are written beside the tables; those of orders belong to the runs."""
    return bool(_listed(results)) and not _of(results, OrderTable)


def _tables(results: Results, output: Path) -> Path:
    """The folder of the tables; the page on the hard cases stands beside it."""
    return output if isinstance(results, HardCaseReport) else output / "tables"


def _listed(results: Results) -> list[Result]:
    """The results one by one; none where they are a report already."""
    if isinstance(results, HardCaseReport | Report):
        return []
    return list(results) if isinstance(results, Sequence) else [results]


def _of(results: Results, kind: type[Kind]) -> list[Kind]:
    """The results, if they are of this kind.

    Raises
    ------
    RequestError
        For a mixture.
    """
    listed: Sequence[object] = _listed(results)
    found: list[Kind] = [one for one in listed if isinstance(one, kind)]
    if found and len(found) < len(listed):
        raise RequestError("results of different kinds: give them one kind after the other")
    return found


def _only_name(results: Results) -> str:
    """The name of the only experiment."""
    names: set[str] = set()
    for one in _listed(results):
        if isinstance(one, FitResult | ModeTable | ResponseTable):
            names.add(one.name)
            continue
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


def order_tables(outcomes: Outcome | Sequence[Outcome]) -> list[OrderTable]:
    """Tables of orders as ``fvi convergence`` makes them, one for every experiment.

    Of a sweep one for every member.
    """
    listed = [outcomes] if isinstance(outcomes, Outcome) else outcomes
    return [table for one in listed for table in tables_of_orders(one.experiment, one.finished)]


def observed_report(outcomes: Sequence[Outcome], name: str) -> Report:
    """The report of ``fvi quantities``: quantities and events of every run.

    Raises
    ------
    RequestError
        Where none are asked for.
    """
    finished = [one for outcome in outcomes for one in outcome.finished]
    if not any(one.trajectory.observed is not None for one in finished):
        raise RequestError(
            f"{name}: no quantities, events or impacts are asked for; give for example "
            "quantities: {top: ax}"
        )
    return quantities_report(name, finished)


def studies(outcomes: Sequence[Outcome]) -> list[tuple[Experiment, tuple[FinishedRun, ...]]]:
    """Experiments with their finished runs."""
    return [(outcome.experiment, outcome.finished) for outcome in outcomes]
