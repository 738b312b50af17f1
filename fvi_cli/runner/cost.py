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
from fvi_cli.runner.executors.jobs import crash, describe_crash
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Request
from fvi_cli.scenes.problem import Problem
from fvi_cli.storage import open_results
from fvi_cli.studies.cost import CostTable, cost_table, measure_costs
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment
from fvi_cli.studies.tolerance.price import TOLERANCES, measure_tolerance

_logger = logging.getLogger(__name__)


def measurable(requests: Sequence[Request], *, peers: bool) -> list[Request]:
    """The requests, each of which can be measured; with methods of other packages if wanted.

    Raises
    ------
    RequestError
        With one line for everything that cannot be measured, and without that package.
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
                complaints.append(
                    f"{experiment.name}: a fractional derivative has no cost of a motion"
                )
    if complaints:
        raise RequestError(*complaints)
    if not peers:
        return list(requests)
    if missing := peers_objection():
        raise RequestError(f"--peers: {missing}")
    _logger.info("%s", PEER_LIMITS)
    return [
        dataclasses.replace(
            request,
            loaded=dataclasses.replace(
                request.loaded, experiments=tuple(map(_with_peers, request.loaded.experiments))
            ),
        )
        for request in requests
    ]


def _with_peers(experiment: Experiment) -> Experiment:
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


def measure_request(request: Request, *, show_progress: bool) -> list[CostTable]:
    """The tables of a request, every run measured in this process, one after the other.

    Writing is measured on a result file in a temporary folder.
    """
    experiments = request.loaded.experiments
    total = sum(len(experiment.runs()) + len(TOLERANCES) for experiment in experiments)
    tables = []
    with (
        tempfile.TemporaryDirectory() as folder,
        open_results(Path(folder), request.name) as results,
        progress_bar(request.name, total, wanted=show_progress) as advance,
    ):
        for experiment in experiments:
            rows = []
            measured = measure_costs(experiment, lambda one: results.add([one]), describe_crash)
            for run, row in zip(experiment.runs(), measured, strict=True):
                rows.append(row)
                advance(run.title)
                _logger.debug("%s: %s, %.3g s", run.title, row.status, row.seconds)
            tolerances = []
            for tolerance in TOLERANCES:
                try:
                    tolerances.append(measure_tolerance(experiment, tolerance))
                except Exception as error:
                    found = crash(error)
                    _logger.warning("%s to %g: %s", experiment.name, tolerance, found.message)
                advance(f"{experiment.name} to {tolerance:g}")
            tables.append(cost_table(experiment, rows, tolerances))
            for line in tables[-1].unexpected:
                _logger.warning("%s", line)
    return tables
