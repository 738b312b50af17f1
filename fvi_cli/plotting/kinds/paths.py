"""Where a scene goes: phase portraits, paths in the plane, and shapes of chains and strings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines, waterfall
from fvi_cli.plotting.kinds.convergence import in_rows
from fvi_cli.plotting.kinds.motions import (
    MOST_COMPONENTS,
    NO_MOMENTUM,
    drawn_motion,
    drawn_velocity,
    most_accurate,
    select_runs,
)
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import BLACK, COLOURS, GREY, INK, Look, method_looks, method_names
from fvi_cli.plotting.words import coordinates_of, position_label, time_label, velocity_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun

_MOST_LINES = 24  # of a chain or frame with more masses every n-th is drawn
_SHAPES, _POINTS = 17, 201  # times at which the shape of a string is drawn, and points of each
_WATERFALLS = {"chain": "mass", "frame": "storey", "string": "", "structure": "coordinate"}
_FIXED = {"kepler": "centre", "double-pendulum": "pivot"}
_CROSS = Look(colour=INK, marker="+", width=0, size=6.0)


def phase_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw velocity against position of every method, a panel for every component (up to 4)."""
    shown = select_runs(
        finished,
        lambda one: bool(one.trajectory.steps) or one.trajectory.momentum is not None,
        NO_MOMENTUM,
    )
    names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])[:MOST_COMPONENTS]
    motions = [(drawn_motion(item)[1], drawn_velocity(item)) for item in shown]
    panels = [
        Panel(
            curves=_paths(shown, [(x[:, k], v[:, k]) for x, v in motions]),
            x=position_label(experiment, name),
            y=velocity_label(experiment, name),
        )
        for k, name in enumerate(names)
    ]
    return planes(panels)


def planes(panels: Sequence[Panel], **titles: Any) -> Figure:
    """A figure of planes: one in a column, several in rows of two."""
    columns = min(len(panels), 2)
    return figure(in_rows(panels, columns), lines, height=2.5, is_wide=columns > 1, **titles)


def path_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the path in the plane of the first two coordinates.

    For a double pendulum, whose coordinates are angles, in the plane in which it swings.
    """
    shown, kind = select_runs(finished), experiment.problem.kind
    dimension = shown[0].trajectory.position.shape[1]
    if dimension == 1:
        raise NothingToDraw("the scene has one coordinate only")
    labels = [position_label(experiment, one) for one in coordinates_of(experiment, dimension)[:2]]
    if kind == "double-pendulum":
        curves = _pendulum(experiment, drawn_motion(most_accurate(shown))[1])
        words = ("horizontal position", "vertical position")
        labels = [with_unit(label, experiment.units, "length") for label in words]
    else:
        curves = _paths(shown, [tuple(drawn_motion(one)[1][:, :2].T) for one in shown])
    if kind in _FIXED:
        curves.append(Curve(x=np.zeros(1), y=np.zeros(1), label=_FIXED[kind], look=_CROSS))
    return planes([Panel(curves=curves, x=labels[0], y=labels[1], is_equal=True)])


def _paths(shown: Sequence[FinishedRun], pairs: Sequence[tuple[Array, ...]]) -> list[Curve]:
    """One curve for every run, and a point at the start."""
    methods = [item.run.method for item in shown]
    looks, names = method_looks(methods), method_names(methods)
    curves = [
        Curve(x=x, y=y, label=names[case], look=replace(looks[case], marker="", width=0.9))
        for case, (x, y) in zip((method.case for method in methods), pairs, strict=True)
    ]
    start = (float(pairs[0][0][0]), float(pairs[0][1][0]), "start")
    return [*curves[:-1], replace(curves[-1], marks=[start])]


def _pendulum(experiment: Experiment, angles: Array) -> list[Curve]:
    """Paths of both masses of a double pendulum, with its rods at the start and at the end."""
    lengths = np.array(experiment.problem_specification.get("lengths", (1.0, 1.0)), dtype=float)
    x = np.cumsum(lengths * np.sin(angles), axis=1)
    y = np.cumsum(-lengths * np.cos(angles), axis=1)
    curves = [
        Curve(
            x=x[:, k], y=y[:, k], label=label, look=Look(colour=COLOURS[1 - k], width=1.4 - k / 2)
        )
        for k, label in enumerate(("first mass", "second mass"))
    ]
    for when, label, colour in ((0, "start", GREY), (-1, "end", INK)):
        rods = np.array([np.append(0.0, x[when]), np.append(0.0, y[when])])
        look = Look(colour=colour, marker="o", width=1.6)
        curves.append(Curve(x=rods[0], y=rods[1], label=label, look=look))
    return curves


def waterfall_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the most accurate run as lines one above the other.

    For chains, frames and structures a line over time for every coordinate (up to 24), at its
    number; for a string its shapes, at their times. Below a shaken frame is the motion of its
    ground.
    """
    kind, units = experiment.problem.kind, experiment.units
    if kind not in _WATERFALLS:
        raise NothingToDraw(f"it is made for {', '.join(_WATERFALLS)}")
    time, position = drawn_motion(most_accurate(select_runs(finished)))
    if kind == "string":
        return figure([[_string(experiment, time, position)]], waterfall, height=3.4)
    count = position.shape[1]
    drawn = np.unique(np.linspace(0, count - 1, min(count, _MOST_LINES)).round().astype(int))
    curves = [Curve(x=time, y=position[:, k], by=float(k + 1)) for k in drawn]
    x, unit = time_label(experiment), units.get("length", "")
    lifted = Panel(curves=curves, x=x, y=_WATERFALLS[kind], unit=unit)
    problem = experiment.problem
    if "ground_acceleration" not in experiment.problem_specification:
        return figure([[lifted]], waterfall, height=3.4)
    # the force on the first storey of a shaken frame is its mass times that of the ground
    if not isinstance(problem, Problem) or problem.scene.forcing is None:
        return figure([[lifted]], waterfall, height=3.4)
    ground = -problem.scene.forcing(time)[:, 0] / problem.scene.inertia.mass[0, 0]
    y = with_unit("ground acceleration", units, "acceleration")
    shaken = Panel(curves=[Curve(x=time, y=ground, look=BLACK)], x=x, y=y, levels=[0.0])
    return figure([[lifted], [shaken]], [waterfall, lines], height=(3.2, 1.0), sharex=True)


def _string(experiment: Experiment, time: Array, position: Array) -> Panel:
    """Shapes of a string at equally spaced times."""
    length = float(experiment.problem_specification.get("length", 1.0))
    place = np.linspace(0.0, length, _POINTS)
    modes = np.sin(np.outer(np.arange(1, position.shape[1] + 1), np.pi * place / length))
    picked = np.searchsorted(time, np.linspace(time[0], time[-1], _SHAPES))
    return Panel(
        curves=[Curve(x=place, y=position[k] @ modes, by=float(time[k])) for k in picked],
        x=with_unit("place $s$", experiment.units, "length"),
        y=time_label(experiment),
        unit=experiment.units.get("length", ""),
    )
