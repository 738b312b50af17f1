"""Stored references: one for every scene, with which all methods are compared."""

from __future__ import annotations

from typing import Final

import numpy as np

from fvi_cli.storage.digests import (
    SOLVER_VERSION,
    canonical_json,
    problem_of,
    problem_template_of,
    sha256,
)
from fvi_cli.storage.records.record import REFERENCES, StoredRecord
from fvi_cli.storage.records.runs import record_for
from fvi_cli.studies.experiment import Run
from fvi_cli.studies.reference import Reference, Tabulated

_METHOD: Final = {"cq": "gauss", "degree": 8}
_AXES: Final = {"time": ("time",), "position": ("time", "dof")}


def reference_identity_of(run: Run) -> str:
    """SHA-256 of the problem and the ladder, which determine the reference of a run."""
    return sha256(canonical_json([REFERENCES, SOLVER_VERSION, problem_of(run), _ladder(run)]))


def reference_record_of(run: Run, reference: Reference) -> StoredRecord:
    """The record of the reference of a run; the reference must be tabulated."""
    if not isinstance(reference.values, Tabulated):
        raise TypeError(f"{run.title}: the reference is a function, which cannot be stored")
    ladder, finest = _ladder(run), max(run.experiment.steps)
    problem, inputs = problem_template_of(run)
    answers = {"problem": problem, "method": _METHOD, "n_steps": finest, **ladder}
    attributes = {
        "experiment": REFERENCES,
        "case": run.experiment.name,
        "n_steps": finest,
        "step_size": run.problem.final_time / finest,
        "norm": "max",
        "status": "ok" if reference.is_known else "failed",
        "predicted": "unknown",
        "error": reference.error,
        "reference": reference.source,
    }
    arrays = {
        "time": np.asarray(reference.values.time, dtype="<f8"),
        "position": np.asarray(reference.values.position, dtype="<f8"),
    }
    specification = canonical_json(answers), inputs
    return record_for(run, reference_identity_of(run), specification, attributes, arrays, _AXES)


def reference_of_record(record: StoredRecord) -> Reference:
    """The reference, read back."""
    return Reference(
        values=Tabulated(time=record.arrays["time"], position=record.arrays["position"]),
        error=float(record.attributes["error"]),
        source=str(record.attributes["reference"]),
    )


def _ladder(run: Run) -> dict[str, object]:
    return {"steps": sorted(run.experiment.steps), "grading": run.experiment.grading}
