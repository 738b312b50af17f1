"""Where a scene goes: phase portraits, paths in space, and the shapes of chains and strings."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.looks import method_looks
from fvi_cli.plotting.motions.time_series import (
    MOST_COMPONENTS,
    has_momentum,
    most_accurate,
    select_runs,
)
from fvi_cli.plotting.style import (
    COLOURS,
    DECORATION,
    GUIDE_COLOUR,
    INK,
    journal_style,
    legend_of,
    new_figure,
    note,
    panel_grid,
)
from fvi_cli.plotting.words import coordinates_of, time_label, typeset_name, with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun

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
    names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])
    drawn = names[:MOST_COMPONENTS]
    columns = 1 if len(drawn) == 1 else 2
    with journal_style():
        figure = new_figure(0.5 + (2.1 if columns == 1 else 1.6) * -(-len(drawn) // columns))
        _, panels = panel_grid(figure, len(drawn), columns)
        for component, (name, axes) in enumerate(zip(drawn, panels, strict=True)):
            pairs = [
                (item.trajectory.position[:, component], item.trajectory.momentum[:, component])
                for item in shown
                if item.trajectory.momentum is not None
            ]
            _draw_curves(axes, shown, pairs)
            axes.set_xlabel(_position(experiment, name))
            momentum = f"$p_{{{typeset_name(name).strip('$')}}}$" if len(names) > 1 else "$p$"
            axes.set_ylabel(with_unit(f"momentum {momentum}", experiment.units, "momentum"))
        legend_of(figure, panels[0].get_legend_handles_labels()[0])
    return figure


def path_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the path in the plane of the first two coordinates; of a double pendulum, in space."""
    shown = select_runs(finished)
    with journal_style():
        figure = new_figure(2.9)
        axes = figure.subplots()
        labels = ["horizontal position", "vertical position"]
        if experiment.problem.kind == "double-pendulum":
            _draw_pendulum(axes, experiment, most_accurate(shown).trajectory.position)
            labels = [with_unit(label, experiment.units, "length") for label in labels]
        else:
            _draw_curves(axes, shown, [tuple(one.trajectory.position[:, :2].T) for one in shown])
            if experiment.problem.kind == "kepler":
                axes.plot([0.0], [0.0], "+", color=INK, markersize=8, label="centre", ls="none")
            names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])
            labels = [_position(experiment, name) for name in names[:2]]
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        legend_of(figure, axes.get_legend_handles_labels()[0])
    return figure


def _position(experiment: Experiment, name: str) -> str:
    return with_unit(f"position {typeset_name(name)}", experiment.units, name, "length")


def _draw_curves(
    axes: Axes, shown: Sequence[FinishedRun], pairs: Sequence[tuple[Array, ...]]
) -> None:
    """One curve for every run, with marks where there are several, and a star at the start."""
    names = method_looks([item.run.method for item in shown])
    for position, (item, (x, y)) in enumerate(zip(shown, pairs, strict=True)):
        own = names[item.run.method.case]
        every = max(1, x.size // _DRAWN)
        finite = np.isfinite(x[::every]) & np.isfinite(y[::every])
        x, y = x[::every][finite], y[::every][finite]
        properties = own.look.properties()
        if len(pairs) == 1:
            properties["marker"], properties["linestyle"], properties["linewidth"] = "", "-", 0.9
        stride = max(1, x.size // _MARKS)
        shifted = (((2 * position + 1) * stride // 6) % stride, stride)
        axes.plot(
            x, y, markevery=shifted, label=own.label, zorder=3 + 0.01 * position, **properties
        )
    first = pairs[0]
    star = axes.plot(first[0][:1], first[1][:1], marker="*", markersize=9, label="start", zorder=5)[
        0
    ]
    star.set(markerfacecolor="white", markeredgecolor=INK, linestyle="none")


def _draw_pendulum(axes: Axes, experiment: Experiment, angles: Array) -> None:
    """Paths of both masses of a double pendulum, with its rods at the start and at the end."""
    lengths = experiment.problem_specification.get("lengths", (1.0, 1.0))
    steps = [
        float(length) * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
        for length, angle in zip(lengths, angles.T, strict=True)
    ]
    inner, outer = steps[0], steps[0] + steps[1]
    axes.plot(*inner.T, color=COLOURS[1], linewidth=1.4, label="first mass")
    axes.plot(*outer.T, color=COLOURS[0], linewidth=0.9, label="second mass")
    for when, label, marker in ((0, "at the start", "o"), (-1, "at the end", "s")):
        rods = np.stack([np.zeros(2), inner[when], outer[when]])
        colour, face = (INK, INK) if when else (GUIDE_COLOUR, "white")
        line = axes.plot(*rods.T, color=colour, linewidth=1.6, marker=marker, label=label)[0]
        line.set(markerfacecolor=face, zorder=4)


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
            last.set_ylabel(with_unit("ground\n$a(t)$", experiment.units, "acceleration"))
            figure.align_ylabels([axes, last])
        _draw_masses(axes, experiment, best, what)
        last.set_xlabel(time_label(experiment, [best]))
        last.set_xlim(0.0, experiment.problem.final_time)
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


def _draw_masses(axes: Axes, experiment: Experiment, best: FinishedRun, what: str) -> None:
    position, time = best.trajectory.position, best.trajectory.time
    count = position.shape[1]
    drawn = np.unique(np.linspace(0, count - 1, min(count, _MOST_LINES)).round().astype(int))
    spacing = (count - 1) / max(drawn.size - 1, 1)
    lift = _lift(position[:, drawn], (0.8 if count < _FEW_LINES else 1.3) * spacing)
    for index in drawn[::-1]:
        _draw_lifted(axes, time, position[:, index] * lift, float(index + 1), f"{what} {index + 1}")
    axes.set_ylabel(f"{what} $i$, displaced by $x_i(t)$")
    axes.set_yticks(_numbers(count))
    _scale_bar(axes, experiment, lift, position[:, drawn], "x_i")


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
    axes.set_xlabel(with_unit("place $s$", experiment.units, "length"))
    axes.set_ylabel(with_unit("time $t$, displaced by $u(s, t)$", experiment.units, "time"))
    _scale_bar(axes, experiment, lift, shapes, "u")


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


def _scale_bar(axes: Axes, experiment: Experiment, lift: float, values: Array, name: str) -> None:
    """A bar beside the panel as long as a round displacement, with its name and value."""
    largest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    if largest == 0:
        return
    unit = 10.0 ** math.floor(math.log10(largest))
    unit_name = experiment.units.get("length", "")
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
    note(
        axes, 1.06, 0.5, f"${name} = {size:g}$ {unit_name}".rstrip(), ha="left", rotation="vertical"
    )
