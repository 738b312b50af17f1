"""Solutions, energies, errors and quantities over time, exact ones beside those of methods."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.results.observed import Extent, Observed
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.methods import SeriesStyle
from fvi_cli.plotting.motions.labels import (
    coordinates_of,
    styled,
    time_axis,
    typeset_name,
    with_unit,
)
from fvi_cli.plotting.style import (
    INK,
    SMALL_TEXT,
    few_decades,
    journal_style,
    legend_above,
    new_figure,
)
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.study import reference_of

_FINE_POINTS = 2001
_MARKS = 12  # marks on one curve
_MOST_COMPONENTS = 4
_VISIBLE = 0.1  # of the largest position: an error that the eye sees
MOST_PANELS = 6
"""Quantities that are drawn; the first of them."""
LONGEST_LABEL = 17


def trajectory_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the position of every method and the exact one, a panel for each component (up to 4)."""
    shown = select_runs(finished, visibly_apart=True)
    names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])
    exact, panels = experiment.problem.exact, []
    time = np.linspace(0.0, experiment.problem.final_time, _FINE_POINTS)
    for component, name in enumerate(names[:_MOST_COMPONENTS]):
        typeset = re.sub(r"_\{(\d)\}", r"_\1", typeset_name(name)).strip("$")
        panels.append(
            _Panel(
                label=with_unit(f"position ${typeset}(t)$", experiment, name, "length"),
                curves=[item.trajectory.position[:, component] for item in shown],
                exact=None if exact is None else (time, exact(time)[:, component]),
            )
        )
    return _against_exact(experiment, shown, panels, 1.1 + 1.45 * len(panels))


def energy_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the Hamiltonian without forcing of every method that has a momentum."""
    shown = select_runs(finished, has_momentum, visibly_apart=True)
    panel = _Panel(
        label=with_unit("energy $H(x, p)$", experiment, "energy"),
        curves=[energy for item in shown if (energy := item.trajectory.energy) is not None],
        exact=exact_energy(experiment),
    )
    return _against_exact(experiment, shown, [panel], 2.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Panel:
    """Curves over time, one for every run that is shown, and the times and values of the truth."""

    label: str
    curves: Sequence[Array]
    exact: tuple[Array, Array] | None


def _against_exact(
    experiment: Experiment, shown: Sequence[FinishedRun], panels: Sequence[_Panel], height: float
) -> Figure:
    with journal_style():
        figure = new_figure(height)
        column = figure.subplots(len(panels), 1, squeeze=False, sharex=True)[:, 0]
        for panel, axes in zip(panels, column, strict=True):
            if panel.exact is not None:
                # a broad light line, seen even where thin ones lie upon it
                (line,) = axes.plot(*panel.exact, color="#bdbdbd", linewidth=4.0, label="exact")
                line.set(zorder=2, solid_capstyle="butt")
            for (item, style, position), values in zip(styled(shown), panel.curves, strict=True):
                draw_series(axes, item.trajectory.time, values, style, position)
            _limit(axes, panel.curves if panel.exact is None else [panel.exact[1]])
            axes.set_ylabel(panel.label)
        finish_figure(figure, column[-1], shown, experiment)
    return figure


def error_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the absolute error over time, the largest over the components, logarithmically.

    Where no exact solution is known, the error is measured against the refined run.
    """
    shown = select_runs(finished)
    reference = reference_of(shown[0].run)
    with journal_style():
        figure = new_figure(2.5)
        axes = figure.subplots()
        axes.set_yscale("log")
        positive = []
        for item, style, position in styled(shown):
            trajectory = item.trajectory
            with np.errstate(over="ignore", invalid="ignore"):
                error = np.abs(trajectory.position - reference.values(trajectory.time)).max(axis=1)
            error = np.where(np.isfinite(error) & (error > 0), error, np.nan)
            draw_series(axes, trajectory.time, error, style, position, floor=item.floor)
            positive.append(error[np.isfinite(error)])
        values = np.concatenate(positive)
        if values.size:
            high = min(values.max(), 1e3 * max(np.median(p) for p in positive if p.size))
            # a zero crossing of the error is no reason to show sixteen decades
            low = max(values.min(), 1e-3 * min(np.median(p) for p in positive if p.size))
            axes.set_ylim(low / 2, high * 2)
            if high / low > 1e2:
                few_decades(axes.yaxis, 8)
        several = shown[0].trajectory.position.shape[1] > 1
        label = r"error $\max_i\,|x_i - x_i(t)|$" if several else "error $|x_k - x(t_k)|$"
        if experiment.problem.exact is None:
            label = "error against a refined run"
        axes.set_ylabel(with_unit(label, experiment, "length"))
        finish_figure(figure, axes, shown, experiment)
    return figure


