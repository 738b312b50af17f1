"""Quantities over time, with their peaks."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.observations.observe import Extent, Observed
from fvi_cli.plotting.motions.labels import styled, with_unit
from fvi_cli.plotting.motions.time_series import draw_series, finish_figure, select_runs
from fvi_cli.plotting.style import INK, SMALL_TEXT, journal_style, new_figure
from fvi_cli.studies.experiment import Experiment, FinishedRun

MOST_PANELS = 6
LONGEST_LABEL = 17


def has_quantities(item: FinishedRun) -> bool:
    """Whether quantities were asked of a run."""
    return bool(observed_of(item).quantities)


def quantities_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw every quantity over time, a panel for each (up to 6), with the last method's peak."""
    shown = select_runs(finished, has_quantities)
    names = list(observed_of(shown[0]).quantities)[:MOST_PANELS]
    with journal_style():
        figure = new_figure(0.8 + panel_height(len(names)) * len(names))
        panels = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
        for name, axes in zip(names, panels, strict=True):
            for item, style, position in styled(shown):
                values = observed_of(item).quantities[name]
                draw_series(axes, item.trajectory.time, values, style, position)
            mark_peak(axes, observed_of(shown[-1]).extents[name])
            name_quantity(axes, experiment, name)
        figure.align_ylabels(panels)
        finish_figure(figure, panels[-1], shown, experiment)
    return figure


def name_quantity(axes: Axes, experiment: Experiment, name: str) -> None:
    """The name of a quantity beside its panel, in lines that are no longer than that is high."""
    words = with_unit(name.replace("_", " "), experiment, name)
    axes.set_ylabel(textwrap.fill(words, LONGEST_LABEL, break_long_words=False))
    # room for the cross at a peak
    axes.margins(y=0.12)


def panel_height(count: int) -> float:
    """Height of one of several panels in inches."""
    return 1.25 if count <= 3 else 0.95


def observed_of(item: FinishedRun) -> Observed:
    """What was observed of a run; nothing where nothing was asked for."""
    observed = item.trajectory.observed
    return Observed(mesh=item.trajectory.time) if observed is None else observed


def mark_peak(axes: Axes, extent: Extent, colour: str = "") -> None:
    """A cross at the peak, and its value where no colour says whose it is."""
    height = extent.greatest if extent.greatest == extent.peak else extent.least
    axes.plot([extent.peak_time], [height], "x", color=colour or INK, markersize=5, zorder=6)
    if colour:
        return
    low, high = axes.get_ylim()
    above = height - low < 0.5 * (high - low)
    axes.annotate(
        f"{height:.4g}".replace("-", "\N{MINUS SIGN}"),
        (extent.peak_time, height),
        xytext=(5, 4 if above else -4),
        textcoords="offset points",
        va="bottom" if above else "top",
        fontsize=SMALL_TEXT,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
    )
