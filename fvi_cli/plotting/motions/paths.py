"""Where a scene goes: phase portraits, paths in space, and the shapes of chains and strings."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.methods import SeriesStyle
from fvi_cli.plotting.motions.balance import most_accurate
from fvi_cli.plotting.motions.labels import (
    coordinate_labels,
    styled,
    time_axis,
    with_unit,
)
from fvi_cli.plotting.motions.time_series import has_momentum, select_runs
from fvi_cli.plotting.style import (
    COLOURS,
    DECORATION,
    GUIDE_COLOUR,
    INK,
    LINE_STYLES,
    journal_style,
    legend_above,
    new_figure,
    note,
    panel_grid,
)
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun

_MOST_COMPONENTS = 4
_MOST_LINES = 24
_FEW_LINES = 8
_SHAPES = 17
_POINTS = 201
_MARKS = 9
_DRAWN = 4001  # points of one curve
WATERFALL_KINDS = ("chain", "frame", "string", "structure")


def phase_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw momentum against position of every method, a panel for every component (up to 4)."""
    shown = select_runs(finished, has_momentum)
    dimension = min(shown[0].trajectory.position.shape[1], _MOST_COMPONENTS)
    columns = 1 if dimension == 1 else 2
    names = coordinate_labels(experiment, shown[0].trajectory.position.shape[1])
    with journal_style():
        figure = new_figure(0.7 + (2.1 if columns == 1 else 1.6) * -(-dimension // columns))
        _, panels = panel_grid(figure, dimension, columns)
        for component, axes in enumerate(panels):
            for item, style, position in styled(shown):
                place, momentum = item.trajectory.position, item.trajectory.momentum
                if momentum is not None:
                    x, y = place[:, component], momentum[:, component]
                    _draw_curve(axes, x, y, style, position, len(shown))
            _mark_start(axes, axes.lines[0])
            name = names[component]
            axes.set_xlabel(with_unit(f"position {name}", experiment, "length"))
            label = f"momentum {_momentum_name(name, len(names))}"
            axes.set_ylabel(with_unit(label, experiment, "momentum"))
        legend_above(figure, panels[0])
    return figure


def path_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the path in the plane of the first two coordinates; of a double pendulum, in space."""
    shown = select_runs(finished)
    with journal_style():
        if experiment.problem.kind == "double-pendulum":
            return _pendulum_path(experiment, most_accurate(shown))
        names = coordinate_labels(experiment, shown[0].trajectory.position.shape[1])
        figure = new_figure(3.0)
        axes = figure.subplots()
        for item, style, position in styled(shown):
            place = item.trajectory.position
            _draw_curve(axes, place[:, 0], place[:, 1], style, position, len(shown))
        first = axes.lines[0]
        if experiment.problem.kind == "kepler":
            axes.plot([0.0], [0.0], "+", color=INK, markersize=8, label="centre", linestyle="none")
        _mark_start(axes, first)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(with_unit(f"position {names[0]}", experiment, "length"))
        axes.set_ylabel(with_unit(f"position {names[1]}", experiment, "length"))
        legend_above(figure, axes)
    return figure


def waterfall_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the most accurate run of a chain, a frame or a string as lines one above the other.

    Of chains and frames there is a line over time for every mass (for up to 24 of them), lifted to
    its place; of a string there are its shapes, lifted to their times.
    """
    kind = experiment.problem.kind
    best = most_accurate(select_runs(finished))
    with journal_style():
        if kind == "string":
            figure = new_figure(3.6)
            _draw_shapes(figure.subplots(), experiment, best)
            return figure
        ground = _ground_acceleration(experiment, best.trajectory.time)
        figure = new_figure(3.6 if ground is None else 4.4)
        what = "mass" if kind == "chain" else "storey"
        if ground is None:
            axes = last = figure.subplots()
        else:
            axes, last = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
            last.plot(best.trajectory.time, ground, color=INK, linewidth=0.8, label="_ground")
            last.set_ylabel(with_unit("ground $a(t)$", experiment, "acceleration"))
        _draw_masses(axes, best, what)
        time_axis(last, experiment, [best])
    return figure


def _ground_acceleration(experiment: Experiment, time: Array) -> Array | None:
    """Of a frame that the ground shakes: its acceleration, from the force on the first storey."""
    problem = experiment.problem
    if "ground_acceleration" not in experiment.problem_specification:
        return None
    if not isinstance(problem, Problem) or problem.scene.forcing is None:
        return None
    force = problem.scene.forcing(time)[:, 0]
    return np.asarray(-force / problem.scene.inertia.mass[0, 0])


def _draw_masses(axes: Axes, best: FinishedRun, what: str) -> None:
    position, time = best.trajectory.position, best.trajectory.time
    count = position.shape[1]
    drawn = np.unique(np.linspace(0, count - 1, min(count, _MOST_LINES)).round().astype(int))
    spacing = (count - 1) / max(drawn.size - 1, 1)
    lift = _lift(position[:, drawn], (0.8 if count < _FEW_LINES else 1.3) * spacing)
    for index in drawn[::-1]:
        _draw_lifted(axes, time, position[:, index] * lift, float(index + 1), f"{what} {index + 1}")
    axes.set_ylabel(f"{what} $i$, displaced by $x_i(t)$")
    axes.set_yticks(_numbers(count))
    _scale_bar(axes, lift, position[:, drawn], "$x_i$")


def _numbers(count: int) -> list[int]:
    """The first, the last, and round numbers between them."""
    step = next(s for k in range(9) for s in (10**k, 2 * 10**k, 5 * 10**k) if count / s <= 8)
    between = range(step if step > 1 else 2, count, step)
    return [1, *(k for k in between if min(k - 1, count - k) >= step / 2), *([count] * (count > 1))]


def _draw_shapes(axes: Axes, experiment: Experiment, best: FinishedRun) -> None:
    position, time = best.trajectory.position, best.trajectory.time
    length = float(experiment.problem_specification.get("length", 1.0))
    place = np.linspace(0.0, length, _POINTS)
    modes = np.sin(np.outer(np.arange(1, position.shape[1] + 1), np.pi * place / length))
    picked = np.unique(np.linspace(0, time.size - 1, _SHAPES).round().astype(int))
    shapes = position[picked] @ modes
    lift = _lift(shapes, 1.1 * (time[picked[1]] - time[picked[0]]))
    for index, shape in zip(picked[::-1], shapes[::-1], strict=True):
        at = float(time[index])
        _draw_lifted(axes, place, shape * lift, at, f"t = {at:.4g}")
    axes.set_xlim(0.0, length)
    axes.set_xlabel("place $s$")
    axes.set_ylabel("time $t$, displaced by $u(s, t)$")
    _scale_bar(axes, lift, shapes, "$u$")


def _lift(values: Array, height: float) -> float:
    """Factor that makes the largest displacement `height`."""
    largest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    return height / largest if largest > 0 else 1.0


def _draw_lifted(axes: Axes, x: Array, values: Array, level: float, label: str) -> None:
    """One line above its level, filled to it, so that it is read without colour."""
    kept = np.unique(np.linspace(0, x.size - 1, min(x.size, _DRAWN)).round().astype(int))
    x, values = x[kept], values[kept]
    axes.fill_between(x, level, level + values, color=COLOURS[5], alpha=0.45, linewidth=0)
    axes.plot(x, level + values, color=INK, linewidth=0.8, label=f"_{label}")


def _scale_bar(axes: Axes, lift: float, values: Array, name: str) -> None:
    """A bar beside the panel as long as a round displacement, with its name and value."""
    largest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    if largest == 0:
        return
    unit = 10.0 ** math.floor(math.log10(largest))
    size = max(f * unit for f in (1, 2, 5) if f * unit <= largest * (1 + 1e-9))
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top)
    share = size * lift / (top - bottom)
    axes.plot(
        [1.03, 1.03],
        [0.5 - share / 2, 0.5 + share / 2],
        transform=axes.transAxes,
        color=INK,
        linewidth=2.0,
        solid_capstyle="butt",
        clip_on=False,
        **DECORATION,
    )
    note(axes, 1.06, 0.5, f"{name} = {size:g}", ha="left", rotation="vertical")


def _pendulum_path(experiment: Experiment, best: FinishedRun) -> Figure:
    """Paths of both masses of a double pendulum, with its rods at the start and at the end."""
    angles = best.trajectory.position
    first, second = (float(v) for v in experiment.problem_specification.get("lengths", (1.0, 1.0)))
    inner = first * np.stack([np.sin(angles[:, 0]), -np.cos(angles[:, 0])], axis=1)
    outer = inner + second * np.stack([np.sin(angles[:, 1]), -np.cos(angles[:, 1])], axis=1)
    figure = new_figure(3.3)
    axes = figure.subplots()
    axes.plot(*inner.T, color=COLOURS[1], linestyle=LINE_STYLES[1], label="first mass")
    axes.plot(*outer.T, color=COLOURS[0], linewidth=0.9, label="second mass")
    for when, label, marker in ((0, "at the start", "o"), (-1, "at the end", "s")):
        rods = np.stack([np.zeros(2), inner[when], outer[when]])
        axes.plot(
            *rods.T,
            color=INK if when else GUIDE_COLOUR,
            linewidth=1.6,
            marker=marker,
            markerfacecolor="white" if when == 0 else INK,
            label=label,
            zorder=4,
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("horizontal position")
    axes.set_ylabel("vertical position")
    legend_above(figure, axes)
    return figure


def _draw_curve(
    axes: Axes, x: Array, y: Array, style: SeriesStyle, position: int, curves: int
) -> None:
    """One curve; with marks, shifted from curve to curve, where there are several."""
    every = max(1, x.size // _DRAWN)
    x, y = x[::every], y[::every]
    finite = np.isfinite(x) & np.isfinite(y)
    properties = style.line_properties()
    if curves == 1:
        axes.plot(x[finite], y[finite], color=properties["color"], linewidth=0.9, label=style.label)
        return
    stride = max(1, x.size // _MARKS)
    axes.plot(
        x[finite],
        y[finite],
        markevery=(((2 * position + 1) * stride // 6) % stride, stride),
        label=style.label,
        zorder=3 + 0.01 * position,
        **properties,
    )


def _mark_start(axes: Axes, line: Line2D) -> None:
    x, y = (np.asarray(values) for values in line.get_data())
    axes.plot(
        x[:1],
        y[:1],
        marker="*",
        markersize=9,
        markerfacecolor="white",
        markeredgecolor=INK,
        linestyle="none",
        label="start",
        zorder=5,
    )


def _momentum_name(name: str, components: int) -> str:
    inner = name.strip("$")
    return f"$p_{{{inner}}}$" if components > 1 else "$p$"
