"""What must hold between the keys of an experiment, and the experiment that they make."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

from fvi_cli.config.accuracy_keys import USUAL, accuracy_of, check_accuracy
from fvi_cli.config.complaints import Complaints, KeyPath, excerpt, listed, suggestion
from fvi_cli.config.diagnostic_keys import read_diagnostics
from fvi_cli.config.document import ListNode, MappingNode, Node, read_document
from fvi_cli.config.experiment_keys import MOST_STEPS, Ladder
from fvi_cli.config.memory import in_gigabytes, machine_bytes, predicted_bytes, run_bytes
from fvi_cli.config.method_keys import ListedMethod, read_methods
from fvi_cli.config.problem_checks import break_points, make_problem
from fvi_cli.config.records import node_at
from fvi_cli.config.shapes import is_complete
from fvi_cli.config.stability_keys import stability_settings
from fvi_cli.config.sweep import SWEEP
from fvi_cli.config.sweep_checks import ReadMembers, check_total_memory, make_members
from fvi_cli.integrator.baselines import baseline_objection
from fvi_cli.integrator.break_points import TOLERANCE
from fvi_cli.integrator.diagnostics import NOTHING
from fvi_cli.integrator.method import Baseline
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem, Problem
from fvi_cli.studies.experiment import Experiment

# Break points are taken for fractions of the interval with denominators up to this.
_LARGEST_DENOMINATOR: Final = 2**20


@dataclass(frozen=True, kw_only=True)
class ReadExperiment:
    """An experiment, complete or not, with what was read."""

    resolved: Mapping[str, Any]
    experiment: Experiment | None


def make_experiment(
    values: Mapping[str, Any],
    name: str,
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> ReadExperiment:
    """The experiment that a mapping read by EXPERIMENT or SINGLE describes.

    Parameters
    ----------
    values
        What was read; may hold INVALID.
    name
        Its name.
    node, path
        Where it stands.
    complaints
        Receives what is wrong between the keys.
    """
    before = len(complaints)
    problem = None
    diagnostics = NOTHING
    if isinstance(values["problem"], Mapping):
        problem = make_problem(
            values["problem"], node.entries["problem"].node, (*path, "problem"), complaints
        )
    method_entry = node.entries.get("method")
    method_node = method_entry.node if method_entry is not None else None
    if method_node is None and "accuracy" in values:
        method_node = read_document(USUAL, node.place, complaints)
    methods = read_methods(
        method_node,
        (*path, "method"),
        complaints,
        default_place=node.place,
    )
    check_accuracy(Ladder().expected, node, path, complaints)
    accuracy = None
    steps = _steps(values.get("ladder"))
    if isinstance(values["problem"], Mapping):
        _check_break_points(values["problem"], steps, node, path, complaints)
    for key in ("expect", "claims"):
        _check_cases(key, values[key], methods, node, path, complaints)
    if problem is not None:
        _check_meeting(problem, methods, complaints)
        every = values["store"]["every"] if isinstance(values["store"], Mapping) else 1
        if isinstance(every, int):
            _check_memory(problem, methods, steps, every, node, path, complaints)
        accuracy = accuracy_of(values, problem, methods, node, path, complaints)
        diagnostics = read_diagnostics(
            values["store"], problem, values["problem"], methods, node, path, complaints
        )
    members = None
    if problem is not None and SWEEP in node.entries:
        members = _make_members(values, problem, methods, steps, node, path, complaints)
    resolved = {
        **values,
        "name": name,
        "method": [listed_method.resolved for listed_method in methods],
        **({} if members is None else {SWEEP: members.resolved}),
    }
    if problem is None or len(complaints) > before or not is_complete(resolved):
        return ReadExperiment(resolved=resolved, experiment=None)
    experiment = Experiment(
        name=name,
        problem=problem,
        problem_specification=values["problem"],
        methods=tuple(listed_method.method for listed_method in methods),
        steps=steps,
        norm=values["report"]["norm"],
        expect=values["expect"],
        allow_unstable=values["allow_unstable"],
        store_every=values["store"]["every"],
        claims=values["claims"],
        figures=tuple(values["figures"]),
        diagnostics=diagnostics,
        stability=stability_settings(values["stability"]),
        members=() if members is None else members.members,
        accuracy=accuracy,
    )
    return ReadExperiment(resolved=resolved, experiment=experiment)


def _make_members(
    values: Mapping[str, Any],
    first: AnyProblem,
    methods: list[ListedMethod],
    steps: tuple[int, ...],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> ReadMembers | None:
    """The members of the sweep, checked like the experiment without one."""

    def check(
        specification: Mapping[str, Any], problem: AnyProblem, node: MappingNode, own: Complaints
    ) -> None:
        _check_break_points(specification, steps, node, path, own)
        _check_meeting(problem, methods, own)

    made = make_members(values["problem"], node, path, complaints, check)
    if made is not None and isinstance(values["store"], Mapping):
        every = values["store"]["every"]
        dimension = first.scene.dimension if isinstance(first, Problem) else 1
        points = [n_steps // every + 2 for n_steps in steps]
        size = len(made.members)
        check_total_memory(size, dimension, points, len(methods), node, path, complaints)
    return made


def _steps(ladder: object) -> tuple[int, ...]:
    return tuple(ladder["steps"]) if isinstance(ladder, Mapping) else ()


def _complain_of_step(
    index: int, node: MappingNode, path: KeyPath, complaints: Complaints, message: str
) -> None:
    """Point at the number itself, or at the ladder when it is given by exponents."""
    found, key = node_at(node, ("ladder", "steps", index))
    if key == ("ladder",):
        found = node.entries["ladder"].node
    complaints.add(found.place, (*path, *key), message)


def _check_break_points(
    problem: Mapping[str, Any],
    steps: tuple[int, ...],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> None:
    """Every jump of the forcing must lie on the grid of every number of steps."""
    ends = [until for _, until in break_points(problem)]
    if not ends:
        return
    parts = [until / problem["final_time"] for until in ends]
    divisor = math.lcm(
        *(Fraction(part).limit_denominator(_LARGEST_DENOMINATOR).denominator for part in parts)
    )
    for index, n_steps in enumerate(steps):
        between = [end for end, part in zip(ends, parts, strict=True) if _misses(part, n_steps)]
        if not between:
            continue
        below = n_steps // divisor * divisor
        near = [n for n in (below, below + divisor) if 0 < n <= MOST_STEPS]
        near = [n for n in near if not any(_misses(part, n) for part in parts)]
        hint = (
            f"the nearest that fit are {' and '.join(map(str, near))}"
            if len(near) > 1
            else f"the nearest that fits is {near[0]}"
            if near
            else "no number of steps fits"
        )
        _complain_of_step(
            index,
            node,
            path,
            complaints,
            f"{n_steps} steps put the break point t = {between[0]:g} between two steps; {hint}",
        )


def _misses(part: float, n_steps: int) -> bool:
    place = part * n_steps
    return abs(place - round(place)) > TOLERANCE * max(1.0, place)


def _check_cases(
    key: str,
    cases: object,
    methods: list[ListedMethod],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> None:
    """What is expected or claimed must concern a method of the experiment."""
    if not isinstance(cases, Mapping) or not methods:
        return
    known = [listed_method.method.case for listed_method in methods]
    for name in cases:
        if any(case == name or case.startswith(name + "-") for case in known):
            continue
        entry = node.entries[key].node
        place = entry.entries[name].key_place if isinstance(entry, MappingNode) else entry.place
        beginnings = list(dict.fromkeys([*known, *(case.split("-")[0] for case in known)]))
        shown = listed(known[:6]) + (", ..." if len(known) > 6 else "")
        complaints.add(
            place,
            (*path, key, name),
            f"no method here is called {excerpt(name)!r} or begins so"
            f"{suggestion(name, beginnings)} (methods here: {shown})",
        )


def _check_meeting(
    problem: Problem | DerivativeProblem, methods: list[ListedMethod], complaints: Complaints
) -> None:
    """Methods that cannot do this problem."""
    for listed_method in methods:
        message = _objection(problem, listed_method)
        if message:
            complaints.add(listed_method.place, listed_method.path, message)


def _objection(problem: Problem | DerivativeProblem, listed_method: ListedMethod) -> str:
    method = listed_method.method
    if isinstance(problem, DerivativeProblem):
        by_bdf = not isinstance(method, Baseline) and not method.is_runge_kutta
        return "" if by_bdf else f"{method.case}: a fractional derivative is taken by bdf only"
    scene = problem.scene
    if isinstance(method, Baseline):
        return baseline_objection(scene, method)
    if scene.lagrangian is not None and method.start == "weights":
        return "start: weights need a constant mass matrix; use series or none"
    if method.forcing_quadrature == "projected" and method.rule.points > method.degree + 1:
        return (
            f"forcing_quadrature: projected takes at most degree + 1 = {method.degree + 1} "
            f"quadrature points, not {method.rule.points}"
        )
    return ""


def _check_memory(
    problem: Problem | DerivativeProblem,
    methods: list[ListedMethod],
    steps: tuple[int, ...],
    every: int,
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> None:
    """No run may need more memory than there is."""
    available = machine_bytes()
    if available is None:
        return

    def predicted(n_steps: int) -> int:
        if isinstance(problem, DerivativeProblem):
            return predicted_bytes(n_steps, 1)
        return max(
            (run_bytes(problem.scene, found.method, n_steps, every=every) for found in methods),
            default=0,
        )

    # memory grows with the number of steps
    for index in sorted(range(len(steps)), key=lambda index: -steps[index]):
        needed = predicted(steps[index])
        if needed <= available:
            break
        _complain_of_step(
            index,
            node,
            path,
            complaints,
            f"{steps[index]} steps need about {in_gigabytes(needed)} of memory, this machine "
            f"has {in_gigabytes(available)}",
        )


def experiment_nodes(root: MappingNode) -> list[tuple[Node, KeyPath]]:
    """The mappings of the experiments in a file with their paths."""
    if "experiments" not in root.entries:
        return [(root, ())]
    several = root.entries["experiments"].node
    if not isinstance(several, ListNode):
        return []
    return [(item, ("experiments", index)) for index, item in enumerate(several.items)]
