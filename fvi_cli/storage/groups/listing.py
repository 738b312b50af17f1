"""One line for every group of runs, as ``fvi show`` lists them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvi_cli.storage.differences import difference_in_words
from fvi_cli.storage.files import escape_text
from fvi_cli.storage.groups.reading import StoredGroup
from fvi_cli.storage.records.fields import EMPTY_SUMMARY, ObservedSummary, observed_summary
from fvi_cli.storage.records.record import RUN_KEYS
from fvi_cli.studies.members import swept_in_words


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """One run of a file, or all members of a sweep, summarised in a line."""

    experiment: str
    case: str
    n_steps: int
    step_size: float
    norm: str
    error: float  # for members the largest; their status and predictions are counts (ok: 8; ...)
    status: str
    predicted: str
    created: str
    identity: str
    members: int = 0  # number of members; 0: a single run
    swept: str = ""  # the swept keys and values, in words
    # values in which the run differs from the file's configuration, in words; empty: in none
    variant: str = ""
    observed: ObservedSummary = EMPTY_SUMMARY  # quantities and events of a single run


def list_groups(found: Sequence[tuple[str, StoredGroup]]) -> tuple[StoredRun, ...]:
    """A line for every group (path, group); those of variants name their other values."""
    own: dict[str, Any] = {}
    for path, group in found:
        own.setdefault(path.split("/")[1], _specification(group))
    lines = []
    for path, group in found:
        name, experiment = path.split("/")[1], str(group.attributes["experiment"])
        variant = ""
        if name != experiment:
            variant = _difference(own.get(experiment), _specification(group)) or name
        lines.append(_stored_run(group, variant))
    return tuple(lines)


def _specification(group: StoredGroup) -> dict[str, Any]:
    """All that determines the numbers, and the norm, which also distinguishes variants."""
    return {**json.loads(group.attributes["specification"]), "norm": group.column("norm")[0]}


def _difference(base: dict[str, Any] | None, own: dict[str, Any]) -> str:
    """In words the values in which a run differs from those of the file's configuration."""
    if base is None:
        return ""
    without = {key: own[key] for key in RUN_KEYS}
    return difference_in_words({**base, **without}, own)


def _stored_run(group: StoredGroup, variant: str) -> StoredRun:
    a = group.attributes
    of_several: dict[str, Any] = {"error": float(a.get("error", 0.0))}
    if group.keys:
        errors = np.asarray(group.column("error"))
        swept = [swept_in_words(key, group.column(key)) for key in group.keys]
        of_several = {
            "error": float(np.nanmax(errors)) if np.isfinite(errors).any() else float("nan"),
            "members": len(group),
            "swept": escape_text("; ".join(swept)),
        }
    else:
        of_several["observed"] = observed_summary(a)
    words: dict[str, Any] = {
        n: escape_text(str(a[n]))
        for n in ("experiment", "case", "norm", "status", "predicted", "identity")
    }
    return StoredRun(
        **words,
        n_steps=int(a["n_steps"]),
        step_size=float(a["step_size"]),
        created=escape_text(str(a.get("created", "at several times"))),
        variant=escape_text(variant),
        **of_several,
    )
