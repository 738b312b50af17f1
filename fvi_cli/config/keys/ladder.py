"""``ladder``: numbers of steps as a list, or as powers of a base."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from fvi_cli.keys.containers import Checked, OneOrMany
from fvi_cli.keys.cursor import OPTIONAL, Cursor
from fvi_cli.keys.records import Key, Record
from fvi_cli.keys.scalars import Integer, Schema

MOST_STEPS: Final = 2**30
EXAMPLE: Final = "{steps: [16, 32, 64]} or {from: 4, to: 6, base: 2}"
_POWERS: Final = ("from", "to", "base")

_KEYS: Final = Record(
    keys=(
        Key(
            "steps",
            OneOrMany(shape=Integer(least=1, most=MOST_STEPS), most=100),
            "Numbers N of steps, increasing; the step size is final_time / N.",
            default=OPTIONAL,
        ),
        Key(
            "from",
            Integer(least=0, most=30),
            "In place of steps: the first exponent k of N = base**k.",
            default=OPTIONAL,
        ),
        Key("to", Integer(least=0, most=30), "The last exponent.", default=OPTIONAL),
        Key("base", Integer(least=2, most=MOST_STEPS), "The base; default 2.", default=OPTIONAL),
    )
)


def _numbers(values: Mapping[str, Any], at: Cursor) -> Any:
    """``{"steps": [...]}``."""
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
        return {"steps": steps}
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
    return {"steps": [base**exponent for exponent in range(first, last + 1)]}


def _schema() -> Schema:
    """The two forms apart."""
    properties = _KEYS.schema()["properties"]
    forms = (("steps",), ("steps",)), (_POWERS, ("from", "to"))
    return {
        "oneOf": [
            {
                "type": "object",
                "additionalProperties": False,
                "properties": {key: properties[key] for key in allowed},
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


def refuse_step(at: Cursor, index: int, message: str) -> None:
    """Point at a number of steps, or at the ladder when it is given by exponents."""
    at.under("ladder", "steps", index).refuse(message)
