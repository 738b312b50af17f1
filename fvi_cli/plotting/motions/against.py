"""Extents of quantities, and places at events, against a swept key or the period of members."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.motions.ensemble import ensemble_figure
from fvi_cli.plotting.motions.section import section_figure
from fvi_cli.plotting.motions.time_series import observed_of
from fvi_cli.plotting.panels import MOST_LINES, over_time, plane
from fvi_cli.plotting.style import COLOURS, INK, LINE_STYLES, MARKERS
from fvi_cli.plotting.words import (
    coordinates_of,
    quantity_in_words,
    swept_label,
    typeset_name,
)
from fvi_cli.reports.kinds.ensembles import members_at_equal_times
from fvi_cli.reports.naming import DESIGN, key_label, with_unit
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.figure_settings import FigureSettings
from fvi_cli.studies.members import Member, value_in_words

_WORDS = {"peak": "peak of {}", "rms": "RMS of {}", "least": "least {}", "greatest": "greatest {}"}
_DECADES = 30.0
"""Swept numbers that span a larger factor have a logarithmic axis."""


@dataclass(frozen=True, kw_only=True)
class _Series:
    """Members that differ only in the key on the axis."""

    label: str
    number: float
    place: int
    members: Sequence[FinishedRun]


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
    if name and not any(
        observed_of(one).events[name].time.size
        for one in events_of(finished, name, settings.after)
        if name in observed_of(one).events
    ):
        when = f" after t = {settings.after:g}" if settings.after else ""
        return f"the event {name} did not happen{when}"
    return ""


def against_figure(
    experiment: Experiment, finished: Sequence[FinishedRun], settings: FigureSettings
) -> Figure:
    """Draw an extent of a quantity, or the places of an event, against a swept key.

    A second swept key, or the designs, distinguish curves; a third one colours them.
    """
    key = settings.against or ""
    runs = [one for one in finest_of_members(finished) if one.run.member is not None]
    series, names, bar = _series(runs, key, experiment.units)
    which, quantity = settings.extent
    x = swept_label(experiment, key)
    if which:
        label = _WORDS[which].format(quantity_in_words(experiment, quantity))
        panel = Panel(
            curves=[_extent_curve(one, key, which, quantity, bar) for one in series],
            y=with_unit(label, experiment.units, quantity),
            height=2.4,
        )
        swept = np.concatenate([curve.x for curve in panel.curves])
        is_wide = bool(swept.min() > 0 and swept.max() >= _DECADES * swept.min())
        return over_time(
            [panel],
            x=x,
            logarithmic=is_wide,
            from_zero=which in ("peak", "rms"),
            title=names,
            bar=bar,
        )
    name = coordinates_of(experiment)[0]
    words = f"{with_unit(typeset_name(name), experiment.units, name, 'length')} at {settings.plot}"
    curves = [_dots(one, key, settings, len(series), bar) for one in series]
    return plane([Panel(curves=curves, x=x, y=words, height=2.8)], title=names, bar=bar)


def _value(member: Member | None, key: str) -> float:
    return math.nan if member is None else float(member.values[key])


def _series(
    runs: Sequence[FinishedRun], key: str, units: Mapping[str, str]
) -> tuple[list[_Series], str, str]:
    """Series of members that differ only in `key`; keys of their names; name of the colour bar."""
    found: dict[str, list[FinishedRun]] = {}
    others: dict[str, dict[str, object]] = {}
    for one in runs:
        member = one.run.member
        if member is None:
            continue
        own: dict[str, object] = {DESIGN: member.name} if member.name else {}
        own |= {name: value for name, value in member.unnamed.items() if name != key}
        found.setdefault(repr(own), []).append(one)
        others[repr(own)] = own
    varied = [
        name
        for name in (next(iter(others.values())) if others else ())
        if len({repr(own[name]) for own in others.values()}) > 1
    ]
    bar = _bar(varied, others)
    labels = [name for name in varied if name != bar]
    places = list(dict.fromkeys(_label(own, labels) for own in others.values()))
    series = [
        _Series(
            label=_label(own, labels),
            number=float(str(own[bar])) if bar else math.nan,
            place=places.index(_label(own, labels)),
            members=sorted(found[text], key=lambda one: _value(one.run.member, key)),
        )
        for text, own in others.items()
    ]
    titles = [name for name in labels if name != DESIGN]
    words = ", ".join(key_label(title, units) for title in titles)
    return series, words, key_label(bar, units) if bar else ""


def _bar(varied: Sequence[str], others: Mapping[str, Mapping[str, object]]) -> str:
    """The key that colours show: the last of several, or a single one with too many values."""
    numbers = [
        name
        for name in varied
        if all(isinstance(own[name], int | float) for own in others.values())
    ]
    is_many = len(others) > MOST_LINES
    return numbers[-1] if numbers and (len(varied) > 1 or is_many) else ""


def _label(own: Mapping[str, object], names: Sequence[str]) -> str:
    return ", ".join(value_in_words(own[name]) for name in names)


def _extent_curve(one: _Series, key: str, which: str, quantity: str, bar: str) -> Curve:
    x = np.array([_value(run.run.member, key) for run in one.members])
    extents = [observed_of(run).extents.get(quantity) for run in one.members]
    y = np.array([math.nan if seen is None else getattr(seen, which) for seen in extents])
    dashes, marker = LINE_STYLES[one.place % len(LINE_STYLES)], MARKERS[one.place % len(MARKERS)]
    look = Look(
        colour=INK if bar else COLOURS[one.place % len(COLOURS)],
        dashes=dashes,
        marker=marker if x.size <= _DECADES else "",
        size=3.5,
    )
    return Curve(x=x, y=y, label=one.label, by=one.number, look=look)


def _dots(
    one: _Series,
    key: str,
    settings: FigureSettings,
    count: int,
    bar: str,
) -> Curve:
    """The first coordinate at every occurrence in one series, as dots."""
    xs: list[Array] = []
    ys: list[Array] = []
    for run in events_of(one.members, settings.plot, settings.after):
        seen = observed_of(run).events.get(settings.plot or "")
        if seen is not None:
            ys.append(seen.position[:, 0])
            xs.append(np.full(seen.time.size, _value(run.run.member, key)))
    x, y = np.concatenate(xs or [np.zeros(0)]), np.concatenate(ys or [np.zeros(0)])
    look = Look(
        colour=INK if bar or count == 1 else COLOURS[one.place % len(COLOURS)],
        marker="." if not bar else (".", *MARKERS)[one.place % len(MARKERS)],
        has_line=False,
        size=1.6 if x.size > 500 else 3.0,
    )
    return Curve(x=x, y=y, label=one.label, by=one.number, look=look)


OF_PERIOD = ("problem.mass", "problem.stiffness")
"""Keys that change the period; every line has fixed values of the other swept keys."""


def response_spectrum_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    r"""Largest displacement, and :math:`\omega^2` times it, against the period without damping.

    There is a line for every combination of the other swept values; the runs are those of the first
    method on the finest grid.
    """
    others = [key for key in experiment.swept if key not in OF_PERIOD]
    lines: dict[str, list[tuple[float, float]]] = {}
    for one in finest_of_members(finished):
        if (member := one.run.member) is not None:
            label = ", ".join(value_in_words(member.values[key]) for key in others)
            largest = float(np.abs(one.trajectory.position).max())
            lines.setdefault(label, []).append((period(member), largest))
    points = {label: np.array(sorted(own)).T for label, own in lines.items()}
    upper = [Curve(x=at, y=most, label=label) for label, (at, most) in points.items()]
    lower = [
        Curve(x=at, y=(2 * math.pi / at) ** 2 * most, label=label)
        for label, (at, most) in points.items()
    ]
    units = experiment.units
    acceleration = r"pseudo-acceleration $(2\pi/T)^2\, \max\, |x|$"
    return over_time(
        [
            Panel(curves=upper, y=with_unit(r"displacement $\max\, |x|$", units, "length")),
            Panel(curves=lower, y=with_unit(acceleration, units, "acceleration")),
        ],
        x=with_unit("period $T$ without damping", units, "time"),
        logarithmic=True,
        from_zero=True,
        title=", ".join(swept_label(experiment, key) for key in others),
    )


def period(member: Member) -> float:
    r"""The period :math:`2 \pi \sqrt{m / k}` of a member."""
    scene = build_scene(member.specification)
    if scene.dimension != 1 or not isinstance(scene.potential, QuadraticPotential):
        raise ValueError("every member must be a linear oscillator of one degree of freedom")
    square = float(scene.potential.stiffness[0, 0]) / float(scene.inertia.mass[0, 0])
    if not square > 0:
        raise ValueError("every member needs a positive stiffness")
    return 2.0 * math.pi / math.sqrt(square)
