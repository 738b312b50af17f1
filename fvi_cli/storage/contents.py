"""What a result file holds, for people and for other commands."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fvi_cli.storage.batch_records import is_batch, values_in
from fvi_cli.storage.files import reading
from fvi_cli.storage.locations import run_groups
from fvi_cli.storage.records import COMPLETE
from fvi_cli.studies.members import value_in_words

MOST_VALUES = 6
"""Values of a swept key that are told one by one."""

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
    """One run of a file in a line, or the members of a sweep.

    Parameters
    ----------
    error, status, predicted
        Of members: the largest error, and what there is how often.
    members
        Number of members; 0: a single run.
    swept
        What members differ in, in words.
    """

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
    members: int = 0
    swept: str = ""


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
            of_several = _of_members(group) if is_batch(group) else {"error": float(a["error"])}
            runs.append(
                StoredRun(
                    experiment=experiment,
                    case=case,
                    n_steps=int(a["n_steps"]),
                    step_size=float(a["step_size"]),
                    norm=str(a["norm"]),
                    status=str(a["status"]),
                    predicted=str(a["predicted"]),
                    is_complete=COMPLETE in a,
                    created=str(a.get("created", "at several times")),
                    identity=str(a["identity"]),
                    **of_several,
                )
            )
        return StoredFile(provenance=provenance, runs=tuple(runs))


def _of_members(group: h5py.Group) -> dict[str, Any]:
    """What a line on members says beside what it says of any run."""
    errors = np.asarray(group["error"][()])
    columns = values_in(group)
    keys = list(columns[0])
    return {
        "error": float(np.nanmax(errors)) if np.isfinite(errors).any() else float("nan"),
        "members": len(columns),
        "swept": "; ".join(_told(key, [one[key] for one in columns]) for key in keys),
    }


def _told(key: str, values: Sequence[Any]) -> str:
    distinct = list(dict.fromkeys(map(value_in_words, values)))
    if len(distinct) <= MOST_VALUES:
        return f"{key} = {', '.join(distinct)}"
    return f"{key} = {distinct[0]} ... {distinct[-1]} ({len(distinct)} values)"
