"""Where a scene goes: phase portraits, paths in the plane, and shapes of chains and strings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines, waterfall
from fvi_cli.plotting.kinds.motions import (
    MOST_COMPONENTS,
    drawn_motion,
    drawn_velocity,
    most_accurate,
    select_runs,
)
from fvi_cli.plotting.looks import BLACK, Look, method_looks, method_names
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import COLOURS, GREY, INK
from fvi_cli.plotting.words import (
    coordinates_of,
    position_label,
    time_label,
    velocity_label,
)
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun

_MOST_LINES = 24  # of a chain or frame with more masses every n-th is drawn
_SHAPES, _POINTS = 17, 201  # times at which the shape of a string is drawn, and points of each
WATERFALL_KINDS = {"chain": "mass", "frame": "storey", "string": "", "structure": "coordinate"}
_CROSS = Look(colour=INK, marker="+", has_line=False, size=6.0)


def has_velocity(item: FinishedRun) -> bool:
    """Whether velocities follow from what a run stores."""
    return item.trajectory.steps is not None or item.trajectory.momentum is not None


def phase_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw velocity against position of every method, a panel for every component (up to 4)."""
    shown = select_runs(finished, has_velocity)
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


def planes(panels: Sequence[Panel], **options: Any) -> Figure:
    """A figure of planes: one in a column, several in rows of two."""
    if len(panels) == 1:
        return figure([panels], lines, height=2.5, **options)
    padded = [*panels, *[None] * (len(panels) % 2)]
    rows = [padded[k : k + 2] for k in range(0, len(padded), 2)]
    return figure(rows, lines, height=2.4, is_wide=True, **options)


def path_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the path in the plane of the first two coordinates.

    For a double pendulum, whose coordinates are angles, in the plane in which it swings.
    """
    shown = select_runs(finished)
    if experiment.problem.kind == "double-pendulum":
        curves = _pendulum(experiment, drawn_motion(most_accurate(shown))[1])
        labels = [
            with_unit(label, experiment.units, "length")
            for label in ("horizontal position", "vertical position")
        ]
    else:
        curves = _paths(shown, [tuple(drawn_motion(one)[1][:, :2].T) for one in shown])
        names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])
        labels = [position_label(experiment, name) for name in names[:2]]
    if fixed := {"kepler": "centre", "double-pendulum": "pivot"}.get(experiment.problem.kind):
        curves.append(Curve(x=np.zeros(1), y=np.zeros(1), label=fixed, look=_CROSS))
    return planes([Panel(curves=curves, x=labels[0], y=labels[1], is_equal=True)])


def _paths(shown: Sequence[FinishedRun], pairs: Sequence[tuple[Array, ...]]) -> list[Curve]:
    """One curve for every run, and a point at the start."""
    methods = [item.run.method for item in shown]
    looks, names, curves = method_looks(methods), method_names(methods), []
    for item, (x, y) in zip(shown, pairs, strict=True):
        look = replace(looks[item.run.method.case], marker="", width=0.9)
        finite = np.isfinite(x) & np.isfinite(y)
        label = names[item.run.method.case]
        curves.append(Curve(x=x[finite], y=y[finite], label=label, look=look))
    start = (float(pairs[0][0][0]), float(pairs[0][1][0]), "start")
    return [*curves[:-1], replace(curves[-1], marks=[start])]


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
            (inner, "first mass", COLOURS[1], 1.4),
            (outer, "second mass", COLOURS[0], 0.9),
        )
    ]
    for when, label, colour in ((0, "start", GREY), (-1, "end", INK)):
        rods = np.stack([np.zeros(2), inner[:, when], outer[:, when]]).T
        look = Look(colour=colour, marker="o", width=1.6)
        curves.append(Curve(x=rods[0], y=rods[1], label=label, look=look))
    return curves


def waterfall_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the most accurate run as lines one above the other.

    For chains, frames and structures a line over time for every coordinate (up to 24), at its
    number; for a string its shapes, at their times. Below a shaken frame is the motion of its
    ground.
    """
    best, unit = most_accurate(select_runs(finished)), experiment.units.get("length", "")
    time, position = drawn_motion(best)
    if experiment.problem.kind == "string":
        return figure([[_string(experiment, time, position)]], waterfall, height=3.4)
    count = position.shape[1]
    drawn = np.unique(np.linspace(0, count - 1, min(count, _MOST_LINES)).round().astype(int))
    lifted = Panel(
        curves=[Curve(x=time, y=position[:, k], by=float(k + 1)) for k in drawn],
        x=time_label(experiment),
        y=WATERFALL_KINDS[experiment.problem.kind],
        unit=unit,
        is_numbered=True,
    )
    ground = _ground_acceleration(experiment, time)
    if ground is None:
        return figure([[lifted]], waterfall, height=3.4)
    words = with_unit("ground acceleration", experiment.units, "acceleration")
    shaken = Panel(curves=[Curve(x=time, y=ground, look=BLACK)], x=lifted.x, y=words, levels=[0.0])
    rows = [[lifted], [shaken]]
    return figure(rows, [waterfall, lines], height=(3.2, 1.0), sharex=True)


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


def _ground_acceleration(experiment: Experiment, time: Array) -> Array | None:
    """The acceleration of a shaken ground, from the force on the first storey; else None."""
    problem = experiment.problem
    if "ground_acceleration" not in experiment.problem_specification:
        return None
    if not isinstance(problem, Problem) or problem.scene.forcing is None:
        return None
    force = problem.scene.forcing(time)[:, 0]
    return np.asarray(-force / problem.scene.inertia.mass[0, 0])
