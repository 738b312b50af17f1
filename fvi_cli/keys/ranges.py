"""Numbers at equal distances, or in equal ratios: ``{from: 1, to: 100, number: 50}``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from fvi_cli.keys.containers import Checked
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.records import Key, Record
from fvi_cli.keys.scalars import Choice, Integer, Number

MOST_NUMBERS: Final = 100_000
LARGEST: Final = 1e300


def _numbers(values: Mapping[str, Any], at: Cursor) -> Any:
    """A list of floats, the first and last of which are exactly ``from`` and ``to``."""
    first, last, number = values["from"], values["to"], values["number"]
    if first == last:
        return at.refuse(f"{last:g} is the same as from", "to")
    if values["spacing"] == "linear":
        if abs(first) + abs(last) > LARGEST:
            return at.refuse(f"numbers up to {LARGEST:g} are allowed")
        return np.linspace(first, last, number).tolist()
    for key, end in (("from", first), ("to", last)):
        if not end > 0:
            return at.refuse(
                f"{end:g} is not allowed with spacing: log; it must be greater than 0", key
            )
    return np.geomspace(first, last, number).tolist()


RANGE: Final = Checked(
    shape=Record(
        keys=(
            Key("from", Number(), "The first number."),
            Key("to", Number(), "The last number."),
            Key(
                "number",
                Integer(least=2, most=MOST_NUMBERS),
                "How many numbers, both ends counted.",
            ),
            Key(
                "spacing",
                Choice(words=("linear", "log")),
                "Equal distances, or equal ratios between positive numbers.",
                default="linear",
            ),
        )
    ),
    check=_numbers,
    words="{from: 1, to: 100, number: 50, spacing: linear|log}",
)
"""A range, read as the list of its numbers."""
