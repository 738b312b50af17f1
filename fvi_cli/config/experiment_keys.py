"""The keys of an experiment and of a file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final, get_args

from fvi_cli.config.accuracy_keys import ACCURACY
from fvi_cli.config.complaints import Complaints, KeyPath
from fvi_cli.config.diagnostic_keys import DIAGNOSTIC_KEYS
from fvi_cli.config.document import MappingNode, Node, ScalarNode
from fvi_cli.config.method_keys import METHODS
from fvi_cli.config.problem_keys import PROBLEM
from fvi_cli.config.records import Key, ListOf, OneOrMany, Record, node_at
from fvi_cli.config.shapes import (
    INVALID,
    OPTIONAL,
    Choice,
    Flag,
    Integer,
    Number,
    Schema,
    Shape,
    is_complete,
    needed,
)
from fvi_cli.config.stability_keys import STABILITY
from fvi_cli.config.sweep import SweepShape
from fvi_cli.studies.experiment import Norm

MOST_STEPS: Final = 2**30
LONGEST_NAME: Final = 100
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
        given = isinstance(node, ScalarNode) and isinstance(node.value, str | int | float)
        text = node.text if isinstance(node, ScalarNode) and given else ""
        if isinstance(node, ScalarNode) and len(text) > LONGEST_NAME:
            complaints.add(
                node.place, path, f"{len(text)} characters; at most {LONGEST_NAME} are allowed"
            )
            return INVALID
        if not _NAME.fullmatch(text):
            complaints.add(node.place, path, needed(node, self.expected))
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
        *DIAGNOSTIC_KEYS,
    )
)
FIGURES: Final = (
    "convergence",
    "trajectory",
    "energy",
    "error",
    "balance",
    "momenta",
    "phase",
    "path",
    "waterfall",
)


def _experiment_record(name: Key) -> Record:
    return Record(
        keys=(
            name,
            Key(name="problem", shape=PROBLEM, meaning="What is solved."),
            Key(
                name="method",
                shape=METHODS,
                meaning="One method or several; every entry is a value or a list of values, and "
                "lists are combined. Default: {rk: gauss, degree: 3}; with accuracy Gauss methods "
                "of degree 2 to 4.",
                default=OPTIONAL,
            ),
            Key(
                name="ladder",
                shape=Ladder(),
                meaning="Numbers of steps; this or accuracy is required.",
                default=OPTIONAL,
            ),
            Key(
                name="accuracy",
                shape=ACCURACY,
                meaning="In place of ladder: method (one of those given, or of Gauss methods) and "
                "number of steps are chosen for a tolerance, which an estimate is held against.",
                default=OPTIONAL,
            ),
            Key(
                name="sweep",
                shape=SweepShape(),
                meaning="Members: every combination of values of some keys of the problem, or a "
                "list of mappings with the values of each member. They are computed together.",
                default=OPTIONAL,
            ),
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
            Key(
                name="stability",
                shape=STABILITY,
                meaning="What fvi stability looks at, beside the methods and steps.",
                default={"observe": True},
            ),
        ),
        refused={"methods": "not a key: write method", "steps": "not a key: write ladder"},
        alternatives=("ladder", "accuracy"),
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
