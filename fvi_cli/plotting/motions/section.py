"""Sections: where a motion is whenever an event happens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fvi_cli.integrator.results.observed import Occurrences
from fvi_cli.plotting.looks import method_looks
from fvi_cli.plotting.motions.time_series import (
    MOST_COMPONENTS,
    finest_of_first,
    observed_of,
    select_runs,
)
from fvi_cli.plotting.panels import MOST_LINES
from fvi_cli.plotting.style import (
    COLOURS,
    MARKERS,
    colour_bar,
    colour_of,
    journal_style,
    legend_of,
    new_figure,
    panel_grid,
)
from fvi_cli.plotting.words import (
    coordinates_of,
    member_label,
    swept_in_words,
    swept_number,
    typeset_name,
    with_unit,
)
from fvi_cli.studies.experiment import Experiment, FinishedRun

ROUND_OFF = 1e-9
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
    having = finest_of_first([item for item in finished if has_events(item)])
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
    values = []
    for member, _, _ in found:
        number = swept_number(member)
        values.append(float(member.number) if number is None else number)
    with journal_style():
        figure = new_figure(5.2)
        above, below = figure.subplots(2, 1)
        colours = ScalarMappable(Normalize(min(values), max(values)))
        markers = dict(zip(events, (".", *MARKERS), strict=False))
        for (_, event, one), value in zip(found, values, strict=True):
            dots = {
                "color": colour_of(colours, value),
                "marker": markers.get(event, "."),
                "ms": 2.5,
            }
            x = one.position[:, 0]
            above.plot(np.full(x.size, value), x, linestyle="none", **dots)
            below.plot(x, one.velocity[:, 0], linestyle="none", **dots)
        above.set_xlabel(swept)
        above.set_ylabel(_position(experiment, name))
        _name_axes(below, experiment, name)
        if len(events) > 1:
            legend_of(
                figure,
                [
                    Line2D(
                        [], [], label=event, marker=markers.get(event, "."), ls="none", color="k"
                    )
                    for event in events
                ],
            )
        colour_bar(figure, [above, below], colours, swept, "bottom")
    return figure


def _marks(
    experiment: Experiment, series: Sequence[Series], names: Sequence[str], title: str = ""
) -> Figure:
    """Marks of every series, velocity against position, a panel for every coordinate."""
    columns = 1 if len(names) == 1 else 2
    with journal_style():
        figure = new_figure(0.5 + (2.4 if columns == 1 else 1.7) * -(-len(names) // columns))
        _, panels = panel_grid(figure, len(names), columns)
        for index, (name, axes) in enumerate(zip(names, panels, strict=True)):
            for number, (label, one) in enumerate(series):
                dots = one.time.size > MANY
                axes.plot(
                    one.position[:, index],
                    one.velocity[:, index],
                    linestyle="none",
                    marker="." if dots else MARKERS[number % len(MARKERS)],
                    markersize=1.5 if dots else 3.5,
                    markerfacecolor="none" if not dots else None,
                    color=COLOURS[number % len(COLOURS)],
                    label=label,
                )
            _widen(axes, [one for _, one in series])
            _name_axes(axes, experiment, name)
        legend_of(figure, panels[0].get_legend_handles_labels()[0], title=title)
    return figure


def _position(experiment: Experiment, name: str) -> str:
    return with_unit(f"position {typeset_name(name)}", experiment.units, name, "length")


def _name_axes(axes: Axes, experiment: Experiment, name: str) -> None:
    axes.set_xlabel(_position(experiment, name))
    velocity = rf"velocity $\dot {typeset_name(name).strip('$')}$"
    axes.set_ylabel(with_unit(velocity, experiment.units, "velocity"))


def _widen(axes: Axes, events: Sequence[Occurrences]) -> None:
    """Keep round-off of what is constant on the section from filling the panel."""
    for axis, kind in (("x", "position"), ("y", "velocity")):
        largest = max(float(np.abs(getattr(one, kind)).max()) for one in events)
        low, high = getattr(axes, f"get_{axis}lim")()
        if high - low < ROUND_OFF * largest:
            getattr(axes, f"set_{axis}lim")(low - 0.5 * largest, low + 0.5 * largest)
