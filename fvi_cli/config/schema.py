"""The keys as a JSON schema for editors, and starter files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from fvi_cli.config.models import ExperimentKeys, SeveralExperiments
from fvi_cli.errors import RequestError, listed, suggestion
from fvi_cli.scenes.registry import KINDS

SCHEMA_FILE: Final = "fvi.schema.json"
"""Name of the schema file, beside a starter file."""
MODELINE: Final = f"# yaml-language-server: $schema={SCHEMA_FILE}"
"""The line at the top of a configuration by which editors find the schema."""


def json_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a configuration, for editors.

    Every key has a description and its default. Only :func:`fvi_cli.config.parse_config` checks
    combinations of keys.
    """
    references = "#/$defs/{model}"
    single = TypeAdapter(ExperimentKeys).json_schema(ref_template=references)
    several = SeveralExperiments.model_json_schema(ref_template=references)
    several["properties"]["experiments"]["items"] = {"$ref": "#/$defs/Experiment"}
    defs = {**single.pop("$defs"), "Experiment": single}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Configuration of fvi",
        "if": {"required": ["experiments"]},
        "then": several,
        "else": {"$ref": "#/$defs/Experiment"},
        "$defs": defs,
    }


def schema_text() -> str:
    """The JSON schema as the text of a file."""
    return json.dumps(json_schema(), indent=2) + "\n"


def starter_config(kind: str, *, name: str | None = None) -> str:
    """A commented, valid configuration of a kind of problem, to begin with.

    The default name is ``my-<kind>``.
    """
    if kind not in KINDS:
        words = f"{kind!r}: unknown kind of problem{suggestion(kind, KINDS)}"
        raise RequestError(f"{words} (known: {listed(KINDS)})")
    path = Path(__file__).parent / "starters" / f"{kind}.yaml"
    text = path.read_text(encoding="utf-8")
    return text if name is None else text.replace(f"name: my-{kind}", f"name: {name}")
