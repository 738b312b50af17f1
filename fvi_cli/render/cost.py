"""What ``fvi cost`` measures and writes."""

from __future__ import annotations

import dataclasses
import logging
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from fvi_cli.errors import RequestError, StorageError
from fvi_cli.integrator.baselines import baseline_objection
from fvi_cli.integrator.method import PEER_NAMES, Baseline
from fvi_cli.integrator.peers import PEER_LIMITS, peers_objection
from fvi_cli.plotting import save_figure
from fvi_cli.plotting.cost import cost_figure
from fvi_cli.reports.cost import (
    cost_csv,
    cost_json,
    cost_report,
    cost_summary,
    cost_summary_csv,
)
from fvi_cli.reports.document import Block, Bullets, Code, Grid, Heading, Paragraph
from fvi_cli.reports.latex import to_latex
from fvi_cli.reports.markdown import to_markdown
from fvi_cli.reports.naming import number
from fvi_cli.reports.plain_text import to_text
from fvi_cli.runner.campaign import Request, Settings
from fvi_cli.runner.progress import progress_bar
from fvi_cli.scenes.problem import Problem
from fvi_cli.storage import open_results
from fvi_cli.storage.atomic import replace_file
from fvi_cli.storage.provenance import package_versions, platform_name
from fvi_cli.studies.benchmark import yardstick_seconds
from fvi_cli.studies.cost import CostTable, cost_table, measure_costs
from fvi_cli.studies.cost_goals import YARDSTICK_STEPS, Goal, cost_goals
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment, lookup_case

_logger = logging.getLogger(__name__)

PAGE = "cost.md"


def refuse_what_has_no_price(requests: Sequence[Request]) -> None:
    """Complain of everything among `requests` that cannot be measured, before anything is.

    Raises
    ------
    RequestError
        With one line for each.
    """
    complaints = []
    for request in requests:
        if request.stored is not None:
            complaints.append(
                f"{request.stored}: costs are measured anew; name the configuration instead"
            )
            continue
        for experiment in request.loaded.experiments:
            if experiment.members:
                complaints.append(f"{experiment.name}: a sweep has no one price; leave out sweep")
            if experiment.is_open:
                complaints.append(f"{experiment.name}: {NEEDS_LADDER}")
            if not isinstance(experiment.problem, Problem):
                complaints.append(f"{experiment.name}: a fractional derivative is no scene")
    if complaints:
        raise RequestError(*complaints)


def with_peers(requests: Sequence[Request]) -> list[Request]:
    """The requests with the methods of other packages beside their own.

    Raises
    ------
    RequestError
        Where the package is not installed.
    """
    missing = peers_objection()
    if missing:
        raise RequestError(f"--peers: {missing}")
    _logger.info("%s", PEER_LIMITS)
    return [
        dataclasses.replace(
            request,
            loaded=dataclasses.replace(
                request.loaded, experiments=tuple(map(_beside_peers, request.loaded.experiments))
            ),
        )
        for request in requests
    ]


def _beside_peers(experiment: Experiment) -> Experiment:
    added = []
    for name in PEER_NAMES:
        peer = Baseline(name=name)
        problem = experiment.problem
        reason = baseline_objection(problem.scene, peer) if isinstance(problem, Problem) else ""
        if reason:
            _logger.warning("%s: %s; left out", experiment.name, reason)
        else:
            added.append(peer)
    return dataclasses.replace(experiment, methods=(*experiment.methods, *added))


def measured(request: Request, settings: Settings) -> list[CostTable]:
    """The tables of a request, every run measured in this process, one after the other.

    Writing is measured on a result file in a temporary folder.
    """
    experiments = request.loaded.experiments
    total = sum(len(experiment.runs()) for experiment in experiments)
    tables = []
    with (
        tempfile.TemporaryDirectory() as folder,
        open_results(Path(folder), request.name) as results,
        progress_bar(request.name, total, wanted=settings.show_progress) as advance,
    ):
        for experiment in experiments:
            rows = []
            for run, row in zip(
                experiment.runs(), measure_costs(experiment, results.add), strict=True
            ):
                rows.append(row)
                advance(run.title)
                _logger.debug("%s: %s, %.3g s", run.title, row.status, row.seconds)
            tables.append(cost_table(experiment, rows))
    return tables


