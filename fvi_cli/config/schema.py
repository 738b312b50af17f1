"""The keys as JSON schema, and as commented files to begin with; both from the same shapes."""

from __future__ import annotations

import json
import textwrap
from typing import Any, Final

from fvi_cli.config.accuracy_keys import EXAMPLE
from fvi_cli.config.complaints import listed, suggestion
from fvi_cli.config.experiment_keys import EXPERIMENT, SEVERAL, SINGLE
from fvi_cli.config.problem_keys import PROBLEM
from fvi_cli.config.shapes import Missing, Schema
from fvi_cli.errors import RequestError
from fvi_cli.scenes.registry import EQUATIONS

WIDTH: Final = 98
SCHEMA_TITLE: Final = "Configuration of fvi"


def json_schema() -> Schema:
    """JSON schema (draft 2020-12) of a configuration, for editors.

    Every key has a description, which names its unit, and its default. What holds between keys
    is checked by :func:`fvi_cli.config.parse_config` only.
    """
    single = SINGLE.schema()
    experiment = EXPERIMENT.schema()
    shared = {
        name: definition
        for name, definition in single["properties"].items()
        if name not in ("name", "experiments")
    }
    references = {name: {"$ref": f"#/$defs/{name}"} for name in shared}
    for schema in (single, experiment):
        schema["properties"] = {"name": schema["properties"]["name"], **references}
    several = SEVERAL.schema()
    several["properties"]["experiments"]["items"] = {"$ref": "#/$defs/experiment"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": SCHEMA_TITLE,
        "if": {"required": ["experiments"]},
        "then": several,
        "else": single,
        "$defs": {"experiment": experiment, **shared},
    }


SCHEMA_FILE: Final = "fvi.schema.json"
"""Where a starter file expects the schema: beside it."""

MODELINE: Final = f"# yaml-language-server: $schema={SCHEMA_FILE}"
"""The line at the top of a configuration by which editors find the schema."""


def schema_text() -> str:
    """The JSON schema as the text of a file."""
    return json.dumps(json_schema(), indent=2) + "\n"


# What a starter file says where there is no default, or where the default shows little.
_EXAMPLES: Final[dict[str, dict[str, str]]] = {
    "damped-oscillator": {
        "damping": "[{order: 1.0, coefficient: 0.2}]",
        "initial": "{position: 0.0, velocity: 1.0}",
        "final_time": "16.0",
    },
    "bagley-torvik": {
        "damping": "[{order: 1.5, coefficient: 1.0}]",
        "forcing": "15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5",
        "initial": "{position: 0.0, velocity: 0.0}",
        "final_time": "1.0",
        "exact": "t**2.5",
    },
    "pendulum": {
        "damping": "[{order: 0.5, coefficient: 0.3}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "20.0",
    },
    "duffing": {
        "damping": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "10.0",
    },
    "kepler": {
        "damping": "[{order: 0.5, coefficient: 0.01}]",
        "initial": "{position: [1.0, 0.0], velocity: [0.0, 1.0]}",
        "final_time": "10.0",
    },
    "chain": {
        "masses": "3",
        "dampers": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: [1.0, 0.0, 0.0], velocity: 0.0}",
        "final_time": "10.0",
    },
    "frame": {
        "stiffness": "10.0",
        "dampers": "[{order: 0.5, coefficient: 0.5}]",
        "ground_acceleration": "t**3*exp(-t)*sin(3*t)",
        "final_time": "8.0",
    },
    "string": {
        "modes": "4",
        "pluck": "{at: 0.3, height: 0.1}",
        "internal_damping": "[{order: 0.5, coefficient: 0.01}]",
        "final_time": "2.0",
    },
    "double-pendulum": {
        "joints": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: [1.0, -0.5], velocity: 0.0}",
        "final_time": "4.0",
    },
    "lagrangian": {
        "coordinates": "[x]",
        "parameters": "{m: 1.0, g: 9.81}",
        "lagrangian": "m*vx**2/2 - m*g*(1 - cos(x))",
        "damping": "[{order: 0.5, coefficient: 0.3, acts_on: [x]}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "4.0",
    },
    "fractional-derivative": {
        "order": "0.5",
        "function": "t**2*sin(t)",
        "final_time": "1.0",
    },
}

