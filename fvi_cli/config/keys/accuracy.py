"""``accuracy``: a tolerance in place of a ladder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, get_args

from fvi_cli.config.keys.ladder import EXAMPLE as LADDER_EXAMPLE
from fvi_cli.config.keys.methods import ListedMethod
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.nodes import MappingNode
from fvi_cli.keys.records import Record, optional
from fvi_cli.keys.scalars import Choice, Number
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem
from fvi_cli.studies.accuracy_settings import ADAPTIVE_CANDIDATES, Accuracy, MeshChoice

EXAMPLE: Final = "accuracy: {tolerance: 1e-8}"
USUAL: Final[Mapping[str, list[Any]]] = {
    "rk": ["gauss"],
    "degree": [4, 3, 2],
    "start": ["graded"],
}
"""The methods of which one is chosen where none is given, on uniform meshes."""

USUAL_ADAPTIVE: Final[Mapping[str, list[Any]]] = {
    "rk": ["gauss"],
    "degree": [10],
    "start": ["none"],
}
"""What stands for the methods of adaptive meshes while a configuration is read."""

ACCURACY: Final = Record(
    keys=(
        optional(
            "tolerance",
            Number(above=0.0),
            "Largest error of the position, absolute, in report.norm; this or relative.",
        ),
        optional(
            "relative",
            Number(above=0.0, below=1.0),
            "The same as a share of the largest position of the run.",
        ),
        optional(
            "mesh",
            Choice(words=get_args(MeshChoice)),
            "adaptive: steps are found on the way, with 4 to 10 stages; uniform: one of the "
            "methods and a number of equal steps are chosen. Default: adaptive where no method "
            "is given.",
        ),
    ),
    alternatives=("tolerance", "relative"),
)


def adaptive_methods(given: object) -> Mapping[str, list[Any]]:
    """What stands for the methods where steps are found on the way; empty on uniform meshes."""
    is_uniform = not isinstance(given, Mapping) or given.get("mesh") == "uniform"
    return {} if is_uniform else USUAL_ADAPTIVE


def check_accuracy(at: Cursor) -> None:
    """An experiment has either a ladder or a tolerance."""
    if not at.has("accuracy") and not at.has("ladder"):
        message = f"missing; it must be {LADDER_EXAMPLE}, or give {EXAMPLE} in its place"
        at.refuse_key("ladder", message)
    if at.has("accuracy") and at.has("ladder"):
        at.refuse_key("accuracy", "not together with ladder: N is chosen for the tolerance")
    if at.has("accuracy"):
        _check_keys(at.under("accuracy"), has_method=at.has("method"))


def _check_keys(at: Cursor, *, has_method: bool) -> None:
    if not isinstance(at.node, MappingNode):
        return
    if at.has("tolerance") and at.has("relative"):
        at.refuse_key("relative", "not together with tolerance: give one of them")
    if not at.has("tolerance") and not at.has("relative"):
        at.refuse("missing; give a tolerance, such as 1e-8, or relative", "tolerance")
    mesh = at.under("mesh").scalar if at.has("mesh") else None
    if mesh == "adaptive" and has_method:
        message = "adaptive: method and degree follow from the tolerance; leave method out"
        at.refuse_key("mesh", message)


def accuracy_of(
    given: object, problem: AnyProblem, methods: Sequence[ListedMethod], at: Cursor
) -> Accuracy | None:
    """The tolerance with the methods to choose from; None where there is a ladder."""
    if not isinstance(given, Mapping):
        return None
    tolerance, relative = given.get("tolerance"), given.get("relative")
    if (isinstance(tolerance, float)) == (isinstance(relative, float)):
        return None
    if isinstance(problem, DerivativeProblem):
        at.refuse_key("accuracy", "a derivative is taken on a ladder only")
        return None
    is_adaptive = given.get("mesh", "uniform" if at.has("method") else "adaptive") == "adaptive"
    candidates = tuple(listed.method for listed in methods)
    if is_adaptive:
        candidates = ADAPTIVE_CANDIDATES
    if not candidates:
        return None
    return Accuracy(
        tolerance=tolerance if isinstance(tolerance, float) else None,
        relative=relative if isinstance(relative, float) else None,
        mesh="adaptive" if is_adaptive else "uniform",
        candidates=candidates,
    )
