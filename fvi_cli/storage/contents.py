"""What a result file holds, for people and for other commands."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fvi_cli.integrator.results.observed import Extent
from fvi_cli.storage.comparison.differences import difference_in_words
from fvi_cli.storage.fields.observed import (
    NOTHING_OBSERVED,
    ObservedSummary,
    observed_summary,
)
from fvi_cli.storage.files import printable, reading, root_attributes
from fvi_cli.storage.groups import StoredGroup, run_groups
from fvi_cli.storage.provenance import canonical_json, sha256
from fvi_cli.storage.records import RUN_KEYS
from fvi_cli.storage.stream import read_seal
from fvi_cli.storage.writing import WrittenGroup
from fvi_cli.studies.members import swept_in_words

RESOLVED = "resolved_config_sha256"
CONFIGURATION = ("config", "config_overrides", "resolved_config", RESOLVED)
"""Attributes of the root that tell of the configuration."""


LISTING = "listing"
"""Attribute of the root: what a list of the runs says, as JSON."""


ListedGroup = StoredGroup | WrittenGroup
"""Runs of a group, read or just written."""


class Configuration(Protocol):
    """What a file says of the configuration that made it."""

    @property
    def text(self) -> str:
        """Word for word."""

    @property
    def resolved(self) -> Mapping[str, Any]:
        """With every default filled in."""

    @property
    def overrides(self) -> tuple[str, ...]:
        """Changes that were asked for beside it."""


def described(configuration: Configuration | StoredConfiguration) -> dict[str, str]:
    """What the root of a file says of the configuration."""
    resolved = configuration.resolved
    if not isinstance(resolved, str):
        resolved = canonical_json(resolved)
    return {
        "config": configuration.text,
        "config_overrides": json.dumps(list(configuration.overrides)),
        "resolved_config": resolved,
        RESOLVED: sha256(resolved),
    }


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
    variant
        In words what the run has other than the file's configuration; empty for the runs of it.
    observed
        Quantities and events of a single run.
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
    variant: str = ""
    observed: ObservedSummary = NOTHING_OBSERVED


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
        root = root_attributes(file)
        text, overrides, resolved, _ = (str(root[name]) for name in CONFIGURATION)
        return StoredConfiguration(
            text=text, overrides=tuple(json.loads(overrides)), resolved=resolved
        )


def list_runs(path: Path) -> StoredFile:
    """Runs and provenance of a result file.

    Raises
    ------
    StorageError
        If the file cannot be read or is not ours.
    """
    with reading(path) as file, path.open("rb") as again:
        root = root_attributes(file)
        provenance = {
            printable(name): printable(str(value))
            for name, value in root.items()
            if name not in (*CONFIGURATION[:3], LISTING)
        }
        # what no other program has touched is listed as it was written, whatever there is of it
        if LISTING in root and read_seal(again.fileno()) is not None:
            runs = [_listed(one) for one in json.loads(root[LISTING])]
        else:
            runs = _runs_of([(experiment, group) for experiment, _, group in run_groups(file)])
        return StoredFile(provenance=provenance, runs=tuple(runs))


def listing_of(groups: Sequence[tuple[str, ListedGroup]]) -> str:
    """The runs of a file as the JSON text that is kept in it, so that a list opens no group.

    Parameters
    ----------
    groups
        All that were written, with the name of the outermost group that each lies in.
    """
    rows = [asdict(run) for run in _runs_of(groups)]
    nothing = asdict(NOTHING_OBSERVED)
    return json.dumps([{k: v for k, v in row.items() if v != nothing} for row in rows])


def _listed(row: dict[str, Any]) -> StoredRun:
    words: dict[str, Any] = {k: printable(v) if isinstance(v, str) else v for k, v in row.items()}
    own = row.get("observed")
    if own is not None:
        extents = {name: Extent(**one) for name, one in own["extents"].items()}
        words["observed"] = ObservedSummary(**{**own, "extents": extents})
    return StoredRun(**words)


def _runs_of(found: Sequence[tuple[str, ListedGroup]]) -> list[StoredRun]:
    """A line for every group; those of other values say which."""
    specifications = [json.loads(group.attributes["specification"]) for _, group in found]
    own: dict[str, Any] = {}
    for (name, _), specification in zip(found, specifications, strict=True):
        own.setdefault(name, specification)
    runs = []
    for (name, group), specification in zip(found, specifications, strict=True):
        experiment = str(group.attributes["experiment"])
        variant = ""
        if name != experiment:
            variant = _difference(own.get(experiment), specification) or name
        runs.append(_stored_run(group, variant))
    return runs


def _difference(base: dict[str, Any] | None, own: dict[str, Any]) -> str:
    """In words what a run has other than the runs of the file's configuration."""
    if base is None:
        return ""
    without = {key: own[key] for key in RUN_KEYS}
    also = {key: own[key] for key in RUN_KEYS if key != "allow_unstable"}
    return difference_in_words({**base, **without}, own) or difference_in_words(
        {**base, **also}, own
    )


def _stored_run(group: ListedGroup, variant: str) -> StoredRun:
    a = group.attributes
    of_several: dict[str, Any] = (
        _of_members(group)
        if group.keys
        else {"error": float(a["error"]), "observed": observed_summary(a)}
    )
    names = ("experiment", "case", "norm", "status", "predicted", "identity")
    words: dict[str, Any] = {name: printable(str(a[name])) for name in names}
    return StoredRun(
        **words,
        n_steps=int(a["n_steps"]),
        step_size=float(a["step_size"]),
        is_complete=group.is_complete,
        created=printable(str(a.get("created", "at several times"))),
        variant=printable(variant),
        **of_several,
    )


def _of_members(group: ListedGroup) -> dict[str, Any]:
    """What a line on members says beside what it says of any run."""
    errors = np.asarray(group.by_member["error"])
    swept = [swept_in_words(key, group.by_member[key]) for key in group.keys]
    return {
        "error": float(np.nanmax(errors)) if np.isfinite(errors).any() else float("nan"),
        "members": len(group),
        "swept": printable("; ".join(swept)),
    }
