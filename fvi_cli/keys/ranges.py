"""Numbers at equal distances or ratios: ``{from: 1, to: 100, number: 50}``."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import numpy as np

from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Integer
from fvi_cli.keys.settings import Setting, key, record_of

MOST_NUMBERS: Final = 100_000
LARGEST: Final = 1e300


class Range(Setting, expected="{from: 1, to: 100, number: 50, spacing: linear|log}"):
    """A range, read as the list of its numbers."""

    from_: float = key("The first number.")
    to: float = key("The last number.")
    number: Annotated[int, Integer(least=2, most=MOST_NUMBERS)] = key(
        "Number of values, both ends included."
    )
    spacing: Literal["linear", "log"] = key(
        "Equal distances, or equal ratios between positive numbers.", default="linear"
    )

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """A list of floats; the first and the last are exactly ``from`` and ``to``."""
        first, last = self.from_, self.to
        if first == last:
            return at.refuse(f"{last:g} is the same as from", "to")
        if self.spacing == "linear":
            if abs(first) + abs(last) > LARGEST:
                return at.refuse(f"numbers up to {LARGEST:g} are allowed")
            return np.linspace(first, last, self.number).tolist()
        for name, end in (("from", first), ("to", last)):
            if not end > 0:
                return at.refuse(
                    f"{end:g} is not allowed with spacing: log; it must be greater than 0", name
                )
        return np.geomspace(first, last, self.number).tolist()


RANGE: Final = record_of(Range)
