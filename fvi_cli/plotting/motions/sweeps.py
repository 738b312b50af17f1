"""Members of a sweep: a line for each of a few, the median and bands for many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.ladders.convergence import NORM_LABELS
from fvi_cli.plotting.methods import series_styles
from fvi_cli.plotting.motions.labels import (
    MOST_LINES,
    coordinates_of,
    finest_of_first,
    member_label,
    time_axis,
    typeset_name,
    with_unit,
)
from fvi_cli.plotting.motions.time_series import (
    MOST_PANELS,
    mark_peak,
    name_quantity,
    observed_of,
    panel_height,
)
from fvi_cli.plotting.style import (
    COLOURS,
    LINE_STYLES,
    MARKERS,
    journal_style,
    legend_of,
    logarithmic_ticks,
    lowest,
    new_figure,
    panel_grid,
)
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.members import Member

_BANDS = ((0.0, 100.0, "all members", 0.15), (5.0, 95.0, "9 of 10 members", 0.3))


def sweep_convergence_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the errors of members against the step size, one panel for each method.

    Up to :data:`MOST_LINES` members have a line each. Of more the median is drawn, and bands that
    hold 9 of 10 members and all of them; runs without an error are left out of both.
    """
    having = [one for one in finished if np.isfinite(one.error) and one.error > 0]
    methods = list(dict.fromkeys(one.run.method for one in having))
    with journal_style():
        figure, panels = _panels(methods)
        for axes, method in zip(panels, methods, strict=True):
            own = [one for one in having if one.run.method == method]
            steps = sorted({one.run.step_size for one in own})
            lines: dict[Member | None, Array] = {}
            for one in own:
                line = lines.setdefault(one.run.member, np.full(len(steps), np.nan))
                line[steps.index(one.run.step_size)] = one.error
            axes.set_xscale("log")
            axes.set_yscale("log")
            _draw(axes, np.array(steps), lines, with_markers=True)
            logarithmic_ticks(axes, steps)
            axes.set_xlabel("step size $h$")
        panels[0].set_ylabel("error " + NORM_LABELS[experiment.norm])
        _finish(figure, panels[0], experiment)
    return figure


def sweep_trajectory_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the first coordinate of the members over time, on the finest grid.

    One panel for each method; lines and bands as in :func:`sweep_convergence_figure`.
    """
    moving = _finest(finished)
    methods = list(dict.fromkeys(one.run.method for one in moving))
    with journal_style():
        figure, panels = _panels(methods)
        for axes, method in zip(panels, methods, strict=True):
            own = [one for one in moving if one.run.method == method]
            _draw_over_time(axes, own, [one.trajectory.position[:, 0] for one in own])
            time_axis(axes, experiment, ())
        name = coordinates_of(experiment)[0]
        label = f"position {typeset_name(name)[:-1]}(t)$"
        panels[0].set_ylabel(with_unit(label, experiment, name, "length"))
        _finish(figure, panels[0], experiment)
    return figure


def sweep_quantities_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw every quantity of the members over time, a panel for each (up to 6), on the finest grid.

    Of several methods the first is shown; lines and bands as in :func:`sweep_convergence_figure`,
    with the peak of every line that a member has for itself.
    """
    own = finest_of_first(_finest([one for one in finished if observed_of(one).quantities]))
    names = list(observed_of(own[0]).quantities)[:MOST_PANELS]
    with journal_style():
        figure = new_figure(0.9 + panel_height(len(names)) * len(names))
        panels = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
        for name, axes in zip(names, panels, strict=True):
            _draw_over_time(axes, own, [observed_of(one).quantities[name] for one in own])
            if len(own) <= MOST_LINES:
                for index, one in enumerate(own):
                    mark_peak(axes, observed_of(one).extents[name], COLOURS[index])
            name_quantity(axes, experiment, name)
        figure.align_ylabels(panels)
        time_axis(panels[-1], experiment, own)
        _finish(figure, panels[0], experiment)
    return figure


def _finest(finished: Sequence[FinishedRun]) -> list[FinishedRun]:
    """Runs that got beyond their start, on the finest grid."""
    moving = [one for one in finished if one.trajectory.time.size > 1]
    finest = max((one.run.n_steps for one in moving), default=0)
    return [one for one in moving if one.run.n_steps == finest]


def _draw_over_time(axes: Axes, finished: Sequence[FinishedRun], columns: Sequence[Array]) -> None:
    """A column of numbers of every member over the times of the longest run."""
    time = max((one.trajectory.time for one in finished), key=len)
    lines: dict[Member | None, Array] = {}
    for one, values in zip(finished, columns, strict=True):
        line = lines.setdefault(one.run.member, np.full(time.size, np.nan))
        count = min(values.size, time.size)
        line[:count] = values[:count]
    _draw(axes, time, lines, with_markers=False)


def _panels(methods: Sequence[AnyMethod]) -> tuple[Figure, list[Axes]]:
    """One panel for each method, sharing their axes, with the methods as titles."""
    columns = min(2, len(methods))
    figure = new_figure((2.4 if columns == 1 else 1.8) * -(-len(methods) // columns) + 0.6)
    grid, panels = panel_grid(figure, len(methods), columns, sharex=True, sharey=True)
    styles = series_styles(methods)
    for axes, method in zip(panels, methods, strict=True):
        axes.set_title(styles[method.case].label)
    lowest(grid)
    return figure, panels


def _draw(
    axes: Axes, abscissa: Array, lines: dict[Member | None, Array], *, with_markers: bool
) -> None:
    if len(lines) <= MOST_LINES:
        for index, (member, values) in enumerate(lines.items()):
            axes.plot(
                abscissa,
                values,
                color=COLOURS[index % len(COLOURS)],
                linestyle=LINE_STYLES[index % len(LINE_STYLES)],
                marker=MARKERS[index % len(MARKERS)] if with_markers else "",
                label=member_label(member),
            )
        return
    values = np.array(list(lines.values()))
    # a place where no member has a value says nothing
    shown = np.isfinite(values).any(axis=0)
    kept, places = values[:, shown], abscissa[shown]
    for low, high, label, alpha in _BANDS:
        bottom, top = np.nanpercentile(kept, [low, high], axis=0)
        axes.fill_between(
            places, bottom, top, color=COLOURS[0], alpha=alpha, linewidth=0, label=label
        )
        # the edges carry the numbers that a stored figure is compared by
        axes.plot(places, bottom, color=COLOURS[0], linewidth=0.5, label=f"_{label}, least")
        axes.plot(places, top, color=COLOURS[0], linewidth=0.5, label=f"_{label}, greatest")
    axes.plot(
        places,
        np.nanmedian(kept, axis=0),
        color="#000000",
        marker="o" if with_markers else "",
        label="median",
    )


def _finish(figure: Figure, axes: Axes, experiment: Experiment) -> None:
    """A legend below all panels, and above it what is swept where labels do not say it."""
    keys = ", ".join(key.removeprefix("problem.") for key in experiment.swept)
    title = f"{len(experiment.members)} members: {keys}"
    legend_of(figure, axes.get_legend_handles_labels()[0], title=title)
