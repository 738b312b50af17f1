"""The contents of a result file, for people and for other commands."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import fvi_cli
from fvi_cli.errors import StorageError
from fvi_cli.storage.digests import Inputs, canonical_json, extract_inputs, insert_inputs, sha256
from fvi_cli.storage.files import escape_text, explain_damage
from fvi_cli.storage.groups.listing import StoredRun, list_groups
from fvi_cli.storage.records.record import REFERENCES
from fvi_cli.storage.result_file import ResultFile

RESOLVED = "resolved_config_sha256"
CONFIGURATION = ("config", "config_overrides", "resolved_config", RESOLVED)
"""Attributes of the root that describe the configuration."""


class Configuration(Protocol):
    """The configuration, as far as a file stores it."""

    @property
    def text(self) -> str:
        """The text of the configuration, word for word."""

    @property
    def resolved(self) -> Mapping[str, Any]:
        """The configuration with every default filled in."""

    @property
    def overrides(self) -> tuple[str, ...]:
        """Changes ``key.path=value`` that the command made to it."""


@dataclass(frozen=True, kw_only=True)
class StoredConfiguration:
    """The configuration that made a file."""

    text: str  # word for word
    overrides: tuple[str, ...]  # changes ``key.path=value`` that the command made to it
    # JSON text with every default filled in and every override applied; since JSON is YAML, it is
    # a configuration of the same experiments
    resolved: str


def described(configuration: Configuration | StoredConfiguration, inputs: Inputs) -> dict[str, str]:
    """Root attributes that describe the configuration; its long lists are added to `inputs`."""
    resolved = configuration.resolved
    values = json.loads(resolved) if isinstance(resolved, str) else resolved
    return {
        "config": configuration.text,
        "config_overrides": json.dumps(list(configuration.overrides)),
        # the order of designs and quantities is that of the configuration
        "resolved_config": json.dumps(extract_inputs(values, inputs)),
        RESOLVED: sha256(canonical_json(values)),
    }


@dataclass(frozen=True, kw_only=True)
class StoredFile:
    """The runs of a file in one line each, and its provenance."""

    # attributes of the root without the configuration: versions, commit, platform, time, format
    provenance: Mapping[str, str]
    runs: tuple[StoredRun, ...]  # in the order of the file


def read_configuration(path: Path | str) -> StoredConfiguration:
    """The configuration that made a result file, word for word, with its overrides."""
    with contextlib.closing(ResultFile(Path(path))) as file, explain_damage(file.path):
        text, overrides, resolved, _ = (str(file.root[name]) for name in CONFIGURATION)
        values = insert_inputs(json.loads(resolved), file.read_input)
    return StoredConfiguration(
        text=text, overrides=tuple(json.loads(overrides)), resolved=json.dumps(values)
    )


def has_configuration(path: Path, configuration: Configuration) -> bool:
    """Whether a result file of this version was made for the configuration."""
    with contextlib.suppress(StorageError), contextlib.closing(ResultFile(path)) as file:
        resolved = sha256(canonical_json(configuration.resolved))
        return (file.root[RESOLVED], file.root["fvi_version"]) == (resolved, fvi_cli.__version__)
    return False


def list_runs(path: Path | str) -> StoredFile:
    """The runs and the provenance of a result file, without the numbers of the runs."""
    with contextlib.closing(ResultFile(Path(path))) as file:
        provenance = {
            escape_text(name): escape_text(str(value))
            for name, value in file.root.items()
            if name not in CONFIGURATION[:3]
        }
        with explain_damage(file.path):
            groups = [
                (str(one["path"]), file.group(one["path"]))
                for one in file.groups
                if one["kind"]["experiment"] != REFERENCES
            ]
            return StoredFile(provenance=provenance, runs=list_groups(groups))
