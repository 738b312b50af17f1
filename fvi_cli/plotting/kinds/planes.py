"""Planes of two values of a motion: portraits, paths, sections, loops; and shapes of chains."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.trajectory import Occurrences
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines, waterfall
from fvi_cli.plotting.kinds.motions import (
    MOST_COMPONENTS,
    NO_MOMENTUM,
    NO_QUANTITIES,
    drawn_motion,
    drawn_velocity,
    has_quantities,
    observed_of,
    quantity_label,
    within_steps,
)
from fvi_cli.plotting.kinds.runs import Shown, select
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import BLACK, COLOURS, GREY, INK, Look, cycled, dots
from fvi_cli.plotting.words import coordinates_of, position_label, time_label, velocity_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.loops import deformation_against, forces_of, last_loop

_MANY = 200  # from this number on points are small
_MOST_LINES = 24  # of a chain or frame with more masses every n-th is drawn
_SHAPES, _POINTS = 17, 201  # times at which the shape of a string is drawn, and points of each
_WATERFALLS = {"chain": "mass", "frame": "storey", "string": "", "structure": "coordinate"}
_CROSS = Look(colour=INK, marker="+", width=0, size=6.0)


def _planes(panels: Sequence[Panel], **titles: Any) -> Figure:
    """A figure of planes: one in a column, several in rows of two."""
    return figure(panels, lines, columns=min(len(panels), 2), height=2.5, **titles)


def phase_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw velocity against position of every run, a panel for every component (up to 4)."""
    shown = select(
        experiment,
        finished,
        lambda one: one.trajectory.steps or one.trajectory.momentum is not None,
        NO_MOMENTUM,
    )
    motions = {one: (drawn_motion(one)[1], drawn_velocity(one)) for one in shown.runs}
    dimension, panels = shown.best.trajectory.position.shape[1], []
    for k, name in enumerate(coordinates_of(experiment, dimension)[:MOST_COMPONENTS]):
        x, y = position_label(experiment, name), velocity_label(experiment, name)
        title = "" if k else shown.title
        panels.append(Panel(curves=_paths(shown, motions, k, k), x=x, y=y, title=title))
    return _planes(panels, **shown.titles)


def path_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the path in the plane of the first two coordinates.

    For a double pendulum, whose coordinates are angles, in the plane in which it swings.
    """
    shown, kind = select(experiment, finished), experiment.problem.kind
    dimension = shown.best.trajectory.position.shape[1]
    if dimension == 1:
        raise NothingToDraw("the scene has one coordinate only")
    labels = [position_label(experiment, one) for one in coordinates_of(experiment, dimension)[:2]]
    if kind == "double-pendulum":
        curves = _pendulum(experiment, drawn_motion(shown.best)[1])
        words = ("horizontal position", "vertical position")
        labels = [with_unit(label, experiment.units, "length") for label in words]
    else:
        motions = {one: (drawn_motion(one)[1],) * 2 for one in shown.runs}
        curves = _paths(shown, motions, 0, 1)
    if kind == "kepler":
        centre = (0.0, 0.0, "centre")
        curves.append(Curve(x=np.zeros(1), y=np.zeros(1), look=_CROSS, marks=[centre]))
    panel = Panel(curves=curves, x=labels[0], y=labels[1], title=shown.title, is_equal=True)
    return _planes([panel], **shown.titles)


def _paths(
    shown: Shown, motions: Mapping[FinishedRun, tuple[Array, Array]], first: int, second: int
) -> list[Curve]:
    """Thin curves of a component of each of two motions, with start and end of the last."""
    curves = shown.curves(lambda one: (motions[one][0][:, first], motions[one][1][:, second]))
    thin = [replace(one, look=one.look and replace(one.look, width=0.9)) for one in curves]
    last = thin[-1]
    marks = [(float(last.x[k]), float(last.y[k]), word) for k, word in ((0, "start"), (-1, "end"))]
    return [*thin[:-1], replace(last, marks=marks, label=last.label * (len(thin) > 1))]


def _pendulum(experiment: Experiment, angles: Array) -> list[Curve]:
    """Paths of both masses of a double pendulum, and its rods at the start and at the end."""
    lengths = np.array(experiment.problem_specification.get("lengths", (1.0, 1.0)), dtype=float)
    x = np.cumsum(lengths * np.sin(angles), axis=1)
    y = np.cumsum(-lengths * np.cos(angles), axis=1)
    looks = (Look(colour=COLOURS[1], width=1.4), Look(colour=COLOURS[0], width=0.9))
    curves = []
    for k, mass, word, colour in ((0, "first", "start", GREY), (1, "second", "end", INK)):
        curves.append(Curve(x=x[:, k], y=y[:, k], label=f"{mass} mass", look=looks[k]))
        rods, marks = np.array([[0.0, *x[-k]], [0.0, *y[-k]]]), [(x[-k, 1], y[-k, 1], word)]
        look = Look(colour=colour, marker="o", width=1.6, size=4.0)
        curves.append(Curve(x=rods[0], y=rods[1], look=look, marks=marks))
    return curves


def occurrences_of(
    item: FinishedRun, name: str | None = None, after: float = 0.0
) -> Mapping[str, Occurrences]:
    """The events of a run (of one name) that happened, from a time on."""
    found = {}
    for event, one in observed_of(item).events.items():
        late = one.time >= after
        if name in (None, event) and late.any():
            found[event] = Occurrences(**{key: values[late] for key, values in vars(one).items()})
    return found


def section_figure(
    experiment: Experiment,
    finished: Sequence[FinishedRun],
    name: str | None = None,
    after: float = 0.0,
) -> Figure:
    """Draw velocity against position at every event, a panel for every coordinate (up to 4).

    Where colours show a swept number, the left panel has the position against it.
    """
    when = f" after t = {after:g}" if after else ""
    reason = f"the event {name} did not happen{when}" if name else "no event happened"
    shown = select(experiment, finished, lambda one: occurrences_of(one, name, after), reason)
    points = [
        (one, event, shown.words[item])
        for item in shown.runs
        for event, one in occurrences_of(item, name, after).items()
    ]
    size = 1.5 if sum(one.time.size for one, *_ in points) > _MANY else 3.4
    panels = []
    for k, coordinate in enumerate(coordinates_of(experiment)[:MOST_COMPONENTS]):
        curves = [
            Curve(
                x=one.position[:, k],
                y=one.velocity[:, k],
                look=dots(cycled(number).colour, size),
                label=event if len(shown.runs) == 1 else f"{event}, {words.get('label', '')}",
                by=words.get("by", math.nan),
            )
            for number, (one, event, words) in enumerate(points)
        ]
        x, y = position_label(experiment, coordinate), velocity_label(experiment, coordinate)
        panels.append(Panel(curves=curves, x=x, y=y))
    if "bar" not in shown.titles:
        return _planes(panels, **shown.titles)
    first = panels[0]
    against = [replace(one, x=np.full(one.x.size, one.by), y=one.x) for one in first.curves]
    return _planes([Panel(curves=against, x=shown.titles["bar"], y=first.x), first], **shown.titles)


def hysteresis_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw force against deformation, a panel for every force (up to 4) among the quantities.

    It shows the most accurate run with its last loop, or the members of a sweep.
    """
    if not (forces := forces_of(experiment)):
        raise NothingToDraw(
            "no quantity is the force of a damper; write quantities: {force: force_1}"
        )
    shown = select(experiment, finished, has_quantities, NO_QUANTITIES)
    best = within_steps(shown.best)
    panels = []
    for name in forces[:MOST_COMPONENTS]:
        if experiment.members:
            curves = shown.curves(functools.partial(deformation_against, name=name))
        else:
            curves = _loops(best.trajectory.time, *deformation_against(best, name))
        x = with_unit("deformation", experiment.units, "length")
        panels.append(Panel(curves=curves, x=x, y=quantity_label(experiment, name)))
    return _planes(panels, **shown.titles)


