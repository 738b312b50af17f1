"""What a result file holds, for people and for other commands."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import fvi_cli
from fvi_cli.errors import StorageError
from fvi_cli.integrator.results.observed import Extent
from fvi_cli.storage.comparison.differences import difference_in_words
from fvi_cli.storage.digests import Inputs, canonical_json, restored, sha256, stowed
from fvi_cli.storage.files import escape_text, explain_damage
from fvi_cli.storage.groups.writing import WrittenGroup
from fvi_cli.storage.records.fields import EMPTY_SUMMARY, ObservedSummary, observed_summary
from fvi_cli.storage.records.record import REFERENCES, RUN_KEYS
from fvi_cli.storage.result_file import ResultFile
from fvi_cli.studies.members import swept_in_words

RESOLVED = "resolved_config_sha256"
CONFIGURATION = ("config", "config_overrides", "resolved_config", RESOLVED)
"""Attributes of the root that describe the configuration."""


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


@dataclass(frozen=True, kw_only=True)
class StoredConfiguration:
    """The configuration that made a file."""

    text: str  # word for word
    overrides: tuple[str, ...]  # changes ``key.path=value`` that were asked for beside it
    # JSON text with every default filled in and every override applied; being YAML too, it is a
    # configuration of the same experiments
    resolved: str


def described(configuration: Configuration | StoredConfiguration, inputs: Inputs) -> dict[str, str]:
    """What the root of a file says of the configuration; `inputs` learns its long lists."""
    resolved = configuration.resolved
    values = json.loads(resolved) if isinstance(resolved, str) else resolved
    return {
        "config": configuration.text,
        "config_overrides": json.dumps(list(configuration.overrides)),
        "resolved_config": canonical_json(stowed(values, inputs)),
        RESOLVED: sha256(canonical_json(values)),
    }


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """One run of a file in a line, or the members of a sweep."""

    experiment: str
    case: str
    n_steps: int
    step_size: float
    norm: str
    error: float  # of members: the largest error, and what there is how often
    status: str
    predicted: str
    created: str
    identity: str
    members: int = 0  # number of members; 0: a single run
    swept: str = ""  # what members differ in, in words
    # in words what the run has other than the file's configuration; empty for the runs of it
    variant: str = ""
    observed: ObservedSummary = EMPTY_SUMMARY  # quantities and events of a single run


@dataclass(frozen=True, kw_only=True)
class StoredFile:
    """What a file holds and where it comes from."""

    # attributes of the root without the configuration: versions, commit, platform, time, format
    provenance: Mapping[str, str]
    runs: tuple[StoredRun, ...]  # in the order of the file


def read_configuration(path: Path | str) -> StoredConfiguration:
    """The configuration that made a result file, word for word, with its overrides."""
    with contextlib.closing(ResultFile(Path(path))) as file, explain_damage(file.path):
        text, overrides, resolved, _ = (str(file.root[name]) for name in CONFIGURATION)
        values = restored(json.loads(resolved), file.read_input)
    return StoredConfiguration(
        text=text, overrides=tuple(json.loads(overrides)), resolved=canonical_json(values)
    )


def has_configuration(path: Path, configuration: Configuration) -> bool:
    """Whether a result file of this version was made for the configuration."""
    with contextlib.suppress(StorageError), contextlib.closing(ResultFile(path)) as file:
        resolved = sha256(canonical_json(configuration.resolved))
        return (file.root[RESOLVED], file.root["fvi_version"]) == (resolved, fvi_cli.__version__)
    return False


def list_runs(path: Path | str) -> StoredFile:
    """What a result file holds and where it comes from, without the numbers of the runs."""
    with contextlib.closing(ResultFile(Path(path))) as file:
        if not file.is_sealed:  # whatever another program has changed
            for entry in file.entries():
                entry.record()
        provenance = {
            escape_text(name): escape_text(str(value))
            for name, value in file.root.items()
            if name not in CONFIGURATION[:3]
        }
        return StoredFile(
            provenance=provenance,
            runs=tuple(
                _listed(one["line"])
                for one in file.groups
                if one["kind"]["experiment"] != REFERENCES
            ),
        )


def _listed(row: dict[str, Any]) -> StoredRun:
    words: dict[str, Any] = {k: escape_text(v) if isinstance(v, str) else v for k, v in row.items()}
    own = row.get("observed")
    if own is not None:
        extents = {name: Extent(**one) for name, one in own["extents"].items()}
        words["observed"] = ObservedSummary(**{**own, "extents": extents})
    return StoredRun(**words)


def lines_of(found: Sequence[tuple[str, WrittenGroup]]) -> list[dict[str, Any]]:
    """A line for every group by its path; those of other values say which."""
    names = [path.split("/")[1] for path, _ in found]
    specifications = [_specification(group) for _, group in found]
    own: dict[str, Any] = {}
    for name, specification in zip(names, specifications, strict=True):
        own.setdefault(name, specification)
    lines = []
    for name, (_, group), specification in zip(names, found, specifications, strict=True):
        experiment = str(group.attributes["experiment"])
        variant = ""
        if name != experiment:
            variant = _difference(own.get(experiment), specification) or name
        row = asdict(_stored_run(group, variant))
        empty = asdict(EMPTY_SUMMARY)
        lines.append({k: v for k, v in row.items() if v != empty})
    return lines


def _specification(group: WrittenGroup) -> dict[str, Any]:
    """What determines the numbers, and the norm, which distinguishes variants as well."""
    return {**json.loads(group.attributes["specification"]), "norm": group.column("norm")[0]}


def _difference(base: dict[str, Any] | None, own: dict[str, Any]) -> str:
    """In words what a run has other than the runs of the file's configuration."""
    if base is None:
        return ""
    without = {key: own[key] for key in RUN_KEYS}
    return difference_in_words({**base, **without}, own)


def _stored_run(group: WrittenGroup, variant: str) -> StoredRun:
    a = group.attributes
    of_several: dict[str, Any] = {"error": float(a.get("error", 0.0))}
    if group.keys:
        errors = np.asarray(group.column("error"))
        swept = [swept_in_words(key, group.by_member[key]) for key in group.keys]
        of_several = {
            "error": float(np.nanmax(errors)) if np.isfinite(errors).any() else float("nan"),
            "members": len(group),
            "swept": "; ".join(swept),
        }
    else:
        of_several["observed"] = observed_summary(a)
    words: dict[str, Any] = {
        n: str(a[n]) for n in ("experiment", "case", "norm", "status", "predicted", "identity")
    }
    return StoredRun(
        **words,
        n_steps=int(a["n_steps"]),
        step_size=float(a["step_size"]),
        created=str(a.get("created", "at several times")),
        variant=variant,
        **of_several,
    )
