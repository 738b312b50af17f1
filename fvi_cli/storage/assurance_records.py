"""What is known of the error of a run for a tolerance, as attributes; and such runs found again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from fvi_cli.studies.accuracy_settings import Assurance
from fvi_cli.studies.experiment import Experiment, Run


def assurance_attributes(assurance: Assurance) -> dict[str, str | float]:
    """Attributes of a run."""
    return {
        "tolerance": assurance.tolerance,
        "estimate": assurance.estimate,
        "choice": assurance.choice,
        "attempts": json.dumps(list(assurance.attempts), ensure_ascii=False),
    }


def assurance_of(attributes: Mapping[str, Any]) -> Assurance | None:
    """The assurance again; None of a run that was not made for a tolerance.

    Raises
    ------
    KeyError, TypeError, ValueError
        If the attributes are not those that were written.
    """
    if "tolerance" not in attributes:
        return None
    return Assurance(
        tolerance=float(attributes["tolerance"]),
        estimate=float(attributes["estimate"]),
        choice=str(attributes["choice"]),
        attempts=tuple(json.loads(attributes["attempts"])),
    )


def asked_for_tolerance(experiment: Experiment, attributes: Mapping[str, Any]) -> Run | None:
    """The run of `experiment`, if a stored run with these attributes was chosen among the same.

    Whether it is the same experiment otherwise is told by its identity.
    """
    accuracy = experiment.accuracy
    if accuracy is None or "tolerance" not in attributes:
        return None
    case, n_steps = str(attributes["case"]), int(attributes["n_steps"])
    method = next((one for one in accuracy.candidates if one.case == case), None)
    if method is None or float(attributes["tolerance"]) != accuracy.tolerance:
        return None
    (run,) = experiment.with_choice(method, n_steps).runs()
    return run
