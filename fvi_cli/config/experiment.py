"""Checks across the keys of an experiment, and the experiment that they make."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from fvi_cli.config.figures import check_figures
from fvi_cli.config.fits.settings import fit_settings
from fvi_cli.config.keys.designs import DESIGNS
from fvi_cli.config.keys.experiment import ExperimentKeys
from fvi_cli.config.keys.fit import Fit
from fvi_cli.config.keys.ladder import (
    Ladder,
    accuracy_of,
    check_accuracy,
    check_grading,
    refuse_step,
    usual_methods,
    usual_steps,
)
from fvi_cli.config.keys.methods import ListedMethod, read_methods
from fvi_cli.config.keys.store import StoreKeys
from fvi_cli.config.keys.sweep import SWEEP, Sweep
from fvi_cli.config.members import ReadMembers, make_members
from fvi_cli.config.memory import check_memory
from fvi_cli.config.observations import check_member, read_observations, read_units
from fvi_cli.config.problem import make_problem, problem_keys
from fvi_cli.effects.matrices import is_semidefinite
from fvi_cli.integrator.memory.damping import law_objection
from fvi_cli.integrator.meshes.mesh import misplaced_break_point
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.keys.settings import as_plain
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem
from fvi_cli.scenes.structures.matrix_keys import file_form
from fvi_cli.studies.accuracy_settings import Accuracy
from fvi_cli.studies.experiment import Experiment

_logger = logging.getLogger(__name__)
_OF_DAMPING: Final = re.compile(r"(problem\.)?(damping|dampers|internal_damping)\b")
_FACTOR: Final = re.compile(_OF_DAMPING.pattern + r"\.\d+\.(coefficient|matrix)")

ReadExperiment = tuple[Mapping[str, Any], Experiment | None]
"""The values of an experiment with defaults, and the experiment; None if the values are wrong."""


def make_experiment(
    values: Mapping[str, Any], name: str, at: Cursor, sweep: Sweep | None
) -> ReadExperiment:
    """The experiment that a mapping read by EXPERIMENT or SINGLE at `at` describes.

    `values` may hold INVALID; `at` receives complaints about combinations of keys. `sweep` holds
    the values of its members.
    """
    before = len(at.complaints)
    settings, described = ExperimentKeys.of(values), values["problem"]
    is_described = isinstance(described, Mapping)
    keys = problem_keys(described, settings.problem) if is_described else None
    problem = None if keys is None else make_problem(keys, at.under("problem"))
    ladder = settings.ladder if isinstance(settings.ladder, Ladder) else None
    usual = () if settings.accuracy is not None or at.has("ladder") else usual_steps(problem)
    steps, grading = (ladder.steps, ladder.grading or 1.0) if ladder else (usual, 1.0)
    methods = read_methods(
        values.get("method"),
        at,
        usual_methods(settings.accuracy),
        # a grading that is written, also of equal steps, is not replaced by a graded start
        start="none" if ladder is not None and ladder.grading is not None else "graded",
    )
    check_accuracy(at, problem)
    if problem is None:
        check_grading(grading, steps, methods, (), at)
    else:
        _check_grid(problem, methods, steps, grading, at)
    for key in ("expect", "claims"):
        _check_cases(values[key], methods, at.under(key))
    if is_described:
        _warn_of_negative(described, at.under("problem"))
    accuracy, diagnostics, members = None, False, None
    observed, units = Observations(), dict[str, str]()
    if problem is not None:
        _check_meeting(problem, methods)
        if isinstance(settings.accuracy, Accuracy):
            accuracy = accuracy_of(settings.accuracy, problem, methods, at)
        if isinstance(settings.store, StoreKeys) and is_complete(settings.store):
            diagnostics = settings.store.request(problem, at)
        observed = read_observations(settings, problem, methods, at)
        units = read_units(settings, problem, observed, at)
        if sweep is not None:
            members = _make_members(
                sweep, described, methods, steps, grading, problem, observed, at
            )
            if members is not None:
                under = at.under(SWEEP if at.has(SWEEP) else DESIGNS)
                # one warning, for the first member with a negative factor
                any(_warn_of_negative(one.values, under) for one in members[0])
        if is_complete(settings.figures) and not (at.has(SWEEP) and members is None):
            found = () if members is None else members[0]
            check_figures(settings.figures, problem, observed, found, at.under("figures"))
    fit = None
    if problem is not None and isinstance(settings.fit, Fit):
        quantities = observed.quantities or {}
        fit = fit_settings(
            settings.fit, described, problem, quantities, at.under("fit"), at.under("problem")
        )
    resolved = {
        # runs do not depend on measurements
        **{key: value for key, value in values.items() if key != "fit"},
        "name": name,
        **_methods_of(methods, accuracy),
        **({} if members is None else members[1]),
    }
    if problem is None or len(at.complaints) > before or not is_complete(resolved):
        return resolved, None
    experiment = Experiment(
        name=name,
        problem=problem,
        problem_specification=described,
        methods=tuple(listed_method.method for listed_method in methods)
        if accuracy is None
        else accuracy.methods,
        steps=steps,
        grading=grading,
        norm=settings.report.norm,
        expect=settings.expect,
        store_every=settings.store.every,
        claims=settings.claims,
        figures=settings.figures,
        diagnostics=diagnostics,
        observations=observed,
        stability=settings.stability,
        members=() if members is None else members[0],
        accuracy=accuracy,
        fit=fit,
        units=units,
    )
    check_memory(experiment, at)
    return resolved, experiment if len(at.complaints) == before else None


def _warn_of_negative(values: Mapping[str, Any], at: Cursor) -> bool:
    """Warn of negative damping factors by their key paths, since a sign is easily wrong."""
    found = False
    for path, value in _factors(values):
        if words := _explain_negative_factor(value):
            found = True
            shown = path if path.startswith("problem.") else f"problem.{path}"
            _logger.warning(
                "%s: %s: %s: such damping drives the motion, which grows",
                at.under(*(int(p) if p.isdecimal() else p for p in path.split("."))).node.place,
                shown,
                words,
            )
    return found


def _factors(values: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Key paths and values of damping factors in a problem, or in the values of a member."""
    if _FACTOR.fullmatch(path):
        yield path, values
    elif isinstance(values, Mapping):
        for key, one in values.items():
            yield from _factors(one, f"{path}.{key}" if path else key)
    elif isinstance(values, list | tuple) and _OF_DAMPING.match(path):
        for index, one in enumerate(values):
            yield from _factors(one, f"{path}.{index}")


