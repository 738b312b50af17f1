"""Commented configurations to begin with."""

from __future__ import annotations

import textwrap
from typing import Any, Final

from fvi_cli.config.keys.accuracy import EXAMPLE
from fvi_cli.config.keys.experiment import EXPERIMENT
from fvi_cli.config.load import parse_config
from fvi_cli.config.reference.schema import SCHEMA_FILE
from fvi_cli.errors import RequestError
from fvi_cli.integrator.observations.request import names_of
from fvi_cli.keys.complaints import listed, suggestion
from fvi_cli.keys.cursor import Missing
from fvi_cli.keys.settings import keys_of
from fvi_cli.scenes.kinds import KINDS, SceneKind
from fvi_cli.scenes.kinds.material import Material
from fvi_cli.scenes.problem import Problem

WIDTH: Final = 98
MODELINE: Final = f"# yaml-language-server: $schema={SCHEMA_FILE}"
"""The line at the top of a configuration by which editors find the schema."""
OF_MATERIAL: Final = {
    "ladder": "ladder: {steps: [500]}",
    "figures": "figures: [hysteresis]",
    "output": "# output: {count: 1000}",
    "quantities": "# quantities: {force: force_1, deformation: deformation_1}",
    "fit": "# fit:\n"
    "#   data: {file: measured.csv, time: t, columns: {force: force}}\n"
    "#   parameters: {problem.law.order: {}}",
}
"""Keys of a damper on the bench, whose motion is given."""


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
    if kind not in KINDS:
        raise RequestError(
            f"{kind!r}: unknown kind of problem{suggestion(kind, KINDS)} (known: {listed(KINDS)})"
        )
    described = KINDS[kind]
    lines = [
        MODELINE,
        *_comment(described.equation, ""),
        f"name: {name or f'my-{kind}'}",
        "",
        "problem:",
        f"  kind: {kind}",
    ]
    for key in keys_of(described):
        default = "{}" if isinstance(key.default, Missing) else plain(key.default)
        value = described.example.get(key.name) or default
        lines += [*_comment(key.description, "  "), f"  {key.name}: {value}"]
    shown = {
        "method": f"method: {described.methods}",
        "ladder": "ladder: {steps: [16, 32, 64, 128, 256]}",
        "sweep": f"# sweep: {{{described.sweep}}}",
        "figures": "figures: [convergence]",
    }
    if issubclass(described, SceneKind):
        core = "\n".join([*lines, shown["ladder"]])
        problem = parse_config(core, "starter").experiments[0].problem
        shown |= _switched_off(described, problem) if isinstance(problem, Problem) else {}
    elif described is Material:
        shown |= OF_MATERIAL
    for key in EXPERIMENT.keys:
        if key.name in shown:
            lines += ["", *_comment(key.description, ""), shown[key.name]]
    return "\n".join(lines) + "\n"


def _switched_off(kind: type[SceneKind], problem: Problem) -> dict[str, str]:
    """Keys that not every study needs, or that take the place of others, as comments."""
    name = (problem.coordinates or names_of(problem.scene))[0]
    fitted = kind.sweep.partition(":")[0]
    return {
        "accuracy": f"# {EXAMPLE}",
        "output": "# output: {count: 1000}",
        "quantities": f"# quantities: {{speed: v{name}, acceleration: a{name}}}",
        "events": f"# events: {{turn: {{when: v{name}, direction: falling}}}}",
        "fit": "# fit:\n"
        f"#   data: {{file: measured.csv, time: t, columns: {{{name}: displacement}}}}\n"
        f"#   parameters: {{{fitted}: {{}}}}",
    }


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
