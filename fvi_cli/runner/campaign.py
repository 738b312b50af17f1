"""What the commands have in common: compute or recall the runs of a request, keep them."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvi_cli.config.memory import in_gigabytes, machine_bytes, predicted_bytes, run_bytes
from fvi_cli.errors import RequestError
from fvi_cli.runner.execution import (
    FRESH,
    Known,
    Outcome,
    Settings,
    Why,
    carry_out,
    is_unexpected_failure,
    never,
)
from fvi_cli.runner.requests import Request, gather
from fvi_cli.runner.settling import Chosen, none_chosen, settle
from fvi_cli.scenes.problem import Problem
from fvi_cli.storage import (
    NEW,
    Reasons,
    holds_runs,
    open_results,
    place_of,
    read_results,
)
from fvi_cli.studies.accurate_run import choices_for
from fvi_cli.studies.batches import pack_size
from fvi_cli.studies.experiment import Experiment, Predicted, Run
from fvi_cli.studies.study import prediction_of

__all__ = [
    "Outcome",
    "Plan",
    "Request",
    "Settings",
    "answer",
    "carry_out",
    "gather",
    "is_unexpected_failure",
    "plan",
]

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What would be done with one run.

    Parameters
    ----------
    run
        The run.
    action
        ``reuse`` a stored result, ``compute``, ``refuse``, or ``leave out``: a result file was
        named, from which nothing is computed. For a tolerance: ``try first`` for the method that
        would be begun with, ``candidate`` for the others.
    reason
        Why: ``stored``; ``new``, ``incomplete``, ``older solver``, ``changed: problem.stiffness``
        (see :class:`fvi_cli.storage.Reasons`) or ``--fresh``; ``refused:`` and what is
        predicted; ``not in the file``.
    predicted
        ``stable``, ``unstable`` or ``unknown``.
    """

    run: Run
    action: str
    reason: str
    predicted: Predicted


def plan(requests: Sequence[Request], settings: Settings) -> list[Plan]:
    """Tell for every run of `requests` what would be done with it; nothing is written."""
    plans = []
    for request in requests:
        _check_memory(request, settings)
        _is_kept(request, settings)
        with _stored_runs(request, settings) as known, _reasons(request, settings) as why:
            for experiment in request.loaded.experiments:
                plans += [_plan(run, known, why, request) for run in experiment.runs()]
                plans += _plans_for_tolerance(experiment, request, settings)
    return plans


def _plans_for_tolerance(
    experiment: Experiment, request: Request, settings: Settings
) -> list[Plan]:
    """What would be tried for a tolerance: every method with the steps it is thought to take."""
    accuracy = experiment.accuracy
    if accuracy is None or not experiment.is_open:
        return []
    with _chosen_runs(request, settings) as chosen:
        earlier = chosen(experiment)
    if earlier is not None:
        return [Plan(run=earlier.run, action="reuse", reason="stored", predicted=earlier.predicted)]
    plans: list[Plan] = []
    for choice in choices_for(experiment, available_bytes=machine_bytes()):
        (run,) = experiment.settled(choice.method, choice.n_steps).runs()
        action = "candidate" if plans else "try first"
        if request.stored is not None:
            action = "leave out"
        plans.append(
            Plan(
                run=run,
                action=action,
                reason=f"thought to reach {accuracy.tolerance:g}; N/2 is run as well",
                predicted=prediction_of(run).verdict,
            )
        )
    if not plans:
        (run,) = experiment.settled(accuracy.candidates[0], 1).runs()
        reason = f"no method is thought to reach {accuracy.tolerance:g}"
        plans.append(Plan(run=run, action="refuse", reason=reason, predicted="unknown"))
    return plans


def _plan(run: Run, known: Known, why: Why, request: Request) -> Plan:
    earlier = known(run)
    if earlier is not None:
        return Plan(run=run, action="reuse", reason="stored", predicted=earlier.predicted)
    prediction = prediction_of(run)
    if request.stored is not None:
        action, reason = "leave out", "not in the file"
    elif prediction.verdict == "unstable" and not run.experiment.allow_unstable:
        action, reason = "refuse", f"refused: {prediction.reason}"
    else:
        action, reason = "compute", why(run)
    return Plan(run=run, action=action, reason=reason, predicted=prediction.verdict)


def answer(request: Request, settings: Settings) -> list[Outcome]:
    """Recall or compute every run of one request; keep what is computed if that is wanted.

    Raises
    ------
    StorageError
        If results cannot be read or written.
    RequestError
        If as many runs as there are processes would take more memory than there is.
    """
    _check_memory(request, settings)
    experiments = request.loaded.experiments
    if request.stored is not None:
        return _recall(experiments, request.stored)
    if not _is_kept(request, settings):
        with (
            _stored_runs(request, settings) as known,
            _chosen_runs(request, settings) as chosen,
        ):
            settled = settle(experiments, settings, chosen=chosen)
            return _all_outcomes(
                experiments,
                settled,
                lambda rest: carry_out(rest, settings, title=request.name, known=known),
            )
    with (
        open_results(settings.output, request.name, fresh=settings.fresh) as results,
        _reasons(request, settings) as why,
    ):
        try:
            settled = settle(
                experiments,
                settings,
                chosen=none_chosen if settings.fresh else results.chosen,
                keep=results.add_batch,
            )
            return _all_outcomes(
                experiments,
                settled,
                lambda rest: carry_out(
                    rest,
                    settings,
                    title=request.name,
                    known=never if settings.fresh else results.finished,
                    why=why,
                    keep=results.add_batch,
                ),
            )
        finally:
            # also on Ctrl-C: what is finished is there for the next time
            results.consolidate(request.loaded)


