"""Sections: where a motion is whenever an event happens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.results.observed import Occurrences
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import Look, method_looks
from fvi_cli.plotting.motions.paths import position_label
from fvi_cli.plotting.motions.time_series import (
    MOST_COMPONENTS,
    observed_of,
    select_runs,
)
from fvi_cli.plotting.panels import MOST_LINES, plane
from fvi_cli.plotting.style import COLOURS, INK, MARKERS
from fvi_cli.plotting.words import (
    coordinates_of,
    member_label,
    swept_in_words,
    swept_number,
    typeset_name,
    with_unit,
)
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members

MANY = 200
"""Points from which on they are drawn as dots."""

Series = tuple[str, Occurrences]


def has_events(item: FinishedRun) -> bool:
    """Whether an event of a run happened."""
    return any(one.time.size for one in observed_of(item).events.values())


def section_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw velocity against position at every event, a panel for every coordinate (up to 4)."""
    shown = select_runs(finished, has_events)
    names = method_looks([item.run.method for item in shown])
    series = [
        (event if len(shown) == 1 else f"{event}, {names[item.run.method.case].label}", one)
        for item in shown
        for event, one in observed_of(item).events.items()
        if one.time.size
    ]
    return _marks(experiment, series, coordinates_of(experiment)[:MOST_COMPONENTS])


def sweep_section_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the first coordinate of members of a sweep at their events.

    Up to 6 members have marks of their own, velocity against position. Of more the position stands
    against what is swept (with several keys: the number of the member) above, and velocity against
    position below in the colours of a bar. Of several methods the first is shown, on the finest
    grid.
    """
    having = finest_of_members([item for item in finished if has_events(item)])
    found = [
        (item.run.member, event, one)
        for item in having
        for event, one in observed_of(item).events.items()
        if one.time.size and item.run.member is not None
    ]
    events = list(dict.fromkeys(event for _, event, _ in found))
    name = coordinates_of(experiment)[0]
    title = f"{len(experiment.members)} members: {swept_in_words(experiment)}"
    if len(having) <= MOST_LINES:
        labels = [member_label(member) for member, _, _ in found]
        series = [
            (label if len(events) == 1 else f"{event}, {label}", one)
            for label, (_, event, one) in zip(labels, found, strict=True)
        ]
        return _marks(experiment, series, [name], title)
    swept = swept_in_words(experiment) if len(experiment.swept) == 1 else "member"
    above, below = [], []
    for member, event, one in found:
        number = swept_number(member)
        value = float(member.number) if number is None else number
        marker = (".", *MARKERS)[events.index(event) % len(MARKERS)]
        look = Look(colour=INK, marker=marker, has_line=False, size=3.5)
        x, y = one.position[:, 0], one.velocity[:, 0]
        above.append(Curve(x=np.full(x.size, value), y=x, label=event, by=value, look=look))
        below.append(Curve(x=x, y=y, label=event, by=value, look=look))
    position, velocity = _words(experiment, name)
    return plane(
        [
            Panel(curves=above, x=swept, y=position, height=2.1),
            Panel(curves=below, x=position, y=velocity, height=2.1),
        ],
        bar=swept,
    )


def _marks(
    experiment: Experiment, series: Sequence[Series], names: Sequence[str], title: str = ""
) -> Figure:
    """Marks of every series, velocity against position, a panel for every coordinate."""
    panels = []
    for index, name in enumerate(names):
        curves = []
        for number, (label, one) in enumerate(series):
            dots = one.time.size > MANY
            look = Look(
                colour=COLOURS[number % len(COLOURS)],
                marker="." if dots else MARKERS[number % len(MARKERS)],
                size=1.5 if dots else 3.5,
                has_line=False,
                is_filled=dots,
            )
            x, y = one.position[:, index], one.velocity[:, index]
            curves.append(Curve(x=x, y=y, label=label, look=look))
        x_words, y_words = _words(experiment, name)
        height = 2.4 if len(names) == 1 else 1.7
        panels.append(Panel(curves=curves, x=x_words, y=y_words, height=height))
    return plane(panels, columns=min(2, len(panels)), title=title)


def _words(experiment: Experiment, name: str) -> tuple[str, str]:
    """Words for the position and the velocity of a coordinate."""
    velocity = rf"velocity $\dot {typeset_name(name).strip('$')}$"
    return position_label(experiment, name), with_unit(velocity, experiment.units, "velocity")
