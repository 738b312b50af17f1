"""The keys of an experiment and of a file, and the experiments that they make."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final, get_args

from fvi_cli.config.complaints import Complaints, KeyPath, excerpt, listed, suggestion
from fvi_cli.config.document import ListNode, MappingNode, Node, ScalarNode
from fvi_cli.config.memory import in_gigabytes, machine_bytes, predicted_bytes
from fvi_cli.config.method_keys import METHODS, ListedMethod, read_methods
from fvi_cli.config.problem_keys import PROBLEM, break_points, make_problem
from fvi_cli.config.shapes import (
    INVALID,
    OPTIONAL,
    Choice,
    Flag,
    Integer,
    Key,
    ListOf,
    Number,
    OneOrMany,
    Record,
    Schema,
    Shape,
    describe,
    is_complete,
    needed,
    node_at,
)
from fvi_cli.experiments.experiment import Experiment, Norm
from fvi_cli.integrator.break_points import TOLERANCE
from fvi_cli.integrator.method import Baseline
from fvi_cli.scenes.problem import DerivativeProblem, Problem

MOST_STEPS: Final = 2**30
LONGEST_NAME: Final = 100
# Break points are taken for fractions of the interval with denominators up to this.
_LARGEST_DENOMINATOR: Final = 2**20
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*", re.ASCII)


def is_name(text: str) -> bool:
    """Whether `text` can be the name of an experiment."""
    return len(text) <= LONGEST_NAME and _NAME.fullmatch(text) is not None


@dataclass(frozen=True, kw_only=True)
class Name:
    """A name that can be part of a file name."""

    expected: str = "letters, digits, - and _, beginning with a letter or digit"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """The text."""
        text = node.text if isinstance(node, ScalarNode) else ""
        if isinstance(node, ScalarNode) and len(text) > LONGEST_NAME:
            complaints.add(
                node.place, path, f"{len(text)} characters; at most {LONGEST_NAME} are allowed"
            )
            return INVALID
        if not _NAME.fullmatch(text):
            complaints.add(
                node.place, path, f"{describe(node)} is not allowed; it must be {self.expected}"
            )
            return INVALID
        return text

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": "string", "pattern": f"^{_NAME.pattern}$", "maxLength": LONGEST_NAME}


@dataclass(frozen=True, kw_only=True)
class ByCase:
    """A mapping from cases, or their first parts such as ``bdf5``, to something."""

    shape: Shape

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"a mapping from methods, such as bdf5, to {self.shape.expected}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A dict."""
        if not isinstance(node, MappingNode):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        return {
            name: self.shape.read(entry.node, (*path, name), complaints)
            for name, entry in node.entries.items()
        }

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return {"type": "object", "additionalProperties": self.shape.schema()}