def _loops(time: Array, x: Array, y: Array) -> list[Curve]:
    """The whole motion, and above it the loop that the table of quantities reports."""
    curves = [Curve(x=x, y=y, label="whole motion", look=Look(colour="#9a9a9a", width=0.7))]
    if loop := last_loop(time, x, y):
        inside = time[(time > loop.begin) & (time < loop.end)]
        whole = np.array([loop.begin, *inside, loop.end])
        places = [np.interp(whole, time, values) for values in (x, y)]
        look = Look(colour=COLOURS[1], width=1.6)
        curves.append(Curve(x=places[0], y=places[1], label="last loop", look=look))
    return curves


def waterfall_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the most accurate run as lines one above the other.

    For chains, frames and structures a line over time for every coordinate (up to 24), at its
    number, above the acceleration of their ground; for a string its shapes, at their times.
    """
    problem, units = experiment.problem, experiment.units
    if problem.kind not in _WATERFALLS:
        raise NothingToDraw(f"it is made for {', '.join(_WATERFALLS)}")
    time, position = drawn_motion(select(experiment, finished).best)
    if problem.kind == "string":
        return figure([_string(experiment, time, position)], waterfall, height=3.4)
    count, x, scene = position.shape[1], time_label(experiment), problem.scene
    drawn = np.unique(np.linspace(0, count - 1, min(count, _MOST_LINES)).round().astype(int))
    curves = [Curve(x=time, y=position[:, k], by=float(k + 1)) for k in drawn]
    unit = units.get("length", "")
    panels = [Panel(curves=curves, x=x, y=_WATERFALLS[problem.kind], unit=unit)]
    is_shaken = "ground_acceleration" in experiment.problem_specification
    if is_shaken and scene is not None and scene.forcing is not None:
        # the force on the first storey is its mass times the acceleration of the ground
        ground = -scene.forcing(time)[:, 0] / scene.inertia.mass[0, 0]
        y = with_unit("ground acceleration", units, "acceleration")
        panels.append(Panel(curves=[Curve(x=time, y=ground, look=BLACK)], x=x, y=y, levels=[0.0]))
    return figure(panels, waterfall, height=(3.2, 1.0)[: len(panels)], sharex=True)


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
