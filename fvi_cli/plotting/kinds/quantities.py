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
from fvi_cli.plotting.draw import calm_limits, figure, lines
from fvi_cli.plotting.kinds.motions import (
    LEAST_POINTS,
    Motion,
    drawn_times,
    members_over_time,
    run_curves,
    select_runs,
)
from fvi_cli.plotting.looks import BLACK, cycled
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.words import number_in_words, quantity_in_words, time_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.loops import forces_of

MOST_PANELS = 8
"""Most panels of quantities, the first ones."""


def quantities_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the quantities over time, with the largest peak in every panel.

    Numbered ones of one kind (drift_1, drift_3) share a panel where there is one run.
    """
    having = [one for one in finished if has_quantities(one)]
    if experiment.members:
        shown = finest_of_members(having)
        names = list(observed_of(shown[0]).quantities)[:MOST_PANELS]
        motions = {quantity_label(experiment, name): _values_of(name) for name in names}
        return members_over_time(experiment, shown, motions)
    shown, x = select_runs(having), time_label(experiment)
    panels = []
    for label, names in _groups(experiment, shown).items():
        if len(shown) > 1:
            curves = run_curves(shown, _values_of(names[0]))
            pairs = [(item, names[0]) for item in shown]
        else:
            pairs = [(shown[0], name) for name in names]
            curves = [_curve(shown[0], name, k, len(names)) for k, name in enumerate(names)]
        _mark_largest(curves, pairs)
        limits = calm_limits(curves)
        panels.append([Panel(curves=curves, x=x, y=label, levels=[0.0], ylim=limits)])
    height = 1.15 if len(panels) > 1 else 2.0
    return figure(panels[:MOST_PANELS], lines, height=height, sharex=True)


def _groups(experiment: Experiment, shown: Sequence[FinishedRun]) -> dict[str, list[str]]:
    """Names of quantities by the label of their panel."""
    groups: dict[str, list[str]] = {}
    names = list(observed_of(shown[0]).quantities)
    stems = {name: re.sub(r"_\d+$", "", name) for name in names}
    for name, stem in stems.items():
        together = len(shown) == 1 and stem != name and list(stems.values()).count(stem) > 1
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
    """Reported times and quantities; where these are few, those within the steps."""
    trajectory, quantities = item.trajectory, observed_of(item).quantities
    if trajectory.steps is None or trajectory.time.size >= LEAST_POINTS:
        return trajectory.time, quantities
    request = replace(item.run.observations, times=drawn_times(item), events={}, impacts={})
    (dense,) = observe_runs([item.run.scene], item.run.method, [trajectory], [request])
    return dense.time, quantities if dense.observed is None else dense.observed.quantities


def has_quantities(item: FinishedRun) -> bool:
    """Whether a run has requested quantities."""
    return bool(observed_of(item).quantities)


def observed_of(item: FinishedRun) -> Observed:
    """The quantities and events of a run; empty if none were requested."""
    observed = item.trajectory.observed
    return Observed(mesh=item.trajectory.time) if observed is None else observed
