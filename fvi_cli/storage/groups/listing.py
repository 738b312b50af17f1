"""One line for every group of runs, written into the index and listed by ``fvi show``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fvi_cli.integrator.results.observed import Extent
from fvi_cli.storage.differences import difference_in_words
from fvi_cli.storage.files import escape_text
from fvi_cli.storage.groups.writing import WrittenGroup
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


def run_of_line(row: dict[str, Any]) -> StoredRun:
    """The inverse of a line of :func:`lines_of`; its texts are safe to print."""
    words: dict[str, Any] = {k: escape_text(v) if isinstance(v, str) else v for k, v in row.items()}
    own = row.get("observed")
    if own is not None:
        extents = {name: Extent(**one) for name, one in own["extents"].items()}
        words["observed"] = ObservedSummary(**{**own, "extents": extents})
    return StoredRun(**words)


def lines_of(found: Sequence[tuple[str, WrittenGroup]]) -> list[dict[str, Any]]:
    """A line for every group (path, group); groups of variants name their other values."""
    names = [path.split("/")[1] for path, _ in found]
    specifications = [_specification(group) for _, group in found]
    own: dict[str, Any] = {}
    for name, specification in zip(names, specifications, strict=True):
        own.setdefault(name, specification)
    lines, empty = [], asdict(EMPTY_SUMMARY)
    for name, (_, group), specification in zip(names, found, specifications, strict=True):
        experiment = str(group.attributes["experiment"])
        variant = ""
        if name != experiment:
            variant = _difference(own.get(experiment), specification) or name
        row = asdict(_stored_run(group, variant))
        lines.append({k: v for k, v in row.items() if v != empty})
    return lines


def _specification(group: WrittenGroup) -> dict[str, Any]:
    """All that determines the numbers, and the norm, which also distinguishes variants."""
    return {**json.loads(group.attributes["specification"]), "norm": group.survey.column("norm")[0]}


def _difference(base: dict[str, Any] | None, own: dict[str, Any]) -> str:
    """In words the values in which a run differs from those of the file's configuration."""
    if base is None:
        return ""
    without = {key: own[key] for key in RUN_KEYS}
    return difference_in_words({**base, **without}, own)


def _stored_run(group: WrittenGroup, variant: str) -> StoredRun:
    a = group.attributes
    of_several: dict[str, Any] = {"error": float(a.get("error", 0.0))}
    if group.keys:
        errors = np.asarray(group.survey.column("error"))
        swept = [swept_in_words(key, group.survey.column(key)) for key in group.keys]
        of_several = {
            "error": float(np.nanmax(errors)) if np.isfinite(errors).any() else float("nan"),
            "members": len(group.survey),
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
