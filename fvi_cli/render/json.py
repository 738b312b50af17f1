"""Results as JSON documents with stable keys; null in place of nan and infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from fvi_cli.runner.plan import PlannedRun
from fvi_cli.runner.request import Request
from fvi_cli.storage import StoredFile
from fvi_cli.storage.fields import (
    COUNTS,
    EXTENTS,
    JSON_FIELDS,
    counts_in,
    extents_in,
    values_of,
)
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.fits.result import FitResult

JSON_FORMAT = 1
"""Increased when a key is renamed or removed; new keys do not increase it."""


def document(content: Mapping[str, object]) -> str:
    """The JSON document of a command."""
    return json.dumps(_plain({"format": JSON_FORMAT, **content}), indent=1, allow_nan=False)


def plans_as_json(plans: Sequence[PlannedRun]) -> str:
    """For every run the action, its reason, and the memory that it takes."""
    return document({"runs": [_plan(one) for one in plans]})


def contents_as_json(stored: StoredFile) -> str:
    """The provenance of a result file, and every run in it."""
    runs = [
        {
            "experiment": one.experiment,
            **_values(one.values),
            "members": one.members,
            "swept": one.swept,
            "variant": one.variant,
        }
        for one in stored.runs
    ]
    return document({"provenance": dict(stored.provenance), "runs": runs})


def checked_as_json(requests: Iterable[Request], complaints: Sequence[str] = ()) -> str:
    """Valid configurations with their experiments, or the mistakes."""
    configurations = [
        {
            "file": str(request.loaded.path),
            "name": request.name,
            "experiments": [
                {"name": one.name, "runs": len(one.runs())} for one in request.loaded.experiments
            ],
        }
        for request in requests
    ]
    return document(
        {
            "valid": not complaints,
            "configurations": configurations,
            "complaints": list(complaints),
        }
    )


def fit_as_json(result: FitResult) -> list[object]:
    """Every model of a fit with its estimates."""
    return [
        {
            "experiment": result.name,
            "model": model.model.name,
            "status": "ok" if model.is_converged else "failed",
            "message": model.message,
            "values": model.n_values,
            "aicc": model.criterion,
            "whiteness": model.whiteness,
            "parameters": [
                {
                    "parameter": one.name,
                    "estimate": one.value,
                    "standard_error": one.standard_error,
                    "low": one.low,
                    "high": one.high,
                    "low_is": _end_in_words(one.low),
                    "high_is": _end_in_words(one.high),
                    "at_bound": one.at_bound,
                }
                for one in model.estimates
            ],
            "correlations": [list(map(float, row)) for row in model.correlations],
            "warnings": list(model.warnings),
        }
        for model in result.models
    ]


def _end_in_words(end: float) -> str:
    """The meaning of an end of an interval that may be null."""
    if math.isfinite(end):
        return "found"
    return "not found" if math.isnan(end) else "no limit"


def shipped_as_json(titles: Mapping[str, str]) -> str:
    """The shipped configurations with their titles."""
    listed = [{"name": name, "title": title} for name, title in titles.items()]
    return document({"configurations": listed})


def _plain(value: Any) -> Any:
    """The value with null for nan and infinity, which JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _run(run: Run) -> dict[str, object]:
    return {
        "experiment": run.experiment.name,
        "case": run.method.case,
        "n_steps": run.n_steps,
        "step_size": run.step_size,
        "member": None if run.member is None else dict(run.member.values),
    }


def run_as_json(finished: FinishedRun) -> dict[str, object]:
    """A run with its result."""
    run, values = finished.run, values_of(finished)
    return {
        **_run(run),
        "may_fail": run.experiment.expects_failure(run.method),
        "tolerance": None,
        "estimate": None,
        **_values(values),
    }


def _values(values: Mapping[str, Any]) -> dict[str, object]:
    """The values of a run by the names of the table, with extents of quantities and events."""
    return {
        **{name: json.loads(one) if name in JSON_FIELDS else one for name, one in values.items()
           if name not in (EXTENTS, COUNTS)},
        "quantities": {name: asdict(one) for name, one in extents_in(values).items()},
        "events": counts_in(values),
        "stopped_by": values.get("stopped_by") or None,
    }  # fmt: skip


def _plan(plan: PlannedRun) -> dict[str, object]:
    unknown = {"case": None, "n_steps": None, "step_size": None} if plan.finds_steps else {}
    return {
        **_run(plan.run),
        **unknown,
        "action": plan.action,
        "memory_bytes": plan.memory_bytes,
    }
