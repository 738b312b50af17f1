"""What accuracy costs, measured for every run of a request."""

from __future__ import annotations

import dataclasses
import logging
import tempfile
from collections.abc import Sequence
from pathlib import Path

from fvi_cli.errors import RequestError
from fvi_cli.integrator.baselines.peers import PEER_LIMITS, peers_objection
from fvi_cli.integrator.baselines.run import baseline_objection
from fvi_cli.integrator.method import PEER_NAMES, Baseline
from fvi_cli.integrator.run.objections import law_objection
from fvi_cli.runner.executors.executor import crash, crash_told
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Request
from fvi_cli.runner.settings import Settings
from fvi_cli.scenes.problem import Problem
from fvi_cli.storage import open_results
from fvi_cli.studies.cost import CostTable, cost_table, measure_costs
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment, lookup_case
from fvi_cli.studies.tolerance.price import TOLERANCES, measure_tolerance

_logger = logging.getLogger(__name__)


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
            if experiment.needs_search:
                complaints.append(f"{experiment.name}: {NEEDS_LADDER}")
            if experiment.problem.exact_source == "none":
                complaints.append(
                    f"{experiment.name}: exact: none leaves no errors to compare costs by; "
                    "give --set problem.exact=auto"
                )
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
        reason = ""
        if isinstance(problem, Problem):
            reason = law_objection(problem.scene, peer) or baseline_objection(problem.scene, peer)
        if reason:
            _logger.warning("%s: %s; left out", experiment.name, reason)
        else:
            added.append(peer)
    return dataclasses.replace(experiment, methods=(*experiment.methods, *added))


def measure_request(request: Request, settings: Settings) -> list[CostTable]:
    """The tables of a request, every run measured in this process, one after the other.

    Writing is measured on a result file in a temporary folder.
    """
    experiments = request.loaded.experiments
    total = sum(len(experiment.runs()) + len(TOLERANCES) for experiment in experiments)
    tables = []
    with (
        tempfile.TemporaryDirectory() as folder,
        open_results(Path(folder), request.name) as results,
        progress_bar(request.name, total, wanted=settings.show_progress) as advance,
    ):
        for experiment in experiments:
            rows = []
            measured = measure_costs(experiment, lambda one: results.add([one]), crash_told)
            for run, row in zip(experiment.runs(), measured, strict=True):
                rows.append(row)
                advance(run.title)
                _logger.debug("%s: %s, %.3g s", run.title, row.status, row.seconds)
            asked_for = []
            for tolerance in TOLERANCES:
                try:
                    asked_for.append(measure_tolerance(experiment, tolerance))
                except Exception as error:
                    found = crash(error)
                    _logger.warning("%s to %g: %s", experiment.name, tolerance, found.message)
                advance(f"{experiment.name} to {tolerance:g}")
            tables.append(cost_table(experiment, rows, asked_for))
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
