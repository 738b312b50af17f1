"""Figures with settings: a quantity against a swept key, a section, an ensemble."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Final

from pydantic import Field

from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import Keys, NotNegative, key

EXTENTS: Final = ("peak", "rms", "least", "greatest")
"""Numbers of a quantity over a whole run; ``plot: peak_drift`` is the peak of `drift`."""
LONGEST_NAME: Final = 100
"""Most characters that the name of a file has after the name of the experiment."""
EXAMPLE: Final = "{plot: peak_drift, against: problem.damping.0.coefficient}"


class FigureSettings(Keys):
    """A figure of the outputs, quantities and events of an experiment."""

    plot: str | None = key(
        "What is drawn: peak_, rms_, least_ or greatest_ before the name of a quantity, or an "
        "event of which every occurrence is a dot (a bifurcation diagram).",
        None,
    )
    against: str | None = key(
        "The swept key below it; a second one makes curves, a third one colours.", None
    )
    section: str | None = key(
        "In place of plot: velocity against position at every occurrence of this event.", None
    )
    ensemble: Annotated[list[str], Field(min_length=1, max_length=12)] | None = key(
        "In place of plot: mean over the members at every time, with bands of one standard "
        "deviation and of all members, a panel for each of these coordinates and quantities; of "
        "designs with a sweep a mean for every design.",
        None,
    )
    after: NotNegative = key("Of events: those before this time are left out.", 0.0, unit="time")

    def mistakes(self) -> Iterator[Wrong]:
        """Incomplete settings (``plot`` without ``against``) and contradictory ones."""
        given = [name for name, value in self if value is not None and name != "after"]
        kind = next((one for one in ("section", "ensemble") if one in given), "")
        for name in given if kind else ():
            if name != kind:
                yield Wrong((name,), f"not together with {kind}: write two figures", of_key=True)
        for name, example in (("plot", "peak_drift"), ("against", "problem.stiffness")):
            if not kind and name not in given:
                yield Wrong((name,), f"missing; write {name}: {example}")

    @property
    def extent(self) -> tuple[str, str]:
        """Extent and quantity in `plot`, (``peak``, ``drift``); two empty words if it has none."""
        match = re.fullmatch(rf"({'|'.join(EXTENTS)})_(.+)", self.plot or "")
        return (match[1], match[2]) if match else ("", "")

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
