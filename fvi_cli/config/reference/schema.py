"""The keys as JSON schema, for editors."""

from __future__ import annotations

import json
from typing import Final

from fvi_cli.config.keys.experiment import SEVERAL, SINGLE
from fvi_cli.keys.scalars import Schema

SCHEMA_TITLE: Final = "Configuration of fvi"


def json_schema() -> Schema:
    """JSON schema (draft 2020-12) of a configuration, for editors.

    Every key has a description, which names its unit, and its default. What holds between keys
    is checked by :func:`fvi_cli.config.parse_config` only.
    """
    defs: Schema = {}
    single, several = SINGLE.whole(defs), SEVERAL.whole(defs)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": SCHEMA_TITLE,
        "if": {"required": ["experiments"]},
        "then": several,
        "else": single,
        "$defs": defs,
    }


SCHEMA_FILE: Final = "fvi.schema.json"
"""Where a starter file expects the schema: beside it."""


def schema_text() -> str:
    """The JSON schema as the text of a file."""
    return json.dumps(json_schema(), indent=2) + "\n"
