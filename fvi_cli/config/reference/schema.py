"""The keys as JSON schema, for editors."""

from __future__ import annotations

import json
from typing import Final

from fvi_cli.config.keys.experiment import EXPERIMENT, SEVERAL, SINGLE
from fvi_cli.keys.scalars import Schema

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


def schema_text() -> str:
    """The JSON schema as the text of a file."""
    return json.dumps(json_schema(), indent=2) + "\n"
