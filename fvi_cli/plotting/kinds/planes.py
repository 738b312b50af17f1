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
from fvi_cli.plotting.style import BLACK, COLOURS, INK, Look, cycled, dots
from fvi_cli.plotting.words import coordinates_of, position_label, time_label, velocity_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.loops import deformation_against, forces_of, loops_of

_MANY = 200  # from this number on points are small
_FIXED = {"kepler": "centre", "double-pendulum": "pivot"}
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
    dimension = shown.best.trajectory.position.shape[1]
    panels = [
        Panel(
            curves=_paths(shown, motions, k, k),
            x=position_label(experiment, name),
            y=velocity_label(experiment, name),
        )
        for k, name in enumerate(coordinates_of(experiment, dimension)[:MOST_COMPONENTS])
    ]
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
    if kind in _FIXED:
        curves.append(Curve(x=np.zeros(1), y=np.zeros(1), label=_FIXED[kind], look=_CROSS))
    return _planes([Panel(curves=curves, x=labels[0], y=labels[1], is_equal=True)], **shown.titles)


def _paths(
    shown: Shown, motions: Mapping[FinishedRun, tuple[Array, Array]], first: int, second: int
) -> list[Curve]:
    """Thin curves of a component of each of two motions, and a point where the last one starts."""
    curves = shown.curves(lambda one: (motions[one][0][:, first], motions[one][1][:, second]))
    thin = [replace(one, look=one.look and replace(one.look, width=0.9)) for one in curves]
    last = thin[-1]
    return [*thin[:-1], replace(last, marks=[(float(last.x[0]), float(last.y[0]), "start")])]


def _pendulum(experiment: Experiment, angles: Array) -> list[Curve]:
    """Paths of both masses of a double pendulum."""
    lengths = np.array(experiment.problem_specification.get("lengths", (1.0, 1.0)), dtype=float)
    x = np.cumsum(lengths * np.sin(angles), axis=1)
    y = np.cumsum(-lengths * np.cos(angles), axis=1)
    looks = (Look(colour=COLOURS[1], width=1.4), Look(colour=COLOURS[0], width=0.9))
    return [
        Curve(x=x[:, k], y=y[:, k], label=label, look=looks[k])
        for k, label in enumerate(("first mass", "second mass"))
    ]


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
    size = 1.9 if sum(one.time.size for one, *_ in points) > _MANY else 3.4
    is_plain = len(shown.runs) == 1
    panels = []
    for k, coordinate in enumerate(coordinates_of(experiment)[:MOST_COMPONENTS]):
        curves = [
            Curve(
                x=one.position[:, k],
                y=one.velocity[:, k],
                look=dots(cycled(number).colour, size),
                label=event if is_plain else f"{event}, {words.get('label', '')}",
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

    It shows the most accurate run with its loops, or the members of a sweep.
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
    """The whole motion, and above it the loops that the table of quantities reports."""
    curves = [Curve(x=x, y=y, label="whole motion", look=Look(colour="#9a9a9a", width=0.7))]
    for place, (word, loop) in enumerate(loops_of(time, x, y).items()):
        inside = time[(time > loop.begin) & (time < loop.end)]
        whole = np.array([loop.begin, *inside, loop.end])
        look = Look(colour=COLOURS[1 - place], width=1.6)
        places = [np.interp(whole, time, values) for values in (x, y)]
        curves.append(Curve(x=places[0], y=places[1], label=f"{word} loop", look=look))
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
