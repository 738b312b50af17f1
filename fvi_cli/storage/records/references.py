"""What is stored of a reference: once for every scene, whatever methods are compared with it."""

from __future__ import annotations

import json
from typing import Final

import numpy as np

from fvi_cli.storage.code import own_code
from fvi_cli.storage.digests import (
    SOLVER_VERSION,
    answered_by_own_code,
    canonical_json,
    problem_of,
    problem_template_of,
    sha256,
    stowed,
)
from fvi_cli.storage.provenance import origin
from fvi_cli.storage.records.record import REFERENCES, SWEPT, StoredRecord, swept_by
from fvi_cli.studies.experiment import Run
from fvi_cli.studies.reference import REFERENCE_METHOD, Reference, Tabulated

_METHOD: Final = {"cq": REFERENCE_METHOD.cq, "degree": REFERENCE_METHOD.degree}
_AXES: Final = {"time": ("time",), "position": ("time", "dof")}


def reference_request_of(run: Run) -> str:
    """SHA-256 of what determines the reference of a run: the scene and the times of the ladder."""
    return sha256(canonical_json([REFERENCES, problem_of(run), _ladder(run)]))


def reference_record_of(run: Run, reference: Reference) -> StoredRecord:
    """What is stored of the reference of a run, which is tabulated."""
    if not isinstance(reference.values, Tabulated):
        raise TypeError(f"{run.title}: the reference is a function, which cannot be stored")
    request, ladder = reference_request_of(run), _ladder(run)
    problem, known = problem_template_of(run)
    inputs = dict(known)
    attributes = {
        "experiment": REFERENCES,
        "case": run.experiment.name,
        "n_steps": max(run.experiment.steps),
        "step_size": run.problem.final_time / max(run.experiment.steps),
        "norm": "max",
        "status": "ok" if reference.is_known else "failed",
        "predicted": "unknown",
        "error": reference.error,
        "reference": reference.source,
        "specification": canonical_json(
            {
                "problem": problem,
                "method": _METHOD,
                "n_steps": max(run.experiment.steps),
                **ladder,
            }
        ),
        "solver_version": SOLVER_VERSION,
        "code": own_code().text,
        **origin(),
    }
    if run.member is not None:
        attributes[SWEPT] = json.dumps(swept_by(run))
        attributes |= {key: stowed(value, inputs) for key, value in run.member.values.items()}
    return StoredRecord(
        identity=answered_by_own_code(request),
        request=request,
        attributes=attributes,
        arrays={
            "time": np.asarray(reference.values.time, dtype="<f8"),
            "position": np.asarray(reference.values.position, dtype="<f8"),
        },
        axes=_AXES,
        inputs=inputs,
    )


def reference_of_record(record: StoredRecord) -> Reference:
    """The reference again."""
    return Reference(
        values=Tabulated(time=record.arrays["time"], position=record.arrays["position"]),
        error=float(record.attributes["error"]),
        source=str(record.attributes["reference"]),
    )


def _ladder(run: Run) -> dict[str, object]:
    return {"steps": sorted(run.experiment.steps), "grading": run.experiment.grading}
