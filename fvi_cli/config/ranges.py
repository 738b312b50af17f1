"""Numbers at equal distances, or in equal ratios: ``{from: 1, to: 100, number: 50}``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from fvi_cli.config.complaints import Complaints, KeyPath
from fvi_cli.config.document import MappingNode, Node
from fvi_cli.config.records import Key, Record
from fvi_cli.config.shapes import INVALID, Choice, Integer, Number, Schema, is_complete, needed

MOST_NUMBERS: Final = 100_000
LARGEST: Final = 1e300

RANGE_KEYS: Final = Record(
    keys=(
        Key(name="from", shape=Number(), meaning="The first number."),
        Key(name="to", shape=Number(), meaning="The last number."),
        Key(
            name="number",
            shape=Integer(least=2, most=MOST_NUMBERS),
            meaning="How many numbers, both ends counted.",
        ),
        Key(
            name="spacing",
            shape=Choice(words=("linear", "log")),
            meaning="Equal distances, or equal ratios between positive numbers.",
            default="linear",
        ),
    )
)


@dataclass(frozen=True, kw_only=True)
class Range:
    """A range, read as the list of its numbers."""

    expected: str = "{from: 1, to: 100, number: 50, spacing: linear|log}"

    def read(self, node: Node, path: KeyPath, complaints: Complaints) -> Any:
        """A list of floats, the first and last of which are exactly ``from`` and ``to``."""
        if not isinstance(node, MappingNode):
            complaints.add(node.place, path, needed(node, self.expected))
            return INVALID
        values = RANGE_KEYS.read(node, path, complaints)
        if not is_complete(values):
            return INVALID
        first, last = values["from"], values["to"]
        if first == last:
            complaints.add(
                node.entries["to"].node.place, (*path, "to"), f"{last:g} is the same as from"
            )
            return INVALID
        if values["spacing"] == "linear":
            if abs(first) + abs(last) > LARGEST:
                complaints.add(node.place, path, f"numbers up to {LARGEST:g} are allowed")
                return INVALID
            return [float(x) for x in np.linspace(first, last, values["number"])]
        for key, end in (("from", first), ("to", last)):
            if not end > 0:
                complaints.add(
                    node.entries[key].node.place,
                    (*path, key),
                    f"{end:g} is not allowed with spacing: log; it must be greater than 0",
                )
                return INVALID
        return [float(x) for x in np.geomspace(first, last, values["number"])]

    def schema(self) -> Schema:
        """The shape in JSON schema."""
        return RANGE_KEYS.schema()