def unexpected(request: Request, tables: Sequence[CostTable]) -> list[str]:
    """One line for every run that came to nothing although the configuration did not say so."""
    lines = []
    for experiment, table in zip(request.loaded.experiments, tables, strict=True):
        for case in table.cases:
            if lookup_case(experiment.expect, case.method) is not None:
                continue
            lines += [
                f"{experiment.name} {case.method.case} N={row.n_steps}: {row.status}"
                + (f" ({row.message})" if row.message else "")
                for row in case.rows
                if row.status not in ("ok", "floor")
            ]
    return lines


def write_costs(output: Path, name: str, tables: Sequence[CostTable]) -> list[Path]:
    """Write ``tables/<name>-cost.*`` and ``figures/<name>-cost.*``; returns the paths.

    Raises
    ------
    StorageError
        If the folder or a file cannot be written.
    """
    blocks = cost_report(name, tables)
    texts: Mapping[str, str] = {
        f"{name}-cost.csv": cost_csv(tables),
        f"{name}-cost-summary.csv": cost_summary_csv(tables),
        f"{name}-cost.md": to_markdown(blocks),
        f"{name}-cost.tex": to_latex(blocks),
        f"{name}-cost.json": cost_json(name, tables),
    }
    directory = output / "tables"
    written = []
    place = directory
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for file, text in texts.items():
            place = directory / file
            replace_file(place, text.encode("utf-8"))
            written.append(place)
        place = output / "figures"
        written += save_figure(cost_figure(tables), place, f"{name}-cost")
    except OSError as error:
        raise StorageError(f"{place}: cannot be written: {error.strerror}") from None
    return written


def costs_as_text(name: str, tables: Sequence[CostTable]) -> str:
    """What a terminal shows: the summary."""
    return to_text([Heading(level=1, words=f"What accuracy costs: {name}"), *cost_summary(tables)])


def write_page(output: Path, measured_tables: Mapping[str, Sequence[CostTable]]) -> Path:
    """Write ``cost.md``: the figures to meet and the summaries of all configurations."""
    everything = [table for tables in measured_tables.values() for table in tables]
    goals = cost_goals(everything, yardstick_seconds(YARDSTICK_STEPS))
    versions = package_versions()
    made_by = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "scipy"))
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    blocks: list[Block] = [
        Heading(level=1, words="What accuracy costs"),
        Paragraph(
            words=(
                "Made by ",
                Code("fvi cost"),
                f" in one process on one core: {platform_name()}, {made_by}; runnable processes "
                f"{load} on {os.cpu_count()} processors. Every run is in ",
                Code("tables/<name>-cost.csv"),
                ". Times mean little where others compute as well.",
            )
        ),
        Heading(level=2, words="Figures to meet"),
        *goal_blocks(goals),
    ]
    for index, (name, tables) in enumerate(measured_tables.items()):
        blocks.append(Heading(level=2, words=name))
        # how to read the numbers is said once
        blocks += cost_summary(tables, level=3)[min(index, 1) :]
    # a picture is no block of a report: it is put below the heading of its configuration
    text = to_markdown(blocks)
    for name in measured_tables:
        picture = f"![Error against time and work](figures/{name}-cost.png)"
        text = text.replace(f"\n## {name}\n", f"\n## {name}\n\n{picture}\n", 1)
    path = output / PAGE
    output.mkdir(parents=True, exist_ok=True)
    replace_file(path, text.encode("utf-8"))
    return path


def goal_blocks(goals: Sequence[Goal]) -> list[Block]:
    """The figures to meet as a table, and what went into each."""
    if not goals:
        return [Paragraph(words="None of them concerns these configurations.")]
    return [
        Grid(
            header=("what", "measured", "bound", "met"),
            rows=tuple(
                (
                    goal.name,
                    number(goal.measured, ".3g"),
                    f"at {'least' if goal.is_least else 'most'} {goal.bound:g}",
                    "yes" if goal.is_met else "no",
                )
                for goal in goals
            ),
        ),
        Bullets(items=tuple(f"{goal.name}: {goal.how}" for goal in goals)),
    ]
