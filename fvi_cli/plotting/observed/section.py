"""Sections: where a motion is whenever an event happens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.observations.observe import Occurrences
from fvi_cli.plotting.methods import series_styles
from fvi_cli.plotting.style import COLOURS, MARKERS, journal_style, legend_above, new_figure
from fvi_cli.plotting.time_series import select_runs
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun

MOST_PANELS = 4
ROUND_OFF = 1e-9
MANY = 200
"""Points from which on they are drawn as dots."""


def has_events(item: FinishedRun) -> bool:
    """Whether an event of a run happened."""
    observed = item.trajectory.observed
    return observed is not None and any(one.time.size for one in observed.events.values())


def section_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], *, n_steps: int | None = None
) -> Figure:
    """Draw velocity against position at every event, a panel for every coordinate (up to 4).

    Parameters
    ----------
    experiment, finished
        The experiment and its runs.
    n_steps
        Which step of the ladder to show; None: the finest that most methods have reached.

    Raises
    ------
    ValueError
        If no run has that many steps, or no event happened.
    """
    having = [item for item in finished if has_events(item)]
    problem = experiment.problem
    if not having or not isinstance(problem, Problem):
        raise ValueError("section: no event happened")
    shown = select_runs(having, n_steps)
    labels = series_styles([item.run.method for item in shown])
    names = problem.coordinates[:MOST_PANELS]
    columns = 1 if len(names) == 1 else 2
    rows = -(-len(names) // columns)
    with journal_style():
        figure = new_figure(0.7 + (2.4 if columns == 1 else 1.7) * rows)
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for index, (name, axes) in enumerate(zip(names, panels, strict=False)):
            series = [
                (item, event, one)
                for item in shown
                if item.trajectory.observed is not None
                for event, one in item.trajectory.observed.events.items()
                if one.time.size
            ]
            for number, (item, event, one) in enumerate(series):
                method = labels[item.run.method.case].label
                dots = one.time.size > MANY
                axes.plot(
                    one.position[:, index],
                    one.velocity[:, index],
                    linestyle="none",
                    marker="." if dots else MARKERS[number % len(MARKERS)],
                    markersize=1.5 if dots else 3.5,
                    markerfacecolor="none" if not dots else None,
                    color=COLOURS[number % len(COLOURS)],
                    label=event if len(shown) == 1 else f"{event}, {method}",
                )
            _widen(axes, [one for _, _, one in series])
            axes.set_xlabel(f"position {name}")
            axes.set_ylabel(f"velocity v{name}")
        for axes in panels[len(names) :]:
            axes.set_axis_off()
        legend_above(figure, panels[0])
    return figure


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
