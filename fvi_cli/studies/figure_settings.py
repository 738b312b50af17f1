"""Figures that say what they draw: something against a swept key, or a section of one event."""

from __future__ import annotations

import re
from typing import Annotated, Final

from fvi_cli.keys.containers import ListOf
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import NotNegative, Setting, key

EXTENTS: Final = ("peak", "rms", "least", "greatest")
"""What is known of a quantity over a whole run: ``plot: peak_drift``."""
LONGEST_NAME: Final = 100
"""Characters of what stands behind the name of the experiment in that of a file."""
_QUANTITIES: Final = ListOf(
    shape=Text(what="the name of a quantity"), most=12, example="[drift, base_shear]"
)
EXAMPLE: Final = "{plot: peak_drift, against: problem.damping.0.coefficient}"


class FigureSettings(
    Setting,
    forms=(("plot", "against", "of?", "after?"), ("section", "after?"), ("quantities",)),
    expected=f"a figure such as {EXAMPLE}, {{section: turn, after: 50}} or {{quantities: [drift]}}",
    refused={
        **dict.fromkeys(("y", "quantity"), "not a key: write plot"),
        **dict.fromkeys(("x", "over", "by", "versus", "vs"), "not a key: write against"),
        **dict.fromkeys(("skip", "transient", "from"), "not a key: write after, a time"),
        "kind": "not a key: write the word alone, such as figures: [trajectory]",
    },
):
    """A figure of what an experiment observes."""

    plot: Annotated[str | None, Text(what="peak_<quantity> or the name of an event")] = key(
        "What is drawn: peak_, rms_, least_ or greatest_ before the name of a quantity, or an "
        "event of which every occurrence is a dot (a bifurcation diagram).",
        default=None,
    )
    against: Annotated[str | None, Text(what="a swept key")] = key(
        "The swept key below it; a second one makes curves, a third one colours.", default=None
    )
    of_: Annotated[str | None, Text(what="a coordinate or its velocity")] = key(
        "Of an event: what is drawn of it, a coordinate (x) or its velocity (vx). Default: the "
        "first coordinate.",
        default=None,
    )
    section: Annotated[str | None, Text(what="the name of an event")] = key(
        "In place of plot: velocity against position at every occurrence of this event.",
        default=None,
    )
    quantities: Annotated[tuple[str, ...] | None, _QUANTITIES] = key(
        "In place of plot: these quantities over time, a panel for each.", default=None
    )
    after: NotNegative = key(
        "Of events: those before this time are left out.", unit="time", default=0.0
    )

    @classmethod
    def check_presence(cls, at: Cursor) -> None:
        """Either something against a key, or a section, or quantities."""
        which = next((one for one in ("section", "quantities") if at.has(one)), "")
        if which:
            for name in sorted({"plot", "against", "of", "section", "quantities"} - {which}):
                if at.has(name):
                    at.refuse_key(name, f"not together with {which}: write two figures")
            if which == "quantities" and at.has("after"):
                at.refuse_key("after", "for events only: leave it out")
        else:
            for name, example in (("plot", "peak_drift"), ("against", "problem.stiffness")):
                if not at.has(name):
                    at.refuse(f"missing; write {name}: {example}", name)

    @property
    def extent(self) -> tuple[str, str]:
        """Which extent of which quantity is drawn; two empty words: none of a quantity."""
        found = re.fullmatch(rf"({'|'.join(EXTENTS)})_(.+)", self.plot or "")
        return (found[1], found[2]) if found else ("", "")

    @property
    def file_name(self) -> str:
        """What stands behind the name of the experiment in those of files."""
        words = f"section-{self.section}"
        if self.quantities is not None:
            words = "-".join(("quantities", *self.quantities))
            if len(words) > LONGEST_NAME:
                words = f"quantities-{self.quantities[0]}-and-{len(self.quantities) - 1}-more"
        elif self.plot is not None:
            of = f"-{self.of_}" if self.of_ else ""
            words = f"{self.plot}{of}-against-{(self.against or '').removeprefix('problem.')}"
        return re.sub(r"[^A-Za-z0-9]+", "-", words).strip("-")
