"""Quantities over time, with their peaks."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.observations.observe import Extent, Observed
from fvi_cli.plotting.methods import series_styles
from fvi_cli.plotting.style import INK, SMALL_TEXT, journal_style, new_figure
from fvi_cli.plotting.time_series import draw_series, finish_figure, select_runs
from fvi_cli.studies.experiment import Experiment, FinishedRun

MOST_PANELS = 6


def has_quantities(item: FinishedRun) -> bool:
    """Whether quantities were asked of a run."""
    observed = item.trajectory.observed
    return observed is not None and bool(observed.quantities)


def quantities_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], *, n_steps: int | None = None
) -> Figure:
    """Draw every quantity over time, a panel for each (up to 6), with the peak of the last method.

    Parameters
    ----------
    experiment, finished
        The experiment and its runs.
    n_steps
        Which step of the ladder to show; None: the finest that most methods have reached.

    Raises
    ------
    ValueError
        If no run has that many steps, or there are no quantities.
    """
    having = [item for item in finished if has_quantities(item)]
    if not having:
        raise ValueError("quantities: the experiment asks for none")
    shown = select_runs(having, n_steps)
    styles = series_styles([item.run.method for item in shown])
    names = list(_observed(shown[0]).quantities)[:MOST_PANELS]
    with journal_style():
        figure = new_figure(0.8 + 1.25 * len(names))
        panels = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
        for name, axes in zip(names, panels, strict=True):
            for position, item in enumerate(shown):
                values = _observed(item).quantities[name]
                style = styles[item.run.method.case]
                draw_series(axes, item.trajectory.time, values, style, position)
            _mark_peak(axes, _observed(shown[-1]).extents[name])
            axes.set_ylabel(name.replace("_", " "))
        finish_figure(figure, panels[-1], shown, experiment)
    return figure


def _observed(item: FinishedRun) -> Observed:
    observed = item.trajectory.observed
    if observed is None:  # pragma: no cover - left out before
        raise ValueError("quantities: none were asked for")
    return observed


def _mark_peak(axes: Axes, extent: Extent) -> None:
    """A cross at the peak, and its value."""
    height = extent.greatest if extent.greatest == extent.peak else extent.least
    axes.plot([extent.peak_time], [height], "x", color=INK, markersize=5, zorder=6)
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
