"""``accuracy``: a tolerance in place of a ladder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from fvi_cli.config.keys.ladder import EXAMPLE as LADDER_EXAMPLE
from fvi_cli.config.keys.methods import ListedMethod
from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.keys.cursor import Cursor
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem, Problem
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

USUAL_STEPS: Final = 256
"""Steps at least where a displacement is given and no ladder."""


def usual_methods(accuracy: object) -> Mapping[str, list[Any]]:
    """What stands for the methods where none is given; empty where there is no `accuracy`."""
    if accuracy is None:
        return {}
    return (
        USUAL_ADAPTIVE if isinstance(accuracy, Accuracy) and accuracy.mesh != "uniform" else USUAL
    )


def prescribed_of(problem: AnyProblem | None) -> PrescribedMotion | None:
    """The motion of a problem, where it is given."""
    return problem.scene.prescribed if isinstance(problem, Problem) else None


def usual_steps(problem: AnyProblem | None) -> tuple[int, ...]:
    """Steps where no ladder is given: as many between all samples of a displacement."""
    motion = prescribed_of(problem)
    if motion is None:
        return ()
    parts = len(motion.break_points) + 1
    return (parts * -(-USUAL_STEPS // parts),)


def check_accuracy(at: Cursor, problem: AnyProblem | None) -> None:
    """An experiment has a ladder or a tolerance; where the motion is given it may have none."""
    has_accuracy, has_ladder = at.has("accuracy"), at.has("ladder")
    if not (has_accuracy or has_ladder or prescribed_of(problem) is not None):
        message = f"missing; it must be {LADDER_EXAMPLE}, or give {EXAMPLE} in its place"
        at.refuse_key("ladder", message)
    if has_accuracy and has_ladder:
        at.refuse_key("accuracy", "not together with ladder: N is chosen for the tolerance")
    under = at.under("accuracy")
    if has_accuracy and at.has("method") and under.under("mesh").scalar == "adaptive":
        message = "adaptive: method and degree follow from the tolerance; leave method out"
        under.refuse_key("mesh", message)


def accuracy_of(
    given: Accuracy, problem: AnyProblem, methods: Sequence[ListedMethod], at: Cursor
) -> Accuracy | None:
    """The tolerance with the methods to choose from; None where something is wrong."""
    if isinstance(given.tolerance, float) == isinstance(given.relative, float):
        return None
    if isinstance(problem, DerivativeProblem):
        at.refuse_key("accuracy", "a derivative is taken on a ladder only")
        return None
    if prescribed_of(problem) is not None:
        at.refuse_key("accuracy", "a displacement that is given has no error; give a ladder")
        return None
    usual: MeshChoice = "uniform" if at.has("method") else "adaptive"
    mesh = given.mesh or usual
    candidates = tuple(listed.method for listed in methods)
    if mesh == "adaptive":
        candidates = ADAPTIVE_CANDIDATES
    return given.replaced(mesh=mesh, candidates=candidates) if candidates else None
