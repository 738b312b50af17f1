"""Figures with settings: a quantity against a swept key, a section, quantities, an ensemble."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Final

from fvi_cli.keys.containers import ListOf
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import NotNegative, Setting, key

EXTENTS: Final = ("peak", "rms", "least", "greatest")
"""Numbers of a quantity over a whole run; ``plot: peak_drift`` is the peak of `drift`."""
LONGEST_NAME: Final = 100
"""Most characters that the name of a file has after the name of the experiment."""
_QUANTITIES: Final = ListOf(
    shape=Text(what="the name of a quantity"), most=12, example="[drift, base_shear]"
)
_VALUES: Final = ListOf(
    shape=Text(what="the name of a coordinate or quantity"), most=12, example="[x, drift]"
)
EXAMPLE: Final = "{plot: peak_drift, against: problem.damping.0.coefficient}"
_SECTION: Final = (
    "write {section: turn}, the name of an event such as events: {turn: {when: vx, direction: "
    "falling}}; once every period T: {when: sin(2*pi*t/T), direction: rising}"
)
_BIFURCATION: Final = (
    "write {plot: turn, against: problem.parameters.F, after: 50}, the name of an event and a "
    "swept key"
)
_ENSEMBLE: Final = "write {ensemble: [x]}, mean and spread over the members of a sweep"
MEANT: Final[Mapping[str, str]] = {
    **dict.fromkeys(
        ("poincare", "poincare-section", "poincare-map", "stroboscopic", "return-map"), _SECTION
    ),
    **dict.fromkeys(("bifurcation", "bifurcation-diagram", "feigenbaum"), _BIFURCATION),
    **dict.fromkeys(("ensemble", "mean", "average", "spread", "std"), _ENSEMBLE),
    **dict.fromkeys(
        ("time-series", "timeseries", "time", "motion", "solution"), "write trajectory"
    ),
    **dict.fromkeys(("phase-plane", "phase-portrait", "phase-space"), "write phase"),
    **dict.fromkeys(("loop", "loops", "hysteresis-loop"), "write hysteresis"),
}
"""What to write for words of other programs, which name no figure and no kind of problem here."""
_NO_KEYS: Final = ("poincare", "bifurcation", "mean")


class FigureSettings(
    Setting,
    forms=(
        ("plot", "against", "of?", "after?"),
        ("section", "after?"),
        ("quantities",),
        ("ensemble",),
    ),
    expected=f"a figure such as {EXAMPLE}, {{section: turn, after: 50}}, {{quantities: [drift]}} "
    "or {ensemble: [x]}",
    refused={
        **dict.fromkeys(("y", "quantity"), "not a key: write plot"),
        **dict.fromkeys(("x", "over", "by", "versus", "vs"), "not a key: write against"),
        **dict.fromkeys(("skip", "transient", "from"), "not a key: write after, a time"),
        **{word: f"not a key: {MEANT[word]}" for word in _NO_KEYS},
        "kind": "not a key: write the word alone, such as figures: [trajectory]",
    },
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
        single = ("section", "quantities", "ensemble")
        which = next((one for one in single if at.has(one)), "")
        if which:
            for name in sorted({"plot", "against", "of", *single} - {which}):
                if at.has(name):
                    at.refuse_key(name, f"not together with {which}: write two figures")
        elif not any(map(at.has, _NO_KEYS)):
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
        word, several = "quantities", self.quantities
        if self.ensemble is not None:
            word, several = "ensemble", self.ensemble
        if several is not None:
            words = "-".join((word, *several))
            if len(words) > LONGEST_NAME:
                words = f"{word}-{several[0]}-and-{len(several) - 1}-more"
        elif self.plot is not None:
            of = f"-{self.of_}" if self.of_ else ""
            words = f"{self.plot}{of}-against-{(self.against or '').removeprefix('problem.')}"
        return re.sub(r"[^A-Za-z0-9]+", "-", words).strip("-")
