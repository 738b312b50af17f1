"""Quantities over time: those of one kind share a panel, and the largest has its number."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from matplotlib.figure import Figure

from fvi_cli.integrator.observe.observer import observe_runs
from fvi_cli.integrator.trajectory import Observed
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.kinds.motions import (
    LEAST_POINTS,
    Motion,
    drawn_times,
    members_over_time,
    run_curves,
    select_runs,
)
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import BLACK, cycled
from fvi_cli.plotting.words import number_in_words, quantity_in_words, time_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.loops import forces_of

MOST_PANELS = 8
"""Most panels of quantities, the first ones."""


def quantities_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the quantities over time, with the largest peak in every panel.

    Numbered ones of one kind (drift_1, drift_3) share a panel where there is one run.
    """
    having = with_quantities(finished)
    names = list(observed_of(having[0]).quantities)
    if experiment.members:
        labels = {quantity_label(experiment, name): _values_of(name) for name in names}
        return members_over_time(experiment, having, dict(list(labels.items())[:MOST_PANELS]))
    shown, x = select_runs(having), time_label(experiment)
    panels = []
    for label, own in _groups(experiment, names, is_single=len(shown) == 1).items():
        curves = run_curves(shown, _values_of(own[0]))
        pairs = [(item, own[0]) for item in shown]
        if len(shown) == 1:
            pairs = [(shown[0], name) for name in own]
            curves = [_curve(shown[0], name, k, len(own)) for k, name in enumerate(own)]
        _mark_largest(curves, pairs)
        panels.append([Panel(curves=curves, x=x, y=label, levels=[0.0])])
    height = 1.15 if len(panels) > 1 else 2.0
    return figure(panels[:MOST_PANELS], lines, height=height, sharex=True)


def _groups(
    experiment: Experiment, names: Sequence[str], *, is_single: bool
) -> dict[str, list[str]]:
    """Names of quantities by the label of their panel; those of one kind for a single run."""
    groups: dict[str, list[str]] = {}
    stems = {name: re.sub(r"_\d+$", "", name) for name in names}
    for name, stem in stems.items():
        together = is_single and stem != name and list(stems.values()).count(stem) > 1
        label = quantity_label(experiment, name, stem if together else "")
        groups.setdefault(label, []).append(name)
    return groups


def quantity_label(experiment: Experiment, name: str, stem: str = "") -> str:
    """The label of an axis of a quantity, or of those that begin with `stem`."""
    kinds = (name, "force") if name in forces_of(experiment) else (name,)
    words = stem.replace("_", " ") if stem else quantity_in_words(experiment, name)
    return with_unit(words, experiment.units, *kinds)


def _curve(item: FinishedRun, name: str, index: int, count: int) -> Curve:
    x, y = _values_of(name)(item)
    label = name.replace("_", " ") if count > 1 else ""
    return Curve(x=x, y=y, label=label, look=cycled(index) if count > 1 else BLACK)


def _mark_largest(curves: list[Curve], pairs: Sequence[tuple[FinishedRun, str]]) -> None:
    """Add the largest peak of all to its curve, unless all are 0."""
    extents = [observed_of(item).extents[name] for item, name in pairs]
    place = max(range(len(extents)), key=lambda k: extents[k].peak)
    one = extents[place]
    if one.peak > 0:
        height = one.greatest if one.greatest == one.peak else one.least
        mark = (one.peak_time, height, number_in_words(height))
        curves[place] = replace(curves[place], marks=[mark])


def _values_of(name: str) -> Motion:
    """The function that gives times and values of a quantity."""

    def values(item: FinishedRun) -> tuple[Array, Array]:
        times, found = _dense(item)
        return times, found[name]

    return values


@functools.lru_cache(maxsize=16)
def _dense(item: FinishedRun) -> tuple[Array, Mapping[str, Array]]:
    """Times and quantities; where few are reported, those within the steps that were kept."""
    trajectory, quantities = item.trajectory, observed_of(item).quantities
    if trajectory.steps is None or trajectory.time.size >= LEAST_POINTS:
        return trajectory.time, quantities
    request = replace(item.run.observations, times=drawn_times(item), events={}, impacts={})
    (dense,) = observe_runs([item.run.scene], item.run.method, [trajectory], [request])
    return dense.time, quantities if dense.observed is None else dense.observed.quantities


def with_quantities(finished: Sequence[FinishedRun]) -> list[FinishedRun]:
    """The runs that have requested quantities."""
    having = [one for one in finished if observed_of(one).quantities]
    if not having:
        raise NothingToDraw("there are none; write quantities: {drift: x2 - x1}")
    return having


def observed_of(item: FinishedRun) -> Observed:
    """The quantities and events of a run; empty if none were requested."""
    observed = item.trajectory.observed
    return Observed(mesh=item.trajectory.time) if observed is None else observed
