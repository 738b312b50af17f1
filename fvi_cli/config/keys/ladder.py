"""``ladder``: numbers of steps as a list, or as powers of a base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from fvi_cli.config.keys.methods import ListedMethod, objection_to_grading
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.meshes.mesh import check_graded
from fvi_cli.keys.containers import Checked, OneOrMany
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.records import Record, optional
from fvi_cli.keys.scalars import Integer, Number, Schema

MOST_STEPS: Final = 2**30
EXAMPLE: Final = "{steps: [16, 32, 64]} or {from: 4, to: 6, base: 2}"
_POWERS: Final = ("from", "to", "base")

_KEYS: Final = Record(
    keys=(
        optional(
            "steps",
            OneOrMany(shape=Integer(least=1, most=MOST_STEPS), most=100),
            "Numbers N of steps, increasing; the step size is final_time / N.",
        ),
        optional(
            "from",
            Integer(least=0, most=30),
            "In place of steps: the first exponent k of N = base**k.",
        ),
        optional("to", Integer(least=0, most=30), "The last exponent."),
        optional(
            "grading",
            Number(least=1.0),
            "r of the mesh a + (b - a) (k/N)**r on every stretch [a, b] between break points, at "
            "most 20; rk: gauss with start: none only. Default: 1, equal steps.",
        ),
        optional("base", Integer(least=2, most=MOST_STEPS), "The base; default 2."),
    )
)


def _numbers(values: Mapping[str, Any], at: Cursor) -> Any:
    """``{"steps": [...]}``, with ``grading`` where it is given."""
    grading = {key: values[key] for key in values if key == "grading"}
    if "steps" in values:
        for key in _POWERS:
            if key in values:
                at.refuse_key(key, "not together with steps")
        steps = values["steps"]
        for index in range(1, len(steps)):
            if not steps[index] > steps[index - 1]:
                return at.refuse(
                    f"{steps[index]} is not greater than {steps[index - 1]} before it; "
                    "numbers of steps must increase",
                    "steps",
                    index,
                )
        return {"steps": steps, **grading}
    for key in ("from", "to"):
        if key not in values:
            return at.refuse(f"{key} is missing; it must be {EXAMPLE}")
    first, last, base = values["from"], values["to"], values.get("base", 2)
    if last < first:
        return at.refuse(f"{last} is less than from = {first}", "to")
    if base**last > MOST_STEPS:
        return at.refuse(
            f"{base}**{last} steps are too many; at most {MOST_STEPS} are allowed", "to"
        )
    return {"steps": [base**exponent for exponent in range(first, last + 1)], **grading}


def _schema() -> Schema:
    """The two forms apart."""
    properties = _KEYS.schema()["properties"]
    forms = (("steps",), ("steps",)), (_POWERS, ("from", "to"))
    return {
        "oneOf": [
            {
                "type": "object",
                "additionalProperties": False,
                "properties": {key: properties[key] for key in (*allowed, "grading")},
                "required": list(required),
            }
            for allowed, required in forms
        ]
    }


LADDER: Final = Checked(shape=_KEYS, check=_numbers, words=EXAMPLE, described=_schema())
"""Numbers of steps, read as ``{"steps": [...]}``."""


def steps_of(ladder: object) -> tuple[int, ...]:
    """The numbers of steps of what was read; none where something is wrong."""
    return tuple(ladder["steps"]) if isinstance(ladder, Mapping) else ()


def grading_of(ladder: object) -> float:
    """The grading of the mesh; 1 where none is given."""
    given = ladder.get("grading", 1.0) if isinstance(ladder, Mapping) else 1.0
    return given if isinstance(given, float) else 1.0


def check_grading(
    grading: float,
    steps: Sequence[int],
    methods: Sequence[ListedMethod],
    ends: Sequence[float],
    at: Cursor,
) -> None:
    """Complain of methods that need equal steps, and of meshes that cannot be.

    Parameters
    ----------
    grading, steps
        r and the numbers of steps.
    methods
        Those of the experiment.
    ends
        Break points and the final time; empty where they are not known.
    at
        The experiment.
    """
    if grading == 1.0:
        return
    for listed in methods:
        if said := objection_to_grading(listed.method):
            at.under("ladder").refuse_key("grading", said)
            return
    for index, n_steps in enumerate(steps) if ends else ():
        try:
            check_graded((0.0, *ends), n_steps, grading)
        except ArgumentError as error:
            refuse_step(at, index, error.message)
            return


def refuse_step(at: Cursor, index: int, message: str) -> None:
    """Point at a number of steps, or at the ladder when it is given by exponents."""
    at.under("ladder", "steps", index).refuse(message)
