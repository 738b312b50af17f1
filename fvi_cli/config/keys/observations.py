"""``output``, ``events``, ``impacts``: requested outputs of a motion, and its impacts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.observe.request import Direction
from fvi_cli.keys.containers import ListOf, Named
from fvi_cli.keys.cursor import INVALID, Cursor, is_complete
from fvi_cli.keys.nodes import ListNode
from fvi_cli.keys.scalars import Number, Schema, Text
from fvi_cli.keys.settings import NotNegative, Positive, Setting, key, record_of

MOST_TIMES: Final = 10_000_000
EXAMPLE: Final = "{step: 0.01} or {times: [0, 0.5, 2]}"

_TEXT: Final = Text(what="an expression in coordinates, v<name>, a<name>, d<name>, t, parameters")


class Output(Setting, refused=dict.fromkeys(("dt", "every", "interval"), "not a key: write step")):
    """Times at which a run is stored."""

    step: Positive | None = key(
        "The times 0, step, twice step and so on.", unit="time", default=None
    )
    times: Annotated[
        tuple[float, ...] | None,
        ListOf(shape=Number(least=0.0), most=MOST_TIMES, example="[0, 0.5, 2]"),
    ] = key("The times themselves, increasing.", unit="time", default=None)

    def instants(self, final_time: float) -> NDArray[np.float64]:
        """The times of a run up to T."""
        if sum(one is not None for one in vars(self).values()) != 1:
            message = f"one of step and times is needed; it must be {EXAMPLE}"
            raise ArgumentError("", message)
        if self.step is not None:
            number = final_time / self.step * (1 + 1e-12) + 1
            if number >= MOST_TIMES + 1:
                message = f"{number:.7g} times are too many; at most {MOST_TIMES} are allowed"
                raise ArgumentError("step", message)
            if number < 2:
                message = f"{self.step:g} is longer than final_time = {final_time:g}"
                raise ArgumentError("step", message)
            return np.minimum(_exact_multiples(self.step, int(number)), final_time)
        earlier = -math.inf
        for index, time in enumerate(self.times or ()):
            where = f"times.{index}"
            if time > final_time:
                raise ArgumentError(where, f"{time:g} is after final_time = {final_time:g}")
            if not time > earlier:
                message = f"{time:g} is not after {earlier:g}; times must increase"
                raise ArgumentError(where, message)
            earlier = time
        return np.array(self.times, dtype=float)


def _exact_multiples(length: float, count: int) -> NDArray[np.float64]:
    """Multiples of a length, exact for the decimal number as written, each rounded once."""
    step = Fraction(repr(length))
    above, below = step.numerator, step.denominator
    # dividing integers rounds once, and is much faster than making fractions
    return np.array([k * above / below for k in range(count)])


class GivenEvent(
    Setting,
    refused={
        "terminal": "not a key: write stop",
        "function": "not a key: write when",
        **dict.fromkeys(
            ("every", "period", "strobe", "step"),
            "not a key: write {when: sin(2*pi*t/T), direction: rising}",
        ),
    },
):
    """An event."""

    when: Annotated[str, _TEXT] = key(
        "Expression as under quantities; the event is its change of sign."
    )
    direction: Direction = key("rising: from below to above 0; falling; or any.", default="any")
    stop: bool = key("End the run at the first of them.", default=False)


class GivenImpact(Setting, refused=dict.fromkeys(("e", "bounce"), "not a key: write restitution")):
    """A surface on which the motion bounces."""

    when: Annotated[str, Text(what="an expression in coordinates, t and parameters")] = key(
        "The motion stays where it is positive, and bounces at its falling roots."
    )
    restitution: NotNegative = key(
        "The velocity along the normal is reversed and multiplied by it, 0 to 1.", default=1.0
    )


@dataclass(frozen=True, kw_only=True)
class _Quantities(Named):
    """A mapping from names to expressions, or a list of names that are their own expressions."""

    @property
    def expected(self) -> str:
        """What is allowed."""
        return f"{super().expected}; or a list of names, such as [force_1, base_shear]"

    def read(self, at: Cursor) -> Any:
        """A dict."""
        if not isinstance(at.node, ListNode):
            return super().read(at)
        names = [_WORD.read(item) for item in at.items()]
        for index, name in enumerate(names):
            if name in names[:index]:
                at.refuse(f"{name} is given twice", index)
        return {name: name for name in names} if is_complete(names) else INVALID

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"anyOf": [super().schema(defs), ListOf(shape=_WORD).schema(defs)]}


_WORD: Final = Text(
    what="a name, such as force_1; for an expression write {name: expression}",
    pattern="[A-Za-z][A-Za-z0-9_]*",
)
Quantities = Annotated[
    Mapping[str, str] | None,
    _Quantities(shape=_TEXT, example="{drift: x2 - x1, force: -dx1, top: ax2}"),
]
Events = Annotated[
    Mapping[str, GivenEvent] | None,
    Named(shape=record_of(GivenEvent), example="{rest: {when: vx, direction: falling}}"),
]
Impacts = Annotated[
    Mapping[str, GivenImpact] | None,
    Named(shape=record_of(GivenImpact), example="{floor: {when: x1, restitution: 0.8}}"),
]
Units = Annotated[
    Mapping[str, str] | None,
    Named(
        shape=Text(what="the name of a unit", longest=40),
        example="{length: mm, time: s}",
    ),
]
