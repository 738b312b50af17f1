"""Extents of quantities, and places at events, against a swept key; spectra; ensembles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.kinds.members import MOST_NAMED
from fvi_cli.plotting.kinds.planes import section_figure
from fvi_cli.plotting.kinds.quantities import observed_of, quantity_label
from fvi_cli.plotting.looks import Look, cycled
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.words import (
    coordinates_of,
    position_label,
    quantity_in_words,
    swept_keys_in_words,
    swept_label,
    time_label,
)
from fvi_cli.reports.kinds.ensembles import Ensemble, ensembles, members_at_equal_times
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.figure_settings import FigureSettings
from fvi_cli.studies.members import Member, value_in_words

_WORDS = {"peak": "peak of {}", "rms": "RMS of {}", "least": "least {}", "greatest": "greatest {}"}
_DECADES = 30.0  # swept numbers that span a larger factor have a logarithmic axis
OF_PERIOD = ("problem.mass", "problem.stiffness")
"""Keys that change the period; every line has fixed values of the other swept keys."""


def settings_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], settings: FigureSettings
) -> Figure:
    """Draw the figure of a mapping under ``figures``."""
    if settings.section is not None:
        return section_figure(experiment, events_of(finished, settings.section, settings.after))
    if settings.ensemble is not None:
        return ensemble_figure(experiment, finished, settings.ensemble)
    return against_figure(experiment, finished, settings)


def obstacle(finished: Sequence[FinishedRun], settings: FigureSettings) -> str:
    """Why the figure cannot be drawn; empty: it can."""
    if settings.ensemble is not None:
        equal = members_at_equal_times(finished)
        return "" if equal else "members have no times in common; give output: {step: 0.1}"
    name = settings.section or ("" if settings.extent[0] else settings.plot)
    seen = [observed_of(one).events for one in events_of(finished, name, settings.after)]
    if name and not any(one.time.size for events in seen for one in events.values()):
        when = f" after t = {settings.after:g}" if settings.after else ""
        return f"the event {name} did not happen{when}"
    return ""


def events_of(finished: Sequence[FinishedRun], name: str | None, after: float) -> list[FinishedRun]:
    """The runs with only the occurrences of one event after a time."""
    found = []
    for one in finished:
        observed = observed_of(one)
        events = {
            event: replace(
                seen,
                time=seen.time[seen.time >= after],
                position=seen.position[seen.time >= after],
                velocity=seen.velocity[seen.time >= after],
            )
            for event, seen in observed.events.items()
            if event == name
        }
        trajectory = replace(one.trajectory, observed=replace(observed, events=events))
        found.append(replace(one, trajectory=trajectory))
    return found


def against_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], settings: FigureSettings
) -> Figure:
    """Draw an extent of a quantity, or the places of an event, against a swept key.

    The other swept keys, and the designs, distinguish curves; a single number of many values
    colours them.
    """
    key = settings.against or ""
    runs = [one for one in finest_of_members(finished) if one.run.member is not None]
    lines_of: dict[str, list[FinishedRun]] = {}
    for one in sorted(runs, key=lambda one: _value(one, key)):
        lines_of.setdefault(_others(one, key), []).append(one)
    rest = [name for name in experiment.swept if name != key]
    numbers = [_number(own[0], rest) for own in lines_of.values()]
    is_coloured = len(lines_of) > MOST_NAMED and all(map(math.isfinite, numbers))
    which, quantity = settings.extent
    curves = []
    for index, (label, own) in enumerate(lines_of.items()):
        x, y = _extents(own, key, which, quantity) if which else _places(own, key, settings)
        look = cycled(index) if len(lines_of) > 1 else Look(colour=cycled(0).colour)
        size = 1.9 if x.size > 500 else 3.0
        if not which or x.size <= _DECADES:
            look = replace(look, marker="o", size=size, has_line=bool(which))
        by = numbers[index] if is_coloured else math.nan
        curves.append(Curve(x=x, y=y, label="" if is_coloured else label, look=look, by=by))
    swept = np.concatenate([curve.x for curve in curves])
    is_log = bool(which and swept.min() > 0 and swept.max() >= _DECADES * swept.min())
    if which:
        name = quantity_in_words(experiment, quantity)
        y_label = with_unit(_WORDS[which].format(name), experiment.units, quantity)
    else:
        y_label = position_label(experiment, coordinates_of(experiment)[0])
    panel = Panel(
        curves=curves,
        x=swept_label(experiment, key),
        y=y_label,
        title="" if which else f"at {settings.plot}",
        log="x" * is_log,
        ylim=(0.0, None) if which in ("peak", "rms") else None,
    )
    words = ", ".join(swept_label(experiment, name) for name in rest)
    return figure([[panel]], lines, height=2.4, heading=words, bar=words * is_coloured)


def _value(one: FinishedRun, key: str) -> float:
    return math.nan if one.run.member is None else float(one.run.member.values[key])


def _others(one: FinishedRun, key: str) -> str:
    """The design and the other swept values of a member in words."""
    member = one.run.member
    if member is None:
        return ""
    values = (value_in_words(value) for name, value in member.unnamed.items() if name != key)
    return ", ".join(filter(None, (member.name, *values)))


def _number(one: FinishedRun, rest: Sequence[str]) -> float:
    """The value of the only other key; nan where there is none, or several, or no number."""
    member = one.run.member
    value = member.values[rest[0]] if member is not None and len(rest) == 1 else None
    return float(value) if isinstance(value, int | float) else math.nan


def _extents(
    own: Sequence[FinishedRun], key: str, which: str, quantity: str
) -> tuple[Array, Array]:
    extents = [observed_of(run).extents.get(quantity) for run in own]
    y = [math.nan if seen is None else getattr(seen, which) for seen in extents]
    return np.array([_value(run, key) for run in own]), np.array(y)


def _places(own: Sequence[FinishedRun], key: str, settings: FigureSettings) -> tuple[Array, Array]:
    """The first coordinate at every occurrence of the event."""
    xs, ys = [np.zeros(0)], [np.zeros(0)]
    for run in events_of(own, settings.plot, settings.after):
        for seen in observed_of(run).events.values():
            xs.append(np.full(seen.time.size, _value(run, key)))
            ys.append(seen.position[:, 0])
    return np.concatenate(xs), np.concatenate(ys)


def response_spectrum_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    r"""Largest displacement, and :math:`\omega^2` times it, against the period without damping.

    There is a line for every combination of the other swept values.
    """
    others = [key for key in experiment.swept if key not in OF_PERIOD]
    found: dict[str, list[tuple[float, float]]] = {}
    for one in finest_of_members(finished):
        if (member := one.run.member) is not None:
            label = ", ".join(value_in_words(member.values[key]) for key in others)
            largest = float(np.abs(one.trajectory.position).max())
            found.setdefault(label, []).append((period(member), largest))
    points = {label: np.array(sorted(own)).T for label, own in found.items()}
    upper = [Curve(x=at, y=most, label=label) for label, (at, most) in points.items()]
    lower = [replace(one, y=(2 * math.pi / one.x) ** 2 * one.y) for one in upper]
    units = experiment.units
    words = (r"displacement $\max |x|$", r"pseudo-acceleration $(2\pi/T)^2 \max |x|$")
    rows = [
        [
            Panel(
                curves=curves,
                x=with_unit("period $T$ without damping", units, "time"),
                y=with_unit(label, units, quality),
                log="x",
                ylim=(0.0, None),
            )
        ]
        for curves, label, quality in zip(
            (upper, lower), words, ("length", "acceleration"), strict=True
        )
    ]
    heading = ", ".join(swept_label(experiment, key) for key in others)
    return figure(rows, lines, height=1.9, sharex=True, heading=heading)


def period(member: Member) -> float:
    r"""The period :math:`2 \pi \sqrt{m / k}` of a member."""
    scene = build_scene(member.specification)
    if scene.dimension != 1 or not isinstance(scene.potential, QuadraticPotential):
        raise ValueError("every member must be a linear oscillator of one degree of freedom")
    square = float(scene.potential.stiffness[0, 0]) / float(scene.inertia.mass[0, 0])
    if not square > 0:
        raise ValueError("every member needs a positive stiffness")
    return 2.0 * math.pi / math.sqrt(square)


def ensemble_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], names: Sequence[str]
) -> Figure:
    """Draw means with one standard deviation and the range of all members, a panel for each name.

    For designs with a sweep there is a mean for every design, and no range.
    """
    found = ensembles(finished, names)
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
    heading = f"{count} members: {swept_keys_in_words(experiment)}"
    height = 2.0 if len(names) == 1 else 1.45
    return figure(rows, lines, height=height, sharex=True, heading=heading)


def _mean(one: Ensemble, place: int) -> Curve:
    mean, deviation = one.mean, one.deviation
    bands = [("standard deviation", mean - deviation, mean + deviation)]
    if not one.design:
        bands.append(("range", one.values.min(axis=0), one.values.max(axis=0)))
    label = one.design or "mean"
    return Curve(x=one.time, y=mean, label=label, look=cycled(place), bands=bands)
