"""Planes of two quantities of a motion: sections at events, and the loops of dampers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.trajectory import Occurrences
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.kinds.members import MOST_NAMED, bar_of, members_title
from fvi_cli.plotting.kinds.motions import MOST_COMPONENTS, most_accurate, select_runs
from fvi_cli.plotting.kinds.paths import planes
from fvi_cli.plotting.kinds.quantities import has_quantities, observed_of, quantity_label
from fvi_cli.plotting.looks import Look, cycled, method_names
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import COLOURS, PALE
from fvi_cli.plotting.words import (
    coordinates_of,
    member_label,
    position_label,
    swept_keys_in_words,
    swept_number,
    velocity_label,
)
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.loops import deformation_against, forces_of, loops_of

Series = tuple[str, Occurrences]
_MANY = 200  # from this number on points are small


def has_events(item: FinishedRun) -> bool:
    """Whether an event of a run happened."""
    return any(one.time.size for one in observed_of(item).events.values())


def section_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw velocity against position at every event, a panel for every coordinate (up to 4).

    For a sweep the first coordinate is shown. Of more than 6 members the left panel shows the
    position against the swept number (with several keys: the number of the member), and the right
    one velocity against position in the same colours.
    """
    having = [item for item in finished if has_events(item)]
    shown = finest_of_members(having) if experiment.members else select_runs(having)
    found = [
        (item, event, one)
        for item in shown
        for event, one in observed_of(item).events.items()
        if one.time.size
    ]
    names = coordinates_of(experiment)
    if experiment.members and len(shown) > MOST_NAMED:
        return _many_sections(experiment, found, names[0])
    methods = method_names([item.run.method for item in shown])
    series = []
    for item, event, one in found:
        of_run = member_label(item.run.member) or methods[item.run.method.case]
        words = [event, of_run] if len(shown) > 1 else [event]
        series.append((", ".join(words), one))
    some = names[: 1 if experiment.members else MOST_COMPONENTS]
    return planes([_section(experiment, name, k, series) for k, name in enumerate(some)])


def _section(experiment: Experiment, name: str, index: int, series: Sequence[Series]) -> Panel:
    return Panel(
        curves=[
            Curve(
                x=one.position[:, index],
                y=one.velocity[:, index],
                label=label,
                look=_dots(cycled(number).colour, one.time.size),
            )
            for number, (label, one) in enumerate(series)
        ],
        x=position_label(experiment, name),
        y=velocity_label(experiment, name),
    )


def _dots(colour: str, count: int) -> Look:
    return Look(colour=colour, marker="o", has_line=False, size=1.9 if count > _MANY else 3.4)


def _many_sections(
    experiment: Experiment, found: Sequence[tuple[FinishedRun, str, Occurrences]], name: str
) -> Figure:
    """Sections of many members: against the swept number, and in the plane, in its colours."""
    swept = swept_keys_in_words(experiment) if len(experiment.swept) == 1 else "member"
    count = sum(one.time.size for _, _, one in found)
    against, section = [], []
    for item, _, one in found:
        number, member = swept_number(item.run.member), item.run.member
        by = float(member.number if number is None and member is not None else number or 0.0)
        x, v = one.position[:, 0], one.velocity[:, 0]
        look = _dots(PALE, count)
        against.append(Curve(x=np.full(x.size, by), y=x, by=by, look=look))
        section.append(Curve(x=x, y=v, by=by, look=look))
    position, velocity = position_label(experiment, name), velocity_label(experiment, name)
    panels = [
        Panel(curves=against, x=swept, y=position),
        Panel(curves=section, x=position, y=velocity),
    ]
    return figure([panels], lines, height=2.6, is_wide=True, bar=swept)


def hysteresis_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw force against deformation, a panel for every force (up to 4) among the quantities.

    It shows the most accurate run; for a sweep the members by the first method.
    """
    having = [item for item in finished if has_quantities(item)]
    runs = finest_of_members(having) if experiment.members else [most_accurate(select_runs(having))]
    panels = []
    for name in forces_of(experiment)[:MOST_COMPONENTS]:
        curves = []
        for item in runs:
            x, y = deformation_against(item, name)
            finite = np.isfinite(x) & np.isfinite(y)
            if experiment.members:
                by = swept_number(item.run.member)
                curve = Curve(x=x[finite], y=y[finite], label=member_label(item.run.member))
                curves.append(curve if by is None else replace(curve, by=by))
            else:
                whole = Look(colour="#9a9a9a", width=0.7)
                curves.append(Curve(x=x[finite], y=y[finite], label="whole motion", look=whole))
                curves += _loops(item.trajectory.time, x, y)
        panels.append(
            Panel(
                curves=curves,
                x=with_unit("deformation", experiment.units, "length"),
                y=quantity_label(experiment, name),
            )
        )
    if not experiment.members:
        return planes(panels)
    bar = bar_of(experiment, len(runs))
    if bar:
        panels = [replace(one, curves=[replace(c, label="") for c in one.curves]) for one in panels]
    return planes(panels, bar=bar, heading=members_title(experiment))


def _loops(time: Array, x: Array, y: Array) -> list[Curve]:
    """The loops that the table of quantities reports, above the whole motion."""
    curves = []
    for place, (word, loop) in enumerate(loops_of(time, x, y).items()):
        inside = time[(time > loop.begin) & (time < loop.end)]
        whole = np.array([loop.begin, *inside, loop.end])
        look = Look(colour=COLOURS[1 - place], width=1.6)
        places = [np.interp(whole, time, values) for values in (x, y)]
        curves.append(Curve(x=places[0], y=places[1], label=f"{word} loop", look=look))
    return curves
