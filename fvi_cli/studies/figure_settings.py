"""Figures with settings: a quantity against a swept key, a section, an ensemble."""

from __future__ import annotations

import re
from typing import Annotated, Final

from fvi_cli.keys.containers import ListOf
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import NotNegative, Setting, key

EXTENTS: Final = ("peak", "rms", "least", "greatest")
"""Numbers of a quantity over a whole run; ``plot: peak_drift`` is the peak of `drift`."""
LONGEST_NAME: Final = 100
"""Most characters that the name of a file has after the name of the experiment."""
_VALUES: Final = ListOf(
    shape=Text(what="the name of a coordinate or quantity"), most=12, example="[x, drift]"
)
EXAMPLE: Final = "{plot: peak_drift, against: problem.damping.0.coefficient}"


class FigureSettings(
    Setting,
    forms=(
        ("plot", "against", "after?"),
        ("section", "after?"),
        ("ensemble", "after?"),
    ),
    expected=f"a figure such as {EXAMPLE}, {{section: turn, after: 50}} or {{ensemble: [x]}}",
):
    """A figure of the outputs, quantities and events of an experiment."""

    plot: Annotated[str | None, Text(what="peak_<quantity> or the name of an event")] = key(
        "What is drawn: peak_, rms_, least_ or greatest_ before the name of a quantity, or an "
        "event of which every occurrence is a dot (a bifurcation diagram).",
        default=None,
    )
    against: Annotated[str | None, Text(what="a swept key")] = key(
        "The swept key below it; a second one makes curves, a third one colours.", default=None
    )
    section: Annotated[str | None, Text(what="the name of an event")] = key(
        "In place of plot: velocity against position at every occurrence of this event.",
        default=None,
    )
    ensemble: Annotated[tuple[str, ...] | None, _VALUES] = key(
        "In place of plot: mean over the members at every time, with bands of one standard "
        "deviation and of all members, a panel for each of these coordinates and quantities; of "
        "designs with a sweep a mean for every design.",
        default=None,
    )
    after: NotNegative = key(
        "Of events: those before this time are left out.", unit="time", default=0.0
    )

    @classmethod
    def check_presence(cls, at: Cursor) -> None:
        """Complain of incomplete settings (``plot`` without ``against``) and contradictory ones."""
        which = next((one for one in ("section", "ensemble") if at.has(one)), "")
        if which:
            for name in sorted({"plot", "against", "section", "ensemble"} - {which}):
                if at.has(name):
                    at.refuse_key(name, f"not together with {which}: write two figures")
            return
        for name, example in (("plot", "peak_drift"), ("against", "problem.stiffness")):
            if not at.has(name):
                at.refuse(f"missing; write {name}: {example}", name)

    @property
    def extent(self) -> tuple[str, str]:
        """Extent and quantity of `plot`, (``peak``, ``drift``); two empty words: it names none."""
        found = re.fullmatch(rf"({'|'.join(EXTENTS)})_(.+)", self.plot or "")
        return (found[1], found[2]) if found else ("", "")

    @property
    def file_name(self) -> str:
        """The part of file names that follows the name of the experiment."""
        words = f"section-{self.section}"
        if self.ensemble is not None:
            words = "-".join(("ensemble", *self.ensemble))
            if len(words) > LONGEST_NAME:
                words = f"ensemble-{self.ensemble[0]}-and-{len(self.ensemble) - 1}-more"
        elif self.plot is not None:
            words = f"{self.plot}-against-{(self.against or '').removeprefix('problem.')}"
        return re.sub(r"[^A-Za-z0-9]+", "-", words).strip("-")
