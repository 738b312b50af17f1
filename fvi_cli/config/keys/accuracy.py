"""``accuracy``: a tolerance in place of a ladder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from fvi_cli.config.keys.ladder import EXAMPLE as LADDER_EXAMPLE
from fvi_cli.config.keys.methods import ListedMethod
from fvi_cli.config.keys.sweep import SWEEP
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.records import Key, Record
from fvi_cli.keys.scalars import Number
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem
from fvi_cli.studies.accuracy_settings import Accuracy

EXAMPLE: Final = "accuracy: {tolerance: 1e-8}"
USUAL: Final[Mapping[str, list[Any]]] = {
    "rk": ["gauss"],
    "degree": [4, 3, 2],
    "start": ["series", "none"],
}
"""The methods of which one is chosen where none is given."""

ACCURACY: Final = Record(
    keys=(
        Key(
            "tolerance",
            Number(above=0.0),
            "Largest error of the position, absolute, in report.norm.",
        ),
    )
)
_NOT_TOGETHER: Final = {
    "ladder": "not together with ladder: N is chosen for the tolerance",
    SWEEP: f"not together with {SWEEP}: every member would take another N; give a ladder",
}


def check_accuracy(at: Cursor) -> None:
    """An experiment has either a ladder or a tolerance, and no tolerance with a sweep."""
    if not at.has("accuracy") and not at.has("ladder"):
        message = f"missing; it must be {LADDER_EXAMPLE}, or give {EXAMPLE} in its place"
        at.refuse_key("ladder", message)
    for other, reason in _NOT_TOGETHER.items():
        if at.has("accuracy") and at.has(other):
            at.refuse_key("accuracy", reason)


def accuracy_of(
    given: object, problem: AnyProblem, methods: Sequence[ListedMethod], at: Cursor
) -> Accuracy | None:
    """The tolerance with the methods to choose from; None where there is a ladder."""
    if not isinstance(given, Mapping) or not isinstance(given.get("tolerance"), float):
        return None
    if isinstance(problem, DerivativeProblem):
        at.refuse_key("accuracy", "a derivative is taken on a ladder only")
        return None
    candidates = tuple(listed.method for listed in methods)
    return Accuracy(tolerance=given["tolerance"], candidates=candidates) if candidates else None
