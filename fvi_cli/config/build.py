"""Experiments from their keys, with the checks of keys against each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from fvi_cli.config.figures import wrong_figures
from fvi_cli.config.fits.data import fit_settings
from fvi_cli.config.machine import wrong_sizes
from fvi_cli.config.members import (
    Choice,
    Reading,
    make_members,
    remark_on_factors,
    resolved_members,
)
from fvi_cli.config.methods import methods_of
from fvi_cli.config.models import ExperimentKeys
from fvi_cli.config.names import other_meanings, units_of, wrong_units
from fvi_cli.config.observations import read_observations
from fvi_cli.config.text.mistakes import Report
from fvi_cli.errors import ArgumentError, excerpt, listed, suggestion
from fvi_cli.integrator.memory.damping import law_objection
from fvi_cli.integrator.meshes.mesh import graded_mesh, misplaced_break_point
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.mathematics.lagrange import LARGEST_DEGREE
from fvi_cli.scenes.keys.mistakes import KeyPath, Wrong, wrong_argument
from fvi_cli.scenes.keys.values import plain
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem, Problem
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.settings import Accuracy

FEWEST_STAGES: Final = 2  # with a tolerance
MOST_STAGES: Final = LARGEST_DEGREE - 2  # the second run, for the estimate, has two more
USUAL_STEPS: Final = 256
"""Least number of steps where a displacement is given and no ladder."""


@dataclass(frozen=True, kw_only=True)
class Built:
    """An experiment, and the mapping that describes it with every default filled in."""

    experiment: Experiment
    resolved: Mapping[str, Any]


def build_experiment(
    keys: ExperimentKeys,
    name: str,
    report: Report,
    context: Mapping[str, Any],
    given: Mapping[str, Any],
    first: Choice,
) -> Built | None:
    """The experiment of its keys; None, with mistakes in the report, where something is wrong.

    The keys hold the problem of the `first` member; `given` is that in the file. `context` is that
    of the validation.
    """
    before = len(report)
    try:
        problem = keys.problem.build_problem()
    except ValueError as error:
        report.extend([first.placed(wrong_argument(error, "problem"))])
        return None
    steps, grading = _ladder(keys, problem)
    entries = list(_methods(keys, report))
    methods = [method for _, method in entries]
    report.extend(_wrong_cases(keys, methods))
    for place, method in entries:
        if words := _objection(problem, method):
            report.add(words, *place)
    report.extend(_wrong_steps(problem, methods, steps, grading))
    accuracy = _accuracy(keys, methods, report)
    observed = read_observations(keys, problem, methods, report)
    report.extend(wrong_units(keys, problem, observed))
    template = plain(keys.problem)
    is_remarked = remark_on_factors(keys.problem, first, report)
    reading = Reading(
        keys=keys,
        values=given,
        template=template,
        dimension=problem.dimension,
        context=context,
        check=lambda kind: _wrong_member(kind, problem, methods, steps, grading, observed),
    )
    is_right = keys.number and len(report) == before
    members = make_members(reading, report, is_remarked=is_remarked) if is_right else ()
    if not keys.number or members:
        figures = report.under("figures")
        figures.extend(wrong_figures(keys.figures, problem, observed, members))
    fit = None
    if keys.fit is not None and isinstance(problem, Problem):
        folder, under = Path(context["folder"]), report.under("fit")
        quantities = observed.quantities or {}
        fit = fit_settings(keys.fit, template, problem, quantities, folder, under)
    if len(report) > before:
        return None
    experiment = Experiment(
        name=name,
        problem=problem,
        problem_specification=template,
        methods=tuple(methods) if accuracy is None else accuracy.methods,
        steps=steps,
        grading=grading,
        norm=keys.report.norm,
        expect=keys.expect,
        store_every=keys.store.every,
        claims=keys.claims,
        figures=tuple(keys.figures),
        diagnostics=bool(keys.store.diagnostics),
        observations=observed,
        stability=keys.stability,
        members=members,
        accuracy=accuracy,
        fit=fit,
        units=units_of(keys.units or {}, problem, observed),
    )
    report.extend(wrong_sizes(experiment))
    if len(report) > before:
        return None
    # runs do not depend on measurements
    resolved = {key: value for key, value in plain(keys).items() if key != "fit"}
    resolved |= {"name": name, **(resolved_members(keys, members) if members else {})}
    if accuracy is None or accuracy.stages is not None:
        resolved["method"] = [method.keys for method in methods]
    return Built(experiment=experiment, resolved={"name": name, **resolved})


def _ladder(keys: ExperimentKeys, problem: AnyProblem) -> tuple[tuple[int, ...], float]:
    """Numbers of steps and grading; without a ladder those of a given displacement."""
    if keys.ladder is not None:
        return keys.ladder.numbers, keys.ladder.grading or 1.0
    motion = problem.scene.prescribed if isinstance(problem, Problem) else None
    if motion is None or keys.accuracy is not None:
        return (), 1.0
    # equally many steps between any two samples
    parts = len(motion.break_points) + 1
    return (parts * -(-USUAL_STEPS // parts),), 1.0


def _methods(keys: ExperimentKeys, report: Report) -> Iterator[tuple[KeyPath, AnyMethod]]:
    """Every method with the place of its entry."""
    # a grading that is written, also of equal steps, is not replaced by a graded start
    is_graded = keys.ladder is not None and keys.ladder.grading is not None
    usual: list[Any] = ["gauss10-none"] if keys.accuracy is not None else ["gauss3"]
    known: set[str] = set()
    entries = keys.method or usual
    is_list = isinstance(report.value("method"), list)
    for number, method in methods_of(entries, "none" if is_graded else "graded"):
        place: KeyPath = ("method", number) if is_list else ("method",)
        if method.case in known:
            report.add(f"{method.case} is given twice", *place)
        known.add(method.case)
        yield place, method


def _wrong_cases(keys: ExperimentKeys, methods: Sequence[AnyMethod]) -> Iterator[Wrong]:
    """Expectations or claims for methods that the experiment does not have."""
    known = [method.case for method in methods]
    for key, cases in (("expect", keys.expect), ("claims", keys.claims)):
        for name in cases:
            if any(f"{case}-".startswith(f"{name}-") for case in known):
                continue
            near = suggestion(name, [*known, *(case.split("-")[0] for case in known)])
            shown = listed(known[:6]) + (", ..." if len(known) > 6 else "")
            words = f"{excerpt(name)!r} is not a method of this experiment, nor its beginning"
            yield Wrong((key, name), f"{words}{near} (methods here: {shown})", of_key=True)


def _objection(problem: AnyProblem, method: AnyMethod) -> str:
    """Why a method cannot solve a problem; empty if it can."""
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


def _wrong_steps(
    problem: AnyProblem,
    methods: Sequence[AnyMethod],
    steps: tuple[int, ...],
    grading: float,
    *,
    may_add_points: bool = True,
) -> Iterator[Wrong]:
    """Methods that need equal steps, and meshes that cannot meet the break points.

    With `may_add_points` methods for any mesh add points there: they need a step between two.
    """
    breaks, is_graded = _break_points(problem), grading != 1.0
    for method in methods if is_graded else ():
        words = ""
        if not isinstance(method, Method) or method.cq != "gauss":
            words = f"{method.label} needs equal steps; leave grading out, or use rk: gauss"
        elif method.start == "graded":
            words = f"{method.label} makes its own mesh; leave grading out, or give start: none"
        if words:
            yield Wrong(("ladder", "grading"), words, of_key=True)
            return
    adds_points = is_graded or (
        may_add_points and all(isinstance(m, Method) and m.is_runge_kutta for m in methods)
    )
    for index, n_steps in enumerate(steps):
        words = "" if adds_points else misplaced_break_point(breaks, problem.final_time, n_steps)
        if words:
            yield Wrong(("ladder", "steps", index), f"{n_steps} steps put {words}")
            continue
        try:
            graded_mesh(problem.final_time, n_steps, grading, breaks)
        except ArgumentError as error:
            place = ("grading",) if error.key == "grading" else ("steps", index)
            yield Wrong(("ladder", *place), error.message)
            return


def _break_points(problem: AnyProblem) -> tuple[float, ...]:
    """Jumps of the forcing or of a given displacement; samples with a kink are none."""
    scene = problem.scene
    if scene is None or scene.prescribed is None:
        return () if scene is None else scene.break_points
    return tuple(t for t in scene.prescribed.displacement.break_points if t < scene.final_time)


def _accuracy(
    keys: ExperimentKeys, methods: Sequence[AnyMethod], report: Report
) -> Accuracy | None:
    """The tolerance with the number of stages of a method beside it; None: there is none."""
    if keys.accuracy is None or keys.method is None:
        return keys.accuracy
    first = methods[0]
    stages = first.degree if isinstance(first, Method) and first.cq == "gauss" else 0
    if len(methods) > 1 or not FEWEST_STAGES <= stages <= MOST_STAGES:
        words = f"with accuracy, one method such as gauss6, of {FEWEST_STAGES} to {MOST_STAGES} "
        words += "stages; without it they follow from the tolerance"
        report.add(words, "method", of_key=True)
    return keys.accuracy.with_stages(stages)


def _wrong_member(
    kind: Kind,
    first: AnyProblem,
    methods: Sequence[AnyMethod],
    steps: tuple[int, ...],
    grading: float,
    observed: Any,
) -> Iterator[Wrong]:
    """What is wrong with the problem of a member; members are stored at common times."""
    try:
        problem = kind.build_problem()
    except ValueError as error:
        yield wrong_argument(error, "problem")
        return
    if problem.dimension != first.dimension:
        words = f"has {problem.dimension} degrees of freedom, the first member {first.dimension}; "
        yield Wrong(("problem",), f"{words}members must have the same number")
        return
    are_shared = (
        problem.scene is None
        or first.scene is None
        or problem.scene.break_points == first.scene.break_points
    )
    yield from _wrong_steps(problem, methods, steps, grading, may_add_points=are_shared)
    for method in methods:
        if words := _objection(problem, method):
            yield Wrong(("method",), words)
    yield from other_meanings(observed, first, problem)