_MANY: Final = "{from: 0.1, to: 1.9, number: 10}"
_SWEPT: Final[dict[str, str]] = {
    "damped-oscillator": f"problem.damping.0.order: {_MANY}, problem.stiffness: [1, 10]",
    "bagley-torvik": "problem.stiffness: {from: 1, to: 100, number: 5, spacing: log}",
    "pendulum": "problem.initial.position: [0.1, 1.0, 3.0]",
    "duffing": "problem.cubic_stiffness: [0.1, 1.0, 10.0]",
    "kepler": "problem.damping.0.coefficient: [0.0, 0.01, 0.1]",
    "chain": "problem.dampers.0.coefficient: [0.1, 0.2, 0.4]",
    "frame": f"problem.dampers.0.order: {_MANY}",
    "string": "problem.pluck.at: [0.1, 0.3, 0.5]",
    "double-pendulum": "problem.joints.0.order: [0.5, 1.0]",
    "lagrangian": "problem.parameters.g: [1.62, 9.81]",
    "fractional-derivative": f"problem.order: {_MANY}",
}
"""What a starter file shows of a sweep."""


def starter_config(kind: str, *, name: str | None = None) -> str:
    """A commented configuration to begin with; it is valid as it stands.

    Its first line tells editors that the schema is beside it, in :data:`SCHEMA_FILE`.

    Parameters
    ----------
    kind
        Kind of problem.
    name
        Name of the experiment; default ``my-<kind>``.

    Raises
    ------
    RequestError
        For a kind that does not exist.
    """
    kinds = PROBLEM.kinds
    if kind not in kinds:
        raise RequestError(
            f"{kind!r} is no kind of problem{suggestion(kind, kinds)} (known: {listed(kinds)})"
        )
    derivative = kind == "fractional-derivative"
    lines = [
        MODELINE,
        *_comment(EQUATIONS[kind], ""),
        f"name: {name or f'my-{kind}'}",
        "",
        "problem:",
        f"  kind: {kind}",
    ]
    for key in kinds[kind].keys:
        example = _EXAMPLES[kind].get(key.name)
        if example is None and not isinstance(key.default, Missing):
            example = plain(key.default)
        lines += _comment(key.meaning, "  ")
        lines.append(f"  {key.name}: {example}")
    method = "{bdf: [1, 2, 3], sampling: nodes}" if derivative else "{rk: gauss, degree: [2, 3]}"
    examples = {
        "method": method,
        "ladder": "{steps: [16, 32, 64, 128, 256]}",
        "figures": "[convergence]",
    }
    for key in EXPERIMENT.keys:
        if key.name in ("name", "problem"):
            continue
        if key.name == "sweep":
            # not everybody wants one, and there is no empty sweep
            lines += ["", *_comment(key.meaning, ""), f"# sweep: {{{_SWEPT[kind]}}}"]
            continue
        if key.name == "accuracy":
            lines += [] if derivative else ["", *_comment(key.meaning, ""), f"# {EXAMPLE}"]
            continue
        shown = examples.get(key.name)
        if shown is None:
            shown = plain(key.default)
        lines += ["", *_comment(key.meaning, ""), f"{key.name}: {shown}"]
    return "\n".join(lines) + "\n"


def _comment(text: str, indent: str) -> list[str]:
    prefix = f"{indent}# "
    return textwrap.wrap(text, WIDTH, initial_indent=prefix, subsequent_indent=prefix)


def plain(value: Any) -> str:
    """A default as it is written in one line of YAML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {plain(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(plain(entry) for entry in value) + "]"
    return str(value).lower() if isinstance(value, bool) else str(value)
