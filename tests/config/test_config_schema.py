"""What editors check by the JSON schema is what the program reads."""

from typing import Any

import jsonschema
import pytest

from fvi_cli.config import find_config, json_schema, shipped_configs, starter_config
from fvi_cli.config.text.tree import read_document
from fvi_cli.scenes.registry import KINDS

SCHEMA = json_schema()
CHECK = jsonschema.Draft202012Validator(SCHEMA)

CONFIG = """
name: small
problem: {kind: pendulum, final_time: 1.0}
ladder: {steps: [8, 16]}
"""


def plain(text: str) -> Any:
    """The values that stand in a configuration."""
    return read_document(text, "text").value


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", shipped_configs())
def test_shipped_configurations_fit(name):
    CHECK.validate(plain(find_config(name).read_text(encoding="utf-8")))


@pytest.mark.parametrize("kind", KINDS)
def test_starters_fit(kind):
    CHECK.validate(plain(starter_config(kind)))


@pytest.mark.parametrize(
    "entry",
    [
        "methods: {bdf: 2}", "method: {bdf: 7}", "method: {bdf: 2, sampling: node}",
        "report: {norm: mean}", "problem: {kind: pendulm, final_time: 1.0}",
        "problem: {kind: pendulum, final_time: 0}",
        "problem: {kind: pendulum, final_time: 1.0, stiffness: 2}",
        "problem: {kind: pendulum, final_time: 1.0, damping: [{order: 2.0, coefficient: 1}]}",
        "problem: {kind: pendulum, final_time: 1.0, damping: [{order: 0.5}]}",
        "ladder: {steps: [0]}", "store: {every: 0}",
    ],
)  # fmt: skip
def test_mistakes_do_not_fit(entry):
    CHECK.validate(plain(CONFIG))
    key = entry.partition(":")[0]
    lines = [line for line in CONFIG.splitlines() if not line.startswith(f"{key}:")]
    wrong = plain("\n".join([*lines, entry]))
    assert list(CHECK.iter_errors(wrong)), entry