def has_momentum(item: FinishedRun) -> bool:
    """Whether the method of a run has a momentum, and so an energy."""
    return item.trajectory.momentum is not None and item.trajectory.energy is not None


def select_runs(
    finished: Sequence[FinishedRun],
    is_drawable: Callable[[FinishedRun], bool] = lambda item: True,
    *,
    visibly_apart: bool = False,
) -> list[FinishedRun]:
    """Of every method the run with the finest step that as many methods as possible have reached.

    Parameters
    ----------
    finished
        Runs of one experiment.
    is_drawable
        Which of them have what is drawn.
    visibly_apart
        The finest of these steps at which some error is 10 % of the largest position, so that a
        picture does not show one curve for all.

    Raises
    ------
    ValueError
        If there is no such run, or none got beyond its start.
    """
    usable = [item for item in finished if is_drawable(item) and item.trajectory.time.size > 1]
    if not usable:
        raise ValueError("no run has what is drawn")
    there = sorted({item.run.n_steps for item in usable})
    reached = [item.run.n_steps for item in usable if item.status in ("ok", "floor")]
    most = max(map(reached.count, there))
    choices = [n for n in there if reached.count(n) == most]
    apart = [n for n in choices if any(f.run.n_steps == n and _is_off(f) for f in usable)]
    n_steps = max(apart if visibly_apart and apart else choices)
    return [item for item in usable if item.run.n_steps == n_steps]


def _is_off(item: FinishedRun) -> bool:
    largest = float(np.abs(item.trajectory.position).max())
    return bool(np.isfinite(item.error) and item.error >= _VISIBLE * largest)


def exact_energy(experiment: Experiment) -> tuple[Array, Array] | None:
    """Time and energy of the exact solution; its velocity by finite differences on a fine grid."""
    problem = experiment.problem
    if not isinstance(problem, Problem) or problem.exact is None:
        return None
    if problem.scene.lagrangian is not None:
        return None
    time = np.linspace(0.0, problem.final_time, 4 * (_FINE_POINTS - 1) + 1)
    position = problem.exact(time)
    velocity = np.gradient(position, time[1], axis=0, edge_order=2)
    momentum = velocity @ problem.scene.inertia.mass.T
    return time[::4], problem.scene.energy(position, momentum)[::4]


def draw_series(
    axes: Axes,
    time: Array,
    values: Array,
    style: SeriesStyle,
    position: int,
    *,
    floor: float = float("nan"),
) -> None:
    """One curve with a few marks, which are shifted from curve to curve."""
    every = max(1, time.size // _FINE_POINTS)
    time, values = time[::every], values[::every]
    stride = max(1, time.size // _MARKS)
    axes.plot(
        time,
        np.where(np.isfinite(values), values, np.nan),
        markevery=(((2 * position + 1) * stride // 6) % stride, stride),
        label=style.label,
        gid=f"floor {floor:.1e}" if np.isfinite(floor) else None,
        zorder=3 + 0.01 * position,
        **style.line_properties(),
    )


def _limit(axes: Axes, ranges: Sequence[Array]) -> None:
    """Keep curves that run away from pressing the others flat."""
    finite = np.concatenate([values[np.isfinite(values)] for values in ranges] or [np.zeros(1)])
    if finite.size == 0:
        return
    if len(ranges) > 1:
        ends = sorted(float(np.abs(v[np.isfinite(v)]).max(initial=0.0)) for v in ranges)
        finite = finite[np.abs(finite) <= 10 * ends[0]]
    low, high = float(finite.min()), float(finite.max())
    span = (high - low) or abs(high) or 1.0
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(bottom, low - 0.6 * span), min(top, high + 0.6 * span))


def finish_figure(
    figure: Figure, axes: Axes, shown: Sequence[FinishedRun], experiment: Experiment
) -> None:
    """Time axis, and one legend above all panels."""
    time_axis(axes, experiment, shown)
    legend_above(figure, axes)


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
