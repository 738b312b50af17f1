"""Numbers of quantities, and places at events, against a swept key; spectra; ensembles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import DECADES, figure, lines
from fvi_cli.plotting.kinds.motions import observed_of, quantity_label
from fvi_cli.plotting.kinds.planes import occurrences_of
from fvi_cli.plotting.kinds.runs import distinguish, members_apart
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import cycled, dots
from fvi_cli.plotting.words import coordinates_of, position_label, time_label
from fvi_cli.reports.kinds.ensembles import ensembles
from fvi_cli.reports.naming import key_label, with_unit
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.settings import FigureSettings

_WORDS = {"peak": "peak of {}", "rms": "RMS of {}", "least": "least {}", "greatest": "greatest {}"}
_OF_PERIOD = ("problem.mass", "problem.stiffness")


def against_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], settings: FigureSettings
) -> Figure:
    """Draw a number of a quantity, or the places of an event, against a swept key.

    The other swept keys, and the designs, distinguish curves.
    """
    key, (which, quantity) = settings.against or "", settings.extent
    groups = members_apart(finest_of_members(finished), without=(key,))
    members = [own[0].run.member for own in groups]
    words, titles = distinguish(members, experiment.units, without=(key,))
    curves = []
    for index, own in enumerate(groups):
        x, y = _extents(own, key, which, quantity) if which else _places(own, key, settings)
        dot = dots(cycled(index).colour, 1.9 if x.size > 500 else 3.0)
        look = cycled(index) if which else dot
        curves.append(Curve(x=x, y=y, **{"look": look, **words[index]}))
    swept = np.concatenate([curve.x for curve in curves])
    if not swept.size:
        when = f" after t = {settings.after:g}" if settings.after else ""
        raise NothingToDraw(f"the event {settings.plot} did not happen{when}")
    y_label = position_label(experiment, coordinates_of(experiment)[0])
    if which:
        words_of = _WORDS[which].format(quantity.replace("_", " "))
        y_label = with_unit(words_of, experiment.units, quantity)
    panel = Panel(
        curves=curves,
        x=key_label(key, experiment.units, experiment.members[0].specification, experiment.swept),
        y=y_label,
        title="" if which else f"at {settings.plot}",
        log="x" * bool(which and swept.max() >= DECADES * swept.min() > 0),
        ylim=(0.0, None) if which in ("peak", "rms") else None,
    )
    return figure([panel], lines, height=2.4, **(titles if len(curves) > 1 else {}))


def _swept(one: FinishedRun, key: str) -> float:
    return math.nan if one.run.member is None else float(one.run.member.values[key])


def _extents(
    own: Sequence[FinishedRun], key: str, which: str, quantity: str
) -> tuple[Array, Array]:
    having = [(_swept(one, key), observed_of(one).extents.get(quantity)) for one in own]
    pairs = sorted((swept, getattr(seen, which)) for swept, seen in having if seen is not None)
    x, y = np.array(pairs).reshape(-1, 2).T
    return x, y


def _places(own: Sequence[FinishedRun], key: str, settings: FigureSettings) -> tuple[Array, Array]:
    """The first coordinate at every occurrence of the event."""
    xs, ys = [np.zeros(0)], [np.zeros(0)]
    for one in own:
        for seen in occurrences_of(one, settings.plot, settings.after).values():
            xs.append(np.full(seen.time.size, _swept(one, key)))
            ys.append(seen.position[:, 0])
    return np.concatenate(xs), np.concatenate(ys)


def spectrum_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    r"""Largest displacement, and :math:`\omega^2` times it, against the period without damping.

    There is a line for every combination of the other swept values.
    """
    if not set(_OF_PERIOD).intersection(experiment.swept):
        raise NothingToDraw(
            "it is drawn of a sweep over stiffness or mass; write "
            "sweep: {problem.stiffness: {from: 1, to: 100, number: 30, spacing: log}}"
        )
    moving = [one for one in finest_of_members(finished) if one.trajectory.time.size > 1]
    groups = members_apart(moving, without=_OF_PERIOD)
    members = [own[0].run.member for own in groups]
    words, titles = distinguish(members, experiment.units, without=_OF_PERIOD)
    upper = []
    for own, known in zip(groups, words, strict=True):
        pairs = sorted((_period(one), np.abs(one.trajectory.position).max()) for one in own)
        period, largest = np.array(pairs).T
        upper.append(Curve(x=period, y=largest, **known))
    lower = [replace(one, y=(2 * math.pi / one.x) ** 2 * one.y) for one in upper]
    units = experiment.units
    rows = {
        with_unit(r"displacement $\max|x|$", units, "length"): upper,
        with_unit(r"pseudo-acceleration $(2\pi/T)^2\max|x|$", units, "acceleration"): lower,
    }
    x = with_unit("period $T$ without damping", units, "time")
    panels = [
        Panel(curves=curves, x=x, y=y, log="x", ylim=(0.0, None)) for y, curves in rows.items()
    ]
    return figure(panels, lines, height=1.9, sharex=True, **titles)


def _period(one: FinishedRun) -> float:
    r"""The period :math:`2 \pi \sqrt{m / k}` of a member."""
    scene = build_scene(one.run.problem_specification)
    if scene.dimension == 1 and isinstance(scene.potential, QuadraticPotential):
        stiffness, mass = scene.potential.stiffness[0, 0], scene.inertia.mass[0, 0]
        if stiffness > 0:
            return 2.0 * math.pi * math.sqrt(mass / stiffness)
    raise NothingToDraw("every member must be a linear oscillator of one degree of freedom")


def ensemble_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], names: Sequence[str]
) -> Figure:
    """Draw means with one standard deviation and the range of all members, a panel for each name.

    For designs with a sweep there is a mean for every design, and no range.
    """
    found = ensembles(finished, names)
    if not found:
        raise NothingToDraw("members have no times in common; give output: {step: 0.1}")
    panels = []
    for name in names:
        curves = []
        for place, one in enumerate(one for one in found if one.name == name):
            low, high = one.mean - one.deviation, one.mean + one.deviation
            bands = [("standard deviation", low, high)]
            if not one.design:
                bands.append(("range", one.values.min(axis=0), one.values.max(axis=0)))
            label, look = one.design or "mean", cycled(place)
            curves.append(Curve(x=one.time, y=one.mean, label=label, look=look, bands=bands))
        label = quantity_label(experiment, name)
        if name in coordinates_of(experiment):
            label = position_label(experiment, name)
        panels.append(Panel(curves=curves, x=time_label(experiment), y=label))
    count = sum(len(one.values) for one in found if one.name == names[0])
    height, heading = 2.0 if len(names) == 1 else 1.45, f"{count} members"
    return figure(panels, lines, height=height, sharex=True, heading=heading)
