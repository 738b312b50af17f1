"""The key ``accuracy``: a tolerance in place of a ladder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from fvi_cli.config.complaints import Complaints, KeyPath
from fvi_cli.config.document import MappingNode
from fvi_cli.config.method_keys import ListedMethod
from fvi_cli.config.records import Key, Record
from fvi_cli.config.shapes import Number
from fvi_cli.config.sweep import SWEEP
from fvi_cli.scenes.problem import DerivativeProblem, Problem
from fvi_cli.studies.accuracy_settings import Accuracy

ACCURACY: Final = Record(
    keys=(
        Key(
            name="tolerance",
            shape=Number(above=0.0),
            meaning="Largest error of the position, absolute, in report.norm.",
        ),
    )
)
EXAMPLE: Final = "accuracy: {tolerance: 1e-8}"

USUAL: Final = "{rk: gauss, degree: [4, 3, 2], start: [series, none]}"
"""The methods of which one is chosen where none is given."""


def check_accuracy(ladder: str, node: MappingNode, path: KeyPath, complaints: Complaints) -> None:
    """Either a ladder or a tolerance, and no tolerance for a sweep.

    Parameters
    ----------
    ladder
        What a ladder looks like.
    node, path
        The experiment.
    complaints
        Receives what is wrong.
    """
    entry = node.entries.get("accuracy")
    if entry is None:
        if "ladder" not in node.entries:
            message = f"missing; it must be {ladder}, or give {EXAMPLE} in its place"
            complaints.add(node.place, (*path, "ladder"), message)
        return
    for other, reason in (
        ("ladder", "not together with ladder: N is chosen for the tolerance"),
        (SWEEP, f"not together with {SWEEP}: every member would take another N; give a ladder"),
    ):
        if other in node.entries:
            complaints.add(entry.key_place, (*path, "accuracy"), reason)


def accuracy_of(
    values: Mapping[str, Any],
    problem: Problem | DerivativeProblem,
    methods: list[ListedMethod],
    node: MappingNode,
    path: KeyPath,
    complaints: Complaints,
) -> Accuracy | None:
    """The tolerance with the methods to choose from; None where there is a ladder."""
    given = values.get("accuracy")
    if not isinstance(given, Mapping) or not isinstance(given.get("tolerance"), float):
        return None
    if isinstance(problem, DerivativeProblem):
        place = node.entries["accuracy"].key_place
        complaints.add(place, (*path, "accuracy"), "a derivative is taken on a ladder only")
        return None
    if not methods:
        return None
    candidates = tuple(listed_method.method for listed_method in methods)
    return Accuracy(tolerance=given["tolerance"], candidates=candidates)
