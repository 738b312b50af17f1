"""Sections: where a motion is whenever an event happens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fvi_cli.integrator.results.observed import Occurrences
from fvi_cli.plotting.motions.labels import (
    MOST_LINES,
    coordinates_of,
    finest_of_first,
    member_label,
    styled,
    typeset_name,
    with_unit,
)
from fvi_cli.plotting.motions.time_series import observed_of, select_runs
from fvi_cli.plotting.style import (
    COLOURS,
    MARKERS,
    journal_style,
    legend_above,
    legend_of,
    new_figure,
    panel_grid,
)
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.members import Member

MOST_PANELS = 4
ROUND_OFF = 1e-9
MANY = 200
"""Points from which on they are drawn as dots."""


def has_events(item: FinishedRun) -> bool:
    """Whether an event of a run happened."""
    return any(one.time.size for one in observed_of(item).events.values())


def section_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw velocity against position at every event, a panel for every coordinate (up to 4)."""
    shown = select_runs(finished, has_events)
    names = coordinates_of(experiment)[:MOST_PANELS]
    columns = 1 if len(names) == 1 else 2
    with journal_style():
        figure = new_figure(0.7 + (2.4 if columns == 1 else 1.7) * -(-len(names) // columns))
        _, panels = panel_grid(figure, len(names), columns)
        for index, (name, axes) in enumerate(zip(names, panels, strict=True)):
            series = [
                (event if len(shown) == 1 else f"{event}, {style.label}", one)
                for item, style, _ in styled(shown)
                for event, one in observed_of(item).events.items()
                if one.time.size
            ]
            for number, (label, one) in enumerate(series):
                _draw_points(axes, one, index, number, label)
            _widen(axes, [one for _, one in series])
            _name_axes(axes, experiment, name)
        legend_above(figure, panels[0])
    return figure


def sweep_section_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the first coordinate of members of a sweep at their events.

    Up to 6 members have marks of their own, velocity against position. Of more the position stands
    against what is swept (with several keys: the number of the member) above, and velocity against
    position below in shades from the first member to the last. Of several methods the first is
    shown, on the finest grid.
    """
    having = finest_of_first([item for item in finished if has_events(item)])
    series = [
        (item.run.member, event, one)
        for item in having
        for event, one in observed_of(item).events.items()
        if one.time.size and item.run.member is not None
    ]
    events = dict.fromkeys(event for _, event, _ in series)
    name = coordinates_of(experiment)[0]
    with journal_style():
        if len(having) <= MOST_LINES:
            figure = new_figure(3.3)
            axes = figure.subplots()
            for number, (member, event, one) in enumerate(series):
                label = member_label(member)
                _draw_points(
                    axes, one, 0, number, label if len(events) == 1 else f"{event}, {label}"
                )
            _name_axes(axes, experiment, name)
            legend_above(figure, axes)
            return figure
        figure = new_figure(4.6)
        above, below = figure.subplots(2, 1)
        values = [_swept_number(member) for member, _, _ in series]
        shades = colormaps["viridis"](np.linspace(0.0, 0.9, len(experiment.members)))
        markers = dict(zip(events, (".", *MARKERS[: len(events) - 1]), strict=False))
        for (member, event, one), value in zip(series, values, strict=True):
            marker = markers.get(event, ".")
            dots = {"color": shades[member.number], "marker": marker, "markersize": 2.5}
            x = one.position[:, 0]
            above.plot(np.full(x.size, value), x, linestyle="none", **dots)
            below.plot(x, one.velocity[:, 0], linestyle="none", **dots)
        keys = experiment.swept
        swept = keys[0].removeprefix("problem.").removeprefix("parameters.")
        above.set_xlabel(swept if len(keys) == 1 else "member")
        above.set_ylabel(with_unit(f"position {typeset_name(name)}", experiment, name, "length"))
        _name_axes(below, experiment, name)
        low, high = f"{min(values):.6g}", f"{max(values):.6g}"
        below.set_title(f"dark: {low}, light: {high}")
        if len(events) > 1:
            drawn = [
                Line2D([], [], label=event, marker=marker, linestyle="none", color="black")
                for event, marker in markers.items()
            ]
            legend_of(figure, drawn, above=True)
    return figure


def _swept_number(member: Member) -> float:
    """The value of a member where one number is swept, else its own number."""
    values = list(member.values.values())
    is_number = len(values) == 1 and isinstance(values[0], int | float)
    return float(values[0]) if is_number else float(member.number)


def _draw_points(axes: Axes, one: Occurrences, index: int, number: int, label: str) -> None:
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


def _name_axes(axes: Axes, experiment: Experiment, name: str) -> None:
    typeset = typeset_name(name)
    axes.set_xlabel(with_unit(f"position {typeset}", experiment, name, "length"))
    axes.set_ylabel(with_unit(rf"velocity $\dot {typeset.strip('$')}$", experiment, "velocity"))


def _widen(axes: Axes, events: Sequence[Occurrences]) -> None:
    """Keep round-off of what is constant on the section from filling the panel."""
    position = max(float(np.abs(one.position).max()) for one in events)
    velocity = max(float(np.abs(one.velocity).max()) for one in events)
    low, high = axes.get_xlim()
    if high - low < ROUND_OFF * position:
        axes.set_xlim(low - 0.5 * position, low + 0.5 * position)
    low, high = axes.get_ylim()
    if high - low < ROUND_OFF * velocity:
        axes.set_ylim(low - 0.5 * velocity, low + 0.5 * velocity)
