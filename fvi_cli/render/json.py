"""Results as JSON documents with stable keys; null in place of nan and infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from fvi_cli.storage import StoredFile
from fvi_cli.storage.fields import COUNTS, EXTENTS, extents_in, values_of
from fvi_cli.studies.experiment import FinishedRun, Run

JSON_FORMAT = 1
"""Increased when a key is renamed or removed; new keys do not increase it."""


def document(**content: object) -> str:
    """The JSON document of a command."""
    return json.dumps(_plain({"format": JSON_FORMAT, **content}), indent=1, allow_nan=False)


def _plain(value: Any) -> Any:
    """The value with null for nan and infinity, which JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finished_run(finished: FinishedRun) -> dict[str, object]:
    """A run with its result."""
    run = finished.run
    absent = dict.fromkeys(("tolerance", "estimate"))
    may_fail = run.experiment.expects_failure(run.method)
    return {**_run(run), "may_fail": may_fail, **absent, **_values(values_of(finished))}


def contents_as_json(stored: StoredFile) -> str:
    """The provenance of a result file, and every run in it."""
    runs = [
        {
            "experiment": one.experiment,
            **_values(one.values),
            **{name: getattr(one, name) for name in ("members", "swept", "variant")},
        }
        for one in stored.runs
    ]
    return document(provenance=stored.provenance, runs=runs)


def _run(run: Run) -> dict[str, object]:
    return {
        "experiment": run.experiment.name,
        "case": run.method.case,
        "n_steps": run.n_steps,
        "step_size": run.step_size,
        "member": None if run.member is None else dict(run.member.values),
    }


def _values(values: Mapping[str, Any]) -> dict[str, object]:
    """The values of a run by the names of the table, with extents of quantities and events."""
    found = {name: one for name, one in values.items() if name not in (EXTENTS, COUNTS)}
    return {
        **found,
        "quantities": {name: asdict(one) for name, one in extents_in(values).items()},
        "events": values.get(COUNTS, {}),
        "stopped_by": values.get("stopped_by") or None,
    }
