"""Where a scene goes: phase portraits, paths in the plane, and shapes of chains and strings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import Look, method_looks
from fvi_cli.plotting.motions.time_series import (
    MOST_COMPONENTS,
    has_momentum,
    most_accurate,
    select_runs,
)
from fvi_cli.plotting.panels import plane
from fvi_cli.plotting.style import (
    COLOURS,
    DECORATION,
    GUIDE_COLOUR,
    INK,
    journal_style,
    new_figure,
    note,
    wrap,
)
from fvi_cli.plotting.words import coordinates_of, time_label, typeset_name
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun

_MOST_LINES = 24  # of a chain or frame with more masses every n-th is drawn
_SHAPES = 17  # times at which the shape of a string is drawn
_POINTS = 201  # of each shape
_SHARE = 0.85  # of the gap between two lines, filled by the largest displacements
WATERFALL_KINDS = ("chain", "frame", "string", "structure")


def phase_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw momentum against position of every method, a panel for every component (up to 4)."""
    shown = select_runs(finished, has_momentum)
    names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])
    panels = []
    for component, name in enumerate(names[:MOST_COMPONENTS]):
        pairs = [
            (item.trajectory.position[:, component], item.trajectory.momentum[:, component])
            for item in shown
            if item.trajectory.momentum is not None
        ]
        momentum = f"$p_{{{typeset_name(name).strip('$')}}}$" if len(names) > 1 else "$p$"
        panels.append(
            Panel(
                curves=_paths(shown, pairs),
                x=position_label(experiment, name),
                y=with_unit(f"momentum {momentum}", experiment.units, "momentum"),
                height=2.1 if len(names) == 1 else 1.6,
            )
        )
    return plane(panels, columns=min(2, len(panels)))


def path_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the path in the plane of the first two coordinates.

    For a double pendulum, whose coordinates are angles, in the plane in which it swings.
    """
    shown = select_runs(finished)
    if experiment.problem.kind == "double-pendulum":
        curves = _pendulum(experiment, most_accurate(shown).trajectory.position)
        labels = [
            with_unit(label, experiment.units, "length")
            for label in ("horizontal position", "vertical position")
        ]
    else:
        curves = _paths(shown, [tuple(one.trajectory.position[:, :2].T) for one in shown])
        names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])
        labels = [position_label(experiment, name) for name in names[:2]]
    if fixed := {"kepler": "centre", "double-pendulum": "pivot"}.get(experiment.problem.kind):
        cross = Look(colour=INK, marker="+", has_line=False, size=8.0)
        curves.append(Curve(x=np.zeros(1), y=np.zeros(1), label=fixed, look=cross))
    panel = Panel(curves=curves, x=labels[0], y=labels[1], height=2.4)
    return plane([panel], is_equal=True)


def position_label(experiment: Experiment, name: str) -> str:
    """Words beside the axis of a coordinate."""
    return with_unit(f"position {typeset_name(name)}", experiment.units, name, "length")


def _paths(shown: Sequence[FinishedRun], pairs: Sequence[tuple[Array, ...]]) -> list[Curve]:
    """One curve for every run, and a star at the start."""
    looks = method_looks([item.run.method for item in shown])
    curves = []
    for item, (x, y) in zip(shown, pairs, strict=True):
        own, finite = looks[item.run.method.case], np.isfinite(x) & np.isfinite(y)
        look = replace(own.look, width=0.9) if len(pairs) == 1 else own.look
        curves.append(Curve(x=x[finite], y=y[finite], label=own.label, look=look))
    star = Look(colour=INK, marker="*", has_line=False, is_filled=False, size=9.0)
    first = [values[:1] for values in pairs[0]]
    return [*curves, Curve(x=first[0], y=first[1], label="start", look=star)]


def _pendulum(experiment: Experiment, angles: Array) -> list[Curve]:
    """Paths of both masses of a double pendulum, with its rods at the start and at the end."""
    lengths = experiment.problem_specification.get("lengths", (1.0, 1.0))
    steps = [
        float(length) * np.stack([np.sin(angle), -np.cos(angle)])
        for length, angle in zip(lengths, angles.T, strict=True)
    ]
    inner, outer = steps[0], steps[0] + steps[1]
    curves = [
        Curve(x=at[0], y=at[1], label=label, look=Look(colour=colour, width=width))
        for at, label, colour, width in (
            (inner, "path of the first mass", COLOURS[1], 1.4),
            (outer, "path of the second mass", COLOURS[0], 0.9),
        )
    ]
    for when, label, marker in ((0, "rods at the start", "o"), (-1, "rods at the end", "s")):
        rods = np.stack([np.zeros(2), inner[:, when], outer[:, when]]).T
        look = Look(
            colour=INK if when else GUIDE_COLOUR, marker=marker, width=1.6, is_filled=bool(when)
        )
        curves.append(Curve(x=rods[0], y=rods[1], label=label, look=look))
    return curves


@journal_style()
def waterfall_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the most accurate run as lines one above the other.

    For chains, frames and structures a line over time for every coordinate (up to 24), lifted to
    its number; for a string its shapes, lifted to their times.
    """
    kind = experiment.problem.kind
    best = most_accurate(select_runs(finished))
    if kind == "string":
        figure = new_figure(3.6)
        _draw_shapes(figure.subplots(), experiment, best)
        return figure
    ground = _ground_acceleration(experiment, best.trajectory.time)
    figure = new_figure(3.6 if ground is None else 4.4)
    what = {"chain": "mass", "frame": "storey"}.get(kind, "coordinate")
    if ground is None:
        axes = last = figure.subplots()
    else:
        axes, last = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
        last.plot(best.trajectory.time, ground, color=INK, linewidth=0.8, label="_ground")
        words = with_unit("ground acceleration", experiment.units, "acceleration")
        last.set_ylabel(wrap(words, 0.7))
        figure.align_ylabels([axes, last])
    _draw_masses(axes, experiment, best, what)
    last.set_xlabel(time_label(experiment, [best]))
    last.set_xlim(0.0, experiment.problem.final_time)
    return figure


def _ground_acceleration(experiment: Experiment, time: Array) -> Array | None:
    """The acceleration of a shaken ground, from the force on the first storey; else None."""
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
    lift = _lift(position[:, drawn], np.diff(drawn).min(initial=count))
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
    lift = _lift(shapes.T, np.diff(time[picked]).min())
    for index, shape in zip(picked[::-1], shapes[::-1], strict=True):
        at = float(time[index])
        _draw_lifted(axes, place, shape * lift, at, f"t = {at:.4g}")
    axes.set_xlim(0.0, length)
    axes.set_xlabel(with_unit("place $s$", experiment.units, "length"))
    axes.set_ylabel(with_unit("time $t$, displaced by $u(s, t)$", experiment.units, "time"))
    _scale_bar(axes, experiment, lift, shapes, "u")


def _lift(values: Array, spacing: float) -> float:
    """Largest factor with which no line (a column of values) touches the next one above it."""
    up, down = (np.where(sign * values > 0, sign * values, 0.0) for sign in (1, -1))
    room = max(up.max(), down.max(), (up[:, :-1] + down[:, 1:]).max(initial=0.0))
    return _SHARE * spacing / room if 0 < room < math.inf else 1.0


def _draw_lifted(axes: Axes, x: Array, values: Array, level: float, label: str) -> None:
    """One line above its level, filled to it, so that it is read without colour."""
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