def _explain_negative_factor(value: object) -> str:
    """Why a damping factor feeds energy into some direction; empty where it does not."""
    if isinstance(value, int | float):
        return f"{value:g} is negative" if value < 0 else ""
    try:
        form = np.array(value, dtype=float) if isinstance(value, list) else file_form(value)
    except (TypeError, ValueError):
        # other checks report this error
        return ""
    is_square = form is not None and len(form.shape) == 2 and form.shape[0] == form.shape[1]
    if form is None or not is_square or is_semidefinite(form):
        return ""
    return "the matrix has a negative eigenvalue"


def _methods_of(methods: Sequence[ListedMethod], accuracy: Accuracy | None) -> dict[str, Any]:
    """The resolved keys of the methods; without any they follow from a tolerance."""
    found = {"method": [listed_method.method.keys for listed_method in methods]}
    if accuracy is None:
        return found
    own = {"accuracy": as_plain(accuracy)}
    return own if accuracy.stages is None else {**found, **own}


def _make_members(
    sweep: Sweep,
    template: Mapping[str, Any],
    methods: Sequence[ListedMethod],
    steps: tuple[int, ...],
    grading: float,
    first: AnyProblem,
    observed: Observations,
    at: Cursor,
) -> ReadMembers | None:
    """The members of the sweep; each is checked like an experiment without a sweep."""

    def check(problem: AnyProblem, at: Cursor) -> None:
        # members are stored at common times
        are_shared = (
            problem.scene is None
            or first.scene is None
            or problem.scene.break_points == first.scene.break_points
        )
        _check_grid(problem, methods, steps, grading, at, may_be_between=are_shared)
        _check_meeting(problem, methods, at)
        check_member(observed, first, problem, at)

    return make_members(sweep, template, first, at, check)