def _all_outcomes(
    experiments: Sequence[Experiment],
    settled: Mapping[Experiment, Outcome],
    carried_out: Callable[[Sequence[Experiment]], list[Outcome]],
) -> list[Outcome]:
    """Outcomes in the order of the experiments; nothing more is begun after a failed search."""
    rest = [experiment for experiment in experiments if experiment not in settled]
    others = iter(carried_out(rest) if rest else [])
    return [settled[e] if e in settled else next(others) for e in experiments]


def _check_memory(request: Request, settings: Settings) -> None:
    """The longest runs must have room at the same time; one alone was looked at before."""
    available = machine_bytes()
    if settings.workers == 1 or request.stored is not None or available is None:
        return
    sizes = []
    for experiment in request.loaded.experiments:
        problem = experiment.problem
        if not isinstance(problem, Problem):
            sizes += [predicted_bytes(n, 1) for n in experiment.steps]
            continue
        together = pack_size(experiment, settings.workers) if experiment.members else 1
        sizes += [
            run_bytes(
                problem.scene,
                method,
                n,
                every=experiment.store_every,
                members=together,
                diagnosed=not experiment.diagnostics.is_empty,
            )
            for method in experiment.methods
            for n in experiment.steps
        ]
    needed = sum(sorted(sizes)[-settings.workers :])
    if needed > available:
        raise RequestError(
            f"--workers {settings.workers}: the longest runs of {request.name} need about "
            f"{in_gigabytes(needed)} of memory at the same time, this machine has "
            f"{in_gigabytes(available)}; fewer processes need less"
        )


def _is_kept(request: Request, settings: Settings) -> bool:
    """Whether runs are written; says so where stored runs of another problem are in their place."""
    path = settings.path_of(request)
    if request.stored is not None or not settings.keep or not holds_runs(path):
        return settings.keep
    with read_results(path) as results:
        others = results.of_another_problem(
            first for e in request.loaded.experiments for first in _some_run(e)
        )
    if others and settings.may_replace:
        _logger.warning(
            "%s: %d stored runs belong to another problem of this name and are replaced; "
            "another name or --output keeps them",
            path,
            others,
        )
    elif others:
        _logger.warning(
            "%s: %d stored runs belong to another problem of this name and stay; "
            "what is computed now is not kept",
            path,
            others,
        )
    return settings.may_replace or not others


def _some_run(experiment: Experiment) -> list[Run]:
    """One run, whichever: all have the problem in common."""
    if experiment.is_open:
        return experiment.settled(experiment.methods[0], 1).runs()
    return experiment.runs()[:1]


@contextlib.contextmanager
def _chosen_runs(request: Request, settings: Settings) -> Iterator[Chosen]:
    """Look-up of runs that were chosen for a tolerance; writes nothing."""
    path = settings.path_of(request)
    is_fresh = settings.fresh and request.stored is None
    if is_fresh or not holds_runs(path):
        yield none_chosen
        return
    with read_results(path) as results:
        yield results.chosen


@contextlib.contextmanager
def _stored_runs(request: Request, settings: Settings) -> Iterator[Known]:
    """Look-up of stored runs that writes nothing."""
    path = settings.path_of(request)
    is_fresh = settings.fresh and request.stored is None
    if is_fresh or not holds_runs(path):
        yield never
        return
    with read_results(path) as results:
        yield results.finished


@contextlib.contextmanager
def _reasons(request: Request, settings: Settings) -> Iterator[Why]:
    """Function that says why a run is computed that was not found; writes nothing."""
    path = settings.path_of(request)
    if settings.fresh:
        yield lambda run: FRESH
    elif not holds_runs(path):
        yield lambda run: NEW
    else:
        with read_results(path) as stored:
            asked = {place_of(run) for e in request.loaded.experiments for run in e.runs()}
            yield Reasons(stored=stored, asked=asked).of


def _recall(experiments: Sequence[Experiment], path: Path) -> list[Outcome]:
    """Read the runs of a result file, and compute nothing."""
    with read_results(path) as results:
        outcomes = []
        for experiment in experiments:
            found = [results.finished(run) for run in experiment.runs()]
            if experiment.is_open:
                found = [results.chosen(experiment)]
            finished = tuple(one for one in found if one is not None)
            own = finished[0].run.experiment if experiment.is_open and finished else experiment
            outcomes.append(Outcome(experiment=own, finished=finished))
    for outcome in outcomes:
        if outcome.missing:
            _logger.warning(
                "%s: %d runs of %s are missing; run its configuration to compute them",
                path,
                outcome.missing,
                outcome.experiment.name,
            )
    return outcomes
