"""``ladder``: numbers of steps as a list, or as powers of a base; ``accuracy``: a tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, Final

from fvi_cli.config.keys.methods import ListedMethod, objection_to_grading
from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.meshes.mesh import check_graded
from fvi_cli.integrator.method import Method
from fvi_cli.keys.containers import OneOrMany
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.keys.settings import Setting, key
from fvi_cli.mathematics.lagrange import LARGEST_DEGREE
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem, Problem
from fvi_cli.studies.accuracy_settings import Accuracy

MOST_STEPS: Final = 2**30
EXAMPLE: Final = "{steps: [16, 32, 64]} or {from: 4, to: 6, base: 2}"
_POWERS: Final = ("from", "to", "base")
_STEPS: Final = Integer(least=1, most=MOST_STEPS)
Exponent = Annotated[int | None, Integer(least=0, most=30)]


class Ladder(
    Setting,
    expected=EXAMPLE,
    forms=(("steps",), ("from", "to", "base?")),
    refused={
        **dict.fromkeys(("dt", "h", "step", "step_size"), "not a key: write steps: final_time / h"),
        **dict.fromkeys(("N", "n", "n_steps", "number"), "not a key: write steps"),
    },
):
    """Numbers of steps; powers of a base are read as the numbers."""

    steps: Annotated[tuple[int, ...], OneOrMany(shape=_STEPS, most=100)] = key(
        "Numbers N of steps, increasing; the step size is final_time / N.", default=None
    )
    from_: Exponent = key("In place of steps: the first exponent k of N = base**k.", default=None)
    to: Exponent = key("The last exponent.", default=None)
    grading: Annotated[float | None, Number(least=1.0)] = key(
        "r of the mesh a + (b - a) (k/N)**r on every stretch [a, b] between break points, at "
        "most 20; rk: gauss with start: none only. Default: 1, equal steps.",
        default=None,
    )
    base: Annotated[int | None, Integer(least=2, most=MOST_STEPS)] = key(
        "The base; default 2.", default=None
    )

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """``{"steps": [...]}``, with ``grading`` where it is given."""
        if "steps" in values:
            for name in _POWERS:
                if name in values:
                    at.refuse_key(name, "not together with steps")
            for index, (before, n_steps) in enumerate(pairwise(self.steps), 1):
                if not n_steps > before:
                    return at.refuse(
                        f"{n_steps} is not greater than {before} before it; "
                        "numbers of steps must increase",
                        "steps",
                        index,
                    )
            return {name: values[name] for name in ("steps", "grading") if name in values}
        if self.from_ is None or self.to is None:
            return at.refuse(
                f"{'from' if self.from_ is None else 'to'} is missing; it must be {EXAMPLE}"
            )
        first, last, base = self.from_, self.to, self.base or 2
        if last < first:
            return at.refuse(f"{last} is less than from = {first}", "to")
        if base**last > MOST_STEPS:
            return at.refuse(
                f"{base}**{last} steps are too many; at most {MOST_STEPS} are allowed", "to"
            )
        grading = {name: values[name] for name in values if name == "grading"}
        return {"steps": [base**exponent for exponent in range(first, last + 1)], **grading}


def check_grading(
    grading: float,
    steps: Sequence[int],
    methods: Sequence[ListedMethod],
    ends: Sequence[float],
    at: Cursor,
) -> None:
    """Complain of methods that need equal steps, and of impossible meshes.

    `ends` are break points and the final time, empty where they are not known; `at` is the cursor
    at the experiment.
    """
    if grading == 1.0:
        return
    for listed in methods:
        if reason := objection_to_grading(listed.method):
            at.under("ladder").refuse_key("grading", reason)
            return
    for index, n_steps in enumerate(steps) if ends else ():
        try:
            check_graded((0.0, *ends), n_steps, grading)
        except ArgumentError as error:
            if error.key == "grading":
                at.under("ladder", "grading").refuse(error.message)
            else:
                refuse_step(at, index, error.message)
            return


def refuse_step(at: Cursor, index: int, message: str) -> None:
    """Complain of a number of steps, or of the ladder if it is given by exponents."""
    at.under("ladder", "steps", index).refuse(message)


ACCURACY_EXAMPLE: Final = "accuracy: {tolerance: 1e-8}"
FEWEST_STAGES: Final = 2
MOST_STAGES: Final = LARGEST_DEGREE - 2  # the second run has two more
USUAL: Final[Mapping[str, list[Any]]] = {"rk": ["gauss"], "degree": [10], "start": ["none"]}
"""Placeholder for the method of a tolerance while a configuration is read."""

USUAL_STEPS: Final = 256
"""Least number of steps where a displacement is given and no ladder."""


def usual_methods(accuracy: object) -> Mapping[str, list[Any]]:
    """Default methods for a tolerance; empty where there is no `accuracy`."""
    return {} if accuracy is None else USUAL


def prescribed_of(problem: AnyProblem | None) -> PrescribedMotion | None:
    """The given motion of a problem, or None."""
    return problem.scene.prescribed if isinstance(problem, Problem) else None


def usual_steps(problem: AnyProblem | None) -> tuple[int, ...]:
    """Steps without a ladder: equally many between any two samples of a given displacement."""
    motion = prescribed_of(problem)
    if motion is None:
        return ()
    parts = len(motion.break_points) + 1
    return (parts * -(-USUAL_STEPS // parts),)


def check_accuracy(at: Cursor, problem: AnyProblem | None) -> None:
    """Complain unless there is a ladder or a tolerance; a given motion needs neither."""
    has_accuracy, has_ladder = at.has("accuracy"), at.has("ladder")
    if not (has_accuracy or has_ladder or prescribed_of(problem) is not None):
        message = f"missing; it must be {EXAMPLE}, or give {ACCURACY_EXAMPLE} in its place"
        at.refuse_key("ladder", message)
    if has_accuracy and has_ladder:
        at.refuse_key("accuracy", "not together with ladder: N is chosen for the tolerance")


def accuracy_of(
    given: Accuracy, problem: AnyProblem, methods: Sequence[ListedMethod], at: Cursor
) -> Accuracy | None:
    """The tolerance with its number of stages; None, maybe with complaints, if it is wrong."""
    if isinstance(given.tolerance, float) == isinstance(given.relative, float):
        return None
    if isinstance(problem, DerivativeProblem):
        at.refuse_key("accuracy", "a derivative is taken on a ladder only")
        return None
    if prescribed_of(problem) is not None:
        at.refuse_key("accuracy", "a displacement that is given has no error; give a ladder")
        return None
    if not at.has("method"):
        return given
    if not methods:
        return None
    first = methods[0].method
    stages = first.degree if isinstance(first, Method) and first.cq == "gauss" else 0
    if len(methods) > 1 or not FEWEST_STAGES <= stages <= MOST_STAGES:
        at.refuse_key(
            "method",
            f"with accuracy, one method such as gauss6, of {FEWEST_STAGES} to {MOST_STAGES} "
            "stages; without it they follow from the tolerance",
        )
        return None
    return given.replaced(stages=stages)
