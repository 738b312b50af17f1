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
from fvi_cli.plotting.kinds.members import distinguish
from fvi_cli.plotting.kinds.planes import occurrences_of, section_figure
from fvi_cli.plotting.kinds.quantities import observed_of, quantity_label
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import cycled
from fvi_cli.plotting.words import coordinates_of, position_label, quantity_in_words, time_label
from fvi_cli.reports.kinds.ensembles import Ensemble, ensembles
from fvi_cli.reports.naming import key_label, with_unit
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.figure_settings import FigureSettings
from fvi_cli.studies.members import Member

_WORDS = {"peak": "peak of {}", "rms": "RMS of {}", "least": "least {}", "greatest": "greatest {}"}
_FEW = 30  # up to so many points of a curve have marks
_OF_PERIOD = ("problem.mass", "problem.stiffness")


def settings_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], settings: FigureSettings
) -> Figure:
    """Draw the figure of a mapping under ``figures``."""
    if settings.section is not None:
        return section_figure(experiment, finished, settings.section, settings.after)
    if settings.ensemble is not None:
        return _ensemble_figure(experiment, finished, settings.ensemble)
    return _against_figure(experiment, finished, settings)


def _against_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], settings: FigureSettings
) -> Figure:
    """Draw a number of a quantity, or the places of an event, against a swept key.

    The other swept keys, and the designs, distinguish curves.
    """
    key, (which, quantity) = settings.against or "", settings.extent
    found = distinguish(experiment.members, experiment.units, without=(key,))
    groups: dict[tuple[object, ...], list[tuple[float, FinishedRun]]] = {}
    for one in finest_of_members(finished):
        if one.run.member is not None:
            swept = float(one.run.member.values[key])
            groups.setdefault(tuple(found.of(one.run.member).values()), []).append((swept, one))
    curves = []
    for index, own in enumerate(groups.values()):
        own.sort(key=lambda pair: pair[0])
        x, y = _extents(own, which, quantity) if which else _places(own, settings)
        look = cycled(index if len(groups) > 1 else 0)
        if not which or x.size <= _FEW:
            size = 1.9 if x.size > 500 else 3.0
            look = replace(look, marker="o", size=size, width=None if which else 0)
        curves.append(Curve(x=x, y=y, look=look, **found.of(own[0][1].run.member)))
    numbers = np.concatenate([curve.x for curve in curves])
    if not numbers.size:
        when = f" after t = {settings.after:g}" if settings.after else ""
        raise NothingToDraw(f"the event {settings.plot} did not happen{when}")
    y_label = position_label(experiment, coordinates_of(experiment)[0])
    if which:
        name = quantity_in_words(experiment, quantity)
        y_label = with_unit(_WORDS[which].format(name), experiment.units, quantity)
    panel = Panel(
        curves=curves,
        x=key_label(key, experiment.units, experiment.members[0].specification, experiment.swept),
        y=y_label,
        title="" if which else f"at {settings.plot}",
        log="x" * bool(which and numbers.max() >= DECADES * numbers.min() > 0),
        ylim=(0.0, None) if which in ("peak", "rms") else None,
    )
    return figure([[panel]], lines, height=2.4, **(found.titles if len(groups) > 1 else {}))


def _extents(
    own: Sequence[tuple[float, FinishedRun]], which: str, quantity: str
) -> tuple[Array, Array]:
    extents = [observed_of(run).extents.get(quantity) for _, run in own]
    y = [math.nan if seen is None else getattr(seen, which) for seen in extents]
    return np.array([swept for swept, _ in own]), np.array(y)


def _places(
    own: Sequence[tuple[float, FinishedRun]], settings: FigureSettings
) -> tuple[Array, Array]:
    """The first coordinate at every occurrence of the event."""
    xs, ys = [np.zeros(0)], [np.zeros(0)]
    for swept, run in own:
        for seen in occurrences_of(run, settings.plot, settings.after).values():
            xs.append(np.full(seen.time.size, swept))
            ys.append(seen.position[:, 0])
    return np.concatenate(xs), np.concatenate(ys)


def response_spectrum_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    r"""Largest displacement, and :math:`\omega^2` times it, against the period without damping.

    There is a line for every combination of the other swept values.
    """
    if not set(_OF_PERIOD).intersection(experiment.swept):
        raise NothingToDraw(
            "it is drawn of a sweep over stiffness or mass; write "
            "sweep: {problem.stiffness: {from: 1, to: 100, number: 30, spacing: log}}"
        )
    found = distinguish(experiment.members, experiment.units, without=_OF_PERIOD)
    groups: dict[tuple[object, ...], list[tuple[float, float]]] = {}
    members = {}
    for one in finest_of_members(finished):
        if (member := one.run.member) is not None and one.trajectory.time.size > 1:
            key = tuple(found.of(member).values())
            members[key] = member
            largest = float(np.abs(one.trajectory.position).max())
            groups.setdefault(key, []).append((_period(member), largest))
    upper = []
    for key, pairs in groups.items():
        periods, largest = np.array(sorted(pairs)).T
        upper.append(Curve(x=periods, y=largest, **found.of(members[key])))
    lower = [replace(one, y=(2 * math.pi / one.x) ** 2 * one.y) for one in upper]
    units = experiment.units
    x = with_unit("period $T$ without damping", units, "time")
    words = {
        with_unit(r"displacement $\max|x|$", units, "length"): upper,
        with_unit(r"pseudo-acceleration $(2\pi/T)^2\max|x|$", units, "acceleration"): lower,
    }
    rows = [
        [Panel(curves=curves, x=x, y=y, log="x", ylim=(0.0, None))] for y, curves in words.items()
    ]
    return figure(rows, lines, height=1.9, sharex=True, **found.titles)


def _period(member: Member) -> float:
    r"""The period :math:`2 \pi \sqrt{m / k}` of a member."""
    scene = build_scene(member.specification)
    if scene.dimension != 1 or not isinstance(scene.potential, QuadraticPotential):
        raise NothingToDraw("every member must be a linear oscillator of one degree of freedom")
    square = float(scene.potential.stiffness[0, 0]) / float(scene.inertia.mass[0, 0])
    if not square > 0:
        raise NothingToDraw("every member needs a positive stiffness")
    return 2.0 * math.pi / math.sqrt(square)


def _ensemble_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], names: Sequence[str]
) -> Figure:
    """Draw means with one standard deviation and the range of all members, a panel for each name.

    For designs with a sweep there is a mean for every design, and no range.
    """
    found = ensembles(finished, names)
    if not found:
        raise NothingToDraw("members have no times in common; give output: {step: 0.1}")
    rows = [
        [
            Panel(
                curves=[_mean(one, k) for k, one in enumerate(o for o in found if o.name == name)],
                x=time_label(experiment),
                y=position_label(experiment, name)
                if name in coordinates_of(experiment)
                else quantity_label(experiment, name),
            )
        ]
        for name in names
    ]
    count = sum(len(one.values) for one in found if one.name == names[0])
    keys = distinguish(experiment.members, experiment.units).keys
    height = 2.0 if len(names) == 1 else 1.45
    return figure(rows, lines, height=height, sharex=True, heading=f"{count} members: {keys}")


def _mean(one: Ensemble, place: int) -> Curve:
    mean, deviation = one.mean, one.deviation
    bands = [("standard deviation", mean - deviation, mean + deviation)]
    if not one.design:
        bands.append(("range", one.values.min(axis=0), one.values.max(axis=0)))
    label = one.design or "mean"
    return Curve(x=one.time, y=mean, label=label, look=cycled(place), bands=bands)