def _break_points(problem: AnyProblem) -> tuple[float, ...]:
    """Jumps of the forcing or of a given displacement; samples with a kink are none."""
    scene = problem.scene
    if scene is None or scene.prescribed is None:
        return () if scene is None else scene.break_points
    return tuple(t for t in scene.prescribed.displacement.break_points if t < scene.final_time)


def _check_grid(
    problem: AnyProblem,
    methods: Sequence[ListedMethod],
    steps: tuple[int, ...],
    grading: float,
    at: Cursor,
    *,
    may_be_between: bool = True,
) -> None:
    """Complain of jumps of the forcing that do not lie on the grid of every number of steps.

    Methods for any mesh add mesh points at the jumps, and only need a step between two of them.
    """
    ends = _break_points(problem)
    if grading != 1.0:
        check_grading(grading, steps, methods, (*ends, problem.final_time), at)
        return
    are_own_points = may_be_between and all(
        isinstance(m.method, Method) and m.method.is_runge_kutta for m in methods
    )
    for index, n_steps in enumerate(steps if ends else ()):
        if are_own_points:
            if n_steps <= len(ends):
                parts = f"{len(ends) + 1} parts between break points"
                refuse_step(at, index, f"{n_steps} steps are too few for {parts}")
        elif words := misplaced_break_point(ends, problem.final_time, n_steps):
            refuse_step(at, index, f"{n_steps} steps put {words}")


def _check_cases(cases: object, methods: Sequence[ListedMethod], at: Cursor) -> None:
    """Complain of expectations or claims for methods that the experiment does not have."""
    if not isinstance(cases, Mapping) or not methods:
        return
    known = [listed_method.method.case for listed_method in methods]
    for name in cases:
        if any(case == name or case.startswith(name + "-") for case in known):
            continue
        beginnings = list(dict.fromkeys([*known, *(case.split("-")[0] for case in known)]))
        shown = listed(known[:6]) + (", ..." if len(known) > 6 else "")
        at.refuse_key(
            name,
            f"{excerpt(name)!r} is not a method of this experiment, nor its beginning"
            f"{suggestion(name, beginnings)} (methods here: {shown})",
        )


def _check_meeting(
    problem: AnyProblem, methods: Sequence[ListedMethod], at: Cursor | None = None
) -> None:
    """Complain of methods that cannot solve this problem."""
    for found in methods:
        message = _objection(problem, found)
        if message:
            complaints = found.at.complaints if at is None else at.complaints
            complaints.add(found.at.node.place, found.at.path, message)


def _objection(problem: AnyProblem, found: ListedMethod) -> str:
    method = found.method
    if isinstance(problem, DerivativeProblem):
        by_bdf = not isinstance(method, Baseline) and not method.is_runge_kutta
        reason = "a fractional derivative needs bdf; write bdf: 2"
        return "" if by_bdf else f"{method.label}: {reason}"
    if reason := law_objection(problem.scene, method):
        return reason
    if isinstance(method, Baseline):
        # import only for experiments with baselines, since it takes long
        from fvi_cli.integrator.baselines import baseline_objection

        return baseline_objection(problem.scene, method)
    if method.start == "weights":
        if problem.scene.lagrangian is not None:
            return "start: weights need a constant mass matrix; use none"
        # import only for experiments with weights, since it takes long
        from fvi_cli.integrator.starting_weights import weights_objection

        return weights_objection(method)
    return ""
