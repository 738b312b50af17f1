"""Planes of two quantities of a motion: sections at events, and the loops of dampers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.trajectory import Occurrences
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.ladders.convergence import members_title
from fvi_cli.plotting.looks import Look, method_looks
from fvi_cli.plotting.motions.paths import position_label
from fvi_cli.plotting.motions.time_series import (
    MOST_COMPONENTS,
    has_quantities,
    most_accurate,
    observed_of,
    select_runs,
)
from fvi_cli.plotting.panels import MOST_LINES, plane
from fvi_cli.plotting.style import COLOURS, INK, LINE_STYLES, MARKERS
from fvi_cli.plotting.words import (
    coordinates_of,
    member_label,
    quantity_in_words,
    swept_keys_in_words,
    swept_number,
    typeset_name,
)
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.loops import deformation_against, forces_of, last_and_largest_loop

MANY = 200
"""From this number on points are drawn as dots."""

Series = tuple[str, Occurrences]


def has_events(item: FinishedRun) -> bool:
    """Whether an event of a run happened."""
    return any(one.time.size for one in observed_of(item).events.values())


def section_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw velocity against position at every event, a panel for every coordinate (up to 4).

    For a sweep the first coordinate is shown, by the first method on the finest grid. Up to 6
    members have marks of their own. For more members the upper panel shows the position against the
    swept number (with several keys: the number of the member), and the lower panel velocity against
    position in the same colours.
    """
    if experiment.members:
        shown = finest_of_members([item for item in finished if has_events(item)])
    else:
        shown = select_runs(finished, has_events)
    found = [
        (item, event, one)
        for item in shown
        for event, one in observed_of(item).events.items()
        if one.time.size
    ]
    names = coordinates_of(experiment)
    events = list(dict.fromkeys(event for _, event, _ in found))
    when = "; ".join(_condition(experiment, event) for event in events)
    if not experiment.members:
        methods = method_looks([item.run.method for item in shown])
        series = [
            (event if len(shown) == 1 else f"{event}, {methods[item.run.method.case].label}", one)
            for item, event, one in found
        ]
        return _marks(experiment, series, names[:MOST_COMPONENTS], when)
    if len(shown) <= MOST_LINES:
        labels = [member_label(item.run.member) for item, _, _ in found]
        series = [
            (label if len(events) == 1 else f"{event}, {label}", one)
            for label, (_, event, one) in zip(labels, found, strict=True)
        ]
        return _marks(experiment, series, names[:1], when, members_title(experiment))
    swept = swept_keys_in_words(experiment) if len(experiment.swept) == 1 else "member"
    above, below = [], []
    for item, event, one in found:
        number = swept_number(item.run.member)
        if number is None and item.run.member is not None:
            number = float(item.run.member.number)
        value = number or 0.0
        marker = (".", *MARKERS)[events.index(event) % len(MARKERS)]
        look = Look(colour=INK, marker=marker, has_line=False, size=3.5)
        x, y = one.position[:, 0], one.velocity[:, 0]
        above.append(Curve(x=np.full(x.size, value), y=x, label=event, by=value, look=look))
        below.append(Curve(x=x, y=y, label=event, by=value, look=look))
    position, velocity = _words(experiment, names[0])
    return plane(
        [
            Panel(curves=above, x=swept, y=position, remark=f"points where {when}", height=2.1),
            Panel(curves=below, x=position, y=velocity, height=2.1),
        ],
        bar=swept,
    )


def _marks(
    experiment: Experiment,
    series: Sequence[Series],
    names: Sequence[str],
    when: str,
    title: str = "",
) -> Figure:
    """Draw velocity against position as marks of every series, a panel for every coordinate."""
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
    words = "; ".join(filter(None, [f"points where {when}", title]))
    return plane(panels, columns=min(2, len(panels)), title=words)


def _condition(experiment: Experiment, event: str) -> str:
    """The condition of an event: ``sin(t) rises through 0``; for a surface its name."""
    seen = (experiment.observations.events or {}).get(event)
    if seen is None:
        return event
    how = {"rising": "rises through 0", "falling": "falls through 0"}
    return f"{seen.when.text} {how.get(seen.direction, 'passes 0')}"


def _words(experiment: Experiment, name: str) -> tuple[str, str]:
    """Labels for the position and the velocity of a coordinate."""
    velocity = rf"velocity $\dot {typeset_name(name).strip('$')}$"
    return position_label(experiment, name), with_unit(velocity, experiment.units, "velocity")


def hysteresis_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw force against deformation, a panel for every force (up to 4) among the quantities.

    It shows the most accurate run; for a sweep the members by the first method on the finest grid,
    where for many members a colour bar shows the swept number.
    """
    bar = title = ""
    if experiment.members:
        having = finest_of_members([item for item in finished if has_quantities(item)])
        title = members_title(experiment)
        if len(having) > MOST_LINES and None not in [swept_number(o.run.member) for o in having]:
            bar = swept_keys_in_words(experiment)
    else:
        having = [most_accurate(select_runs(finished, has_quantities))]
    panels = []
    for name in forces_of(experiment)[:MOST_COMPONENTS]:
        curves = []
        for item in having:
            x, y = deformation_against(item, name)
            finite = np.isfinite(x) & np.isfinite(y)
            label = member_label(item.run.member) if experiment.members else "whole motion"
            curve = Curve(x=x[finite], y=y[finite], label=label)
            if bar:
                curve = replace(curve, by=swept_number(item.run.member) or 0.0)
            elif not experiment.members:
                curve = replace(curve, look=Look(colour=COLOURS[0], width=0.9))
            curves.append(curve)
            if not experiment.members:
                curves += _marked_loops(item.trajectory.time, x, y)
        panels.append(
            Panel(
                curves=curves,
                x=with_unit("deformation", experiment.units, "length"),
                y=with_unit(quantity_in_words(experiment, name), experiment.units, name, "force"),
                height=2.4,
            )
        )
    return plane(panels, columns=min(2, len(panels)), bar=bar, title=title)


def _marked_loops(time: Array, x: Array, y: Array) -> list[Curve]:
    """The loops that the table of quantities reports, drawn above the whole motion."""
    marked = []
    for place, (word, loop) in enumerate(last_and_largest_loop(time, x, y).items(), start=1):
        inside = time[(time > loop.begin) & (time < loop.end)]
        whole = np.array([loop.begin, *inside, loop.end])
        look = Look(colour=COLOURS[place], width=1.4, dashes=LINE_STYLES[place - 1])
        places = [np.interp(whole, time, values) for values in (x, y)]
        marked.append(Curve(x=places[0], y=places[1], label=f"{word} full cycle", look=look))
    return marked