_STEPS: Final = Integer(least=1, most=MOST_STEPS)
_LADDER_KEYS: Final = Record(
    keys=(
        Key(
            name="steps",
            shape=OneOrMany(shape=_STEPS, most=100),
            meaning="Numbers N of steps, increasing; the step size is final_time / N.",
            default=OPTIONAL,
        ),
        Key(
            name="from",
            shape=Integer(least=0, most=30),
            meaning="In place of steps: the first exponent k of N = base**k.",
            default=OPTIONAL,
        ),
        Key(
            name="to",
            shape=Integer(least=0, most=30),
            meaning="The last exponent.",
            default=OPTIONAL,
        ),
        Key(
            name="base",
            shape=Integer(least=2, most=MOST_STEPS),
            meaning="The base; default 2.",
            default=OPTIONAL,
        ),
    )
)


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """Numbers of steps as a list, or as powers of a base."""

    expected: str = "{steps: [16, 32, 64]} or {from: 4, to: 6, base: 2}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """``{"steps": [...]}``."""
        if not isinstance(node, MappingNode):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        values = _LADDER_KEYS.read(node, path, complaints)
        if not is_complete(values):
            return INVALID
        if "steps" in values:
            for key in ("from", "to", "base"):
                if key in values:
                    complaints.add(
                        node.entries[key].key_place, (*path, key), "not together with steps"
                    )
            return self._increasing(values["steps"], node, path, complaints)
        missing = [key for key in ("from", "to") if key not in values]
        if missing:
            complaints.add(node.place, path, f"{missing[0]} is missing; it must be {self.expected}")
            return INVALID
        first, last, base = values["from"], values["to"], values.get("base", 2)
        if last < first or base**last > MOST_STEPS:
            message = (
                f"{last} is less than from = {first}"
                if last < first
                else f"{base}**{last} steps are too many; at most {MOST_STEPS} are allowed"
            )
            complaints.add(node.entries["to"].node.place, (*path, "to"), message)
            return INVALID
        return {"steps": [base**exponent for exponent in range(first, last + 1)]}

    def _increasing(
        self, steps: list[int], node: MappingNode, path: KeyPath, complaints: Complaints
    ) -> Any:
        for index in range(1, len(steps)):
            if not steps[index] > steps[index - 1]:
                key: KeyPath = ("steps", index)
                complaints.add(
                    node_at(node, key)[0].place,
                    (*path, *key),
                    f"{steps[index]} is not greater than {steps[index - 1]} before it; "
                    "numbers of steps must increase",
                )
                return INVALID
        return {"steps": steps}

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        whole = _LADDER_KEYS.schema()
        properties = whole["properties"]
        powers = {key: properties[key] for key in ("from", "to", "base")}
        common = {"type": "object", "additionalProperties": False}
        return {
            "oneOf": [
                {**common, "properties": {"steps": properties["steps"]}, "required": ["steps"]},
                {**common, "properties": powers, "required": ["from", "to"]},
            ]
        }


_REPORT: Final = Record(
    keys=(
        Key(
            name="norm",
            shape=Choice(words=get_args(Norm)),
            meaning="Norm of the error: max (over components and grid points), final (at "
            "final_time) or l2 (weighted by the step size).",
            default="max",
        ),
    )
)
_STORE: Final = Record(
    keys=(
        Key(
            name="every",
            shape=Integer(least=1, most=MOST_STEPS),
            meaning="Keep every n-th grid point in files.",
            default=1,
        ),
    )
)
FIGURES: Final = ("convergence", "trajectory", "energy", "error")


def _experiment_record(name: Key) -> Record:
    return Record(
        keys=(
            name,
            Key(name="problem", shape=PROBLEM, meaning="What is solved."),
            Key(
                name="method",
                shape=METHODS,
                meaning="One method or several; every entry is a value or a list of values, and "
                "lists are combined. Default: {rk: gauss, degree: 3}.",
                default=OPTIONAL,
            ),
            Key(name="ladder", shape=Ladder(), meaning="Numbers of steps."),
            Key(
                name="report",
                shape=_REPORT,
                meaning="How errors are measured.",
                default={"norm": "max"},
            ),
            Key(
                name="expect",
                shape=ByCase(shape=Choice(words=("unstable", "diverged", "failed"))),
                meaning="Failures that are known; they do not make the exit code 1.",
                default={},
            ),
            Key(
                name="claims",
                shape=ByCase(shape=Number()),
                meaning="Orders that the source claims, to stand beside what is measured.",
                default={},
            ),
            Key(
                name="figures",
                shape=ListOf(shape=Choice(words=FIGURES), least=0, example="[convergence]"),
                meaning="Figures to draw. Default: convergence for a ladder of three or more "
                "numbers of steps, otherwise trajectory, energy and error.",
                default=[],
            ),
            Key(
                name="allow_unstable",
                shape=Flag(),
                meaning="Compute runs that are predicted to blow up.",
                default=False,
            ),
            Key(name="store", shape=_STORE, meaning="What is kept in files.", default={"every": 1}),
        ),
        refused={"methods": "not a key: write method", "steps": "not a key: write ladder"},
    )


EXPERIMENT: Final = _experiment_record(
    Key(name="name", shape=Name(), meaning="Name of the experiment; file names come from it.")
)
SINGLE: Final = _experiment_record(
    Key(
        name="name",
        shape=Name(),
        meaning="Name of the experiment; file names come from it. Default: name of this file.",
        default=OPTIONAL,
    )
)
SEVERAL: Final = Record(
    keys=(
        Key(
            name="name",
            shape=Name(),
            meaning="File names come from it. Default: name of this file.",
            default=OPTIONAL,
        ),
        Key(
            name="experiments",
            shape=ListOf(shape=EXPERIMENT, most=1000),
            meaning="Experiments, each with its name.",
        ),
    )
)


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
    if isinstance(values["problem"], Mapping):
        problem = make_problem(
            values["problem"], node.entries["problem"].node, (*path, "problem"), complaints
        )
    method_entry = node.entries.get("method")
    methods = read_methods(
        method_entry.node if method_entry is not None else None, (*path, "method"), complaints
    )
    steps = _steps(values["ladder"])
    if isinstance(values["problem"], Mapping):
        _check_break_points(values["problem"], steps, node, path, complaints)
    for key in ("expect", "claims"):
        _check_cases(key, values[key], methods, node, path, complaints)
    if problem is not None:
        _check_meeting(problem, methods, complaints)
        dimension = problem.scene.dimension if isinstance(problem, Problem) else 1
        _check_memory(dimension, steps, node, path, complaints)
    resolved = {
        **values,
        "name": name,
        "method": [listed_method.resolved for listed_method in methods],
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
    )
    return ReadExperiment(resolved=resolved, experiment=experiment)


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
        if scene.derivative == "riemann-liouville" and scene.initial_position.any():
            return f"{method.case} needs derivative: caputo, or an initial position of 0"
        return ""
    if method.forcing_quadrature == "projected" and method.rule.points > method.degree + 1:
        return (
            f"forcing_quadrature: projected takes at most degree + 1 = {method.degree + 1} "
            f"quadrature points, not {method.rule.points}"
        )
    return ""


def _check_memory(
    dimension: int,
    steps: tuple[int, ...],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> None:
    """No run may need more memory than there is."""
    available = machine_bytes()
    for index, n_steps in enumerate(steps):
        predicted = predicted_bytes(n_steps, dimension)
        if available is not None and predicted > available:
            _complain_of_step(
                index,
                node,
                path,
                complaints,
                f"{n_steps} steps need about {in_gigabytes(predicted)} of memory, this machine "
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
