"""What a result file holds, for people and for other commands."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fvi_cli.output.storage.files import reading
from fvi_cli.output.storage.records import COMPLETE
from fvi_cli.output.storage.results import run_groups

_CONFIGURATION = ("config", "config_overrides", "resolved_config")


@dataclass(frozen=True, kw_only=True)
class StoredConfiguration:
    """The configuration that made a file.

    Parameters
    ----------
    text
        Word for word.
    overrides
        Changes ``key.path=value`` that were asked for beside it.
    resolved
        JSON text with every default filled in and every override applied; being YAML too, it is
        a configuration of the same experiments.
    """

    text: str
    overrides: tuple[str, ...]
    resolved: str


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """One run of a file in a line."""

    experiment: str
    case: str
    n_steps: int
    step_size: float
    norm: str
    error: float
    status: str
    predicted: str
    is_complete: bool
    created: str
    identity: str


@dataclass(frozen=True, kw_only=True)
class StoredFile:
    """What a file holds and where it comes from.

    Parameters
    ----------
    provenance
        Attributes of the root without the configuration: versions, commit, platform, time, format.
    runs
        In the order of the file.
    """

    provenance: Mapping[str, str]
    runs: tuple[StoredRun, ...]


def read_configuration(path: Path) -> StoredConfiguration:
    """The configuration that made a result file.

    Raises
    ------
    StorageError
        If the file cannot be read or is not ours.
    """
    with reading(path) as file:
        text, overrides, resolved = (str(file.attrs[name]) for name in _CONFIGURATION)
        return StoredConfiguration(
            text=text, overrides=tuple(json.loads(overrides)), resolved=resolved
        )


def read_config_text(path: Path) -> str:
    """The text of the configuration that made a result file, word for word.

    Raises
    ------
    StorageError
        If the file cannot be read or is not ours.
    """
    return read_configuration(path).text


def list_runs(path: Path) -> StoredFile:
    """Runs and provenance of a result file.

    Raises
    ------
    StorageError
        If the file cannot be read or is not ours.
    """
    with reading(path) as file:
        provenance = {
            name: str(value) for name, value in file.attrs.items() if name not in _CONFIGURATION
        }
        runs = []
        for experiment, case, group in run_groups(file):
            a = group.attrs
            runs.append(
                StoredRun(
                    experiment=experiment,
                    case=case,
                    n_steps=int(a["n_steps"]),
                    step_size=float(a["step_size"]),
                    norm=str(a["norm"]),
                    error=float(a["error"]),
                    status=str(a["status"]),
                    predicted=str(a["predicted"]),
                    is_complete=COMPLETE in a,
                    created=str(a["created"]),
                    identity=str(a["identity"]),
                )
            )
        return StoredFile(provenance=provenance, runs=tuple(runs))
