"""Mean and spread over the members of a sweep."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.panels import over_time
from fvi_cli.plotting.style import COLOURS, LINE_STYLES
from fvi_cli.plotting.words import (
    coordinates_of,
    quantity_in_words,
    swept_keys_in_words,
    time_label,
    typeset_name,
)
from fvi_cli.reports.kinds.ensembles import Ensemble, ensembles
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.experiment import Experiment, FinishedRun


def ensemble_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], names: Sequence[str]
) -> Figure:
    """Draw means with bands of one standard deviation and of all members, a panel for each name.

    For designs with a sweep there is a mean for every design, and no band of all members.
    """
    found = ensembles(finished, names)
    panels = [
        Panel(
            curves=[_curve(one, place) for place, one in enumerate(own)],
            y=_words(experiment, name),
            height=2.0 if len(names) == 1 else 1.45,
        )
        for name in names
        for own in [[one for one in found if one.name == name]]
    ]
    count = sum(len(one.values) for one in found if one.name == names[0])
    every = len(experiment.members)
    members = f"{count} members" if count == every else f"{count} of {every} members"
    return over_time(
        panels,
        x=time_label(experiment),
        span=(0.0, experiment.problem.final_time),
        title=f"{members}: {swept_keys_in_words(experiment)}",
    )


def _curve(one: Ensemble, place: int) -> Curve:
    mean, deviation = one.mean, one.deviation
    bands = [("one standard deviation", mean - deviation, mean + deviation)]
    if not one.design:
        bands.append(("all members", one.values.min(axis=0), one.values.max(axis=0)))
    look = Look(colour=COLOURS[place % len(COLOURS)], dashes=LINE_STYLES[place % len(LINE_STYLES)])
    label = f"mean, {one.design}" if one.design else "mean"
    return Curve(x=one.time, y=mean, label=label, look=look, bands=bands)


def _words(experiment: Experiment, name: str) -> str:
    if name in coordinates_of(experiment):
        words = f"position ${typeset_name(name).strip('$')}(t)$"
        return with_unit(words, experiment.units, name, "length")
    return with_unit(quantity_in_words(experiment, name), experiment.units, name)
