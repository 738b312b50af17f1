"""The runs that a figure shows, and how their curves are distinguished."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvi_cli.integrator.method import Baseline
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.panels import Curve, NothingToDraw
from fvi_cli.plotting.style import COLOURS, Look, method_words
from fvi_cli.reports.naming import key_label
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.members import Member, value_in_words

Motion = Callable[[FinishedRun], tuple[Array, Array]]

_ALIKE = {"label": "members", "look": Look(colour="#8fb8d4", width=0.4)}
_MOST_NAMED, _MOST_MEMBERS, _MOST_PANELS = 6, 100, 4  # with names in a legend; lines; columns


def distinguish(
    members: Sequence[Member | None], units: Mapping[str, str], *, without: Collection[str] = ()
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Label, number or look of a curve for each member, and the titles of their figure.

    Up to six have names, and their legend a heading; more have colours by their swept number, and
    the colour bar a name; without a single number they look alike. Their values of the keys
    `without` are shown otherwise.
    """
    found = [one for one in members if one is not None]
    if not found or len(found) < len(members):
        return [{} for _ in members], {}
    first = found[0]
    keys = [key for key in first.unnamed if key not in without]
    values = [[one.values[key] for key in keys] for one in found]
    names = [
        ", ".join(filter(None, [one.name, *map(value_in_words, own)]))
        for one, own in zip(found, values, strict=True)
    ]
    labels = ["design"] * bool(first.name)
    labels += [key_label(key, units, first.specification, tuple(first.values)) for key in keys]
    heading = ", ".join(labels)
    if len(set(names)) <= _MOST_NAMED or not keys:
        return [{"label": name} for name in names], {"heading": heading}
    if len(labels) == 1 and all(isinstance(own[0], int | float) for own in values):
        return [{"by": float(own[0])} for own in values], {"bar": heading}
    return [_ALIKE] * len(found), {"heading": f"{len(found)} members: {heading}"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """The runs of a figure, in columns by title."""

    columns: Mapping[str, Sequence[FinishedRun]]
    words: Mapping[FinishedRun, dict[str, Any]]  # label and look, or number of their curves
    titles: Mapping[str, Any]  # heading of the legend, or name of the colour bar

    @property
    def runs(self) -> list[FinishedRun]:
        """All of them."""
        return list(self.words)

    @property
    def best(self) -> FinishedRun:
        """The run with the smallest error; the last run if none has an error."""
        measured = [one for one in self.runs if math.isfinite(one.error)]
        return min(measured, key=lambda one: one.error) if measured else self.runs[-1]

    @property
    def title(self) -> str:
        """Method of a single run, which needs no legend, and step size."""
        name = self.words[self.best].get("label", "") if len(self.runs) == 1 else ""
        return ", ".join(filter(None, [name, *self.columns]))

    def curves(self, motion: Motion, runs: Sequence[FinishedRun] | None = None) -> list[Curve]:
        """A curve for every run by `motion`, its abscissas and ordinates, and :func:`mean_of`."""
        pairs = [(motion(one), self.words[one]) for one in (self.runs if runs is None else runs)]
        curves = [Curve(x=x, y=y, **words) for (x, y), words in pairs]
        return [*curves, *mean_of(curves)]


def mean_of(curves: Sequence[Curve]) -> list[Curve]:
    """The mean of curves of members that look alike, if they have the same abscissas."""
    is_alike = all(one.look is _ALIKE["look"] for one in curves)
    if not is_alike or not all(np.array_equal(one.x, curves[0].x) for one in curves):
        return []
    mean = np.mean([one.y for one in curves], axis=0)
    return [Curve(x=curves[0].x, y=mean, label="mean", look=Look(colour=COLOURS[0], width=1.6))]


def select(
    experiment: Experiment,
    finished: Sequence[FinishedRun],
    is_drawable: Callable[[FinishedRun], object] = lambda item: True,
    reason: str = "",
    *,
    in_columns: bool = False,
) -> Shown:
    """One run for every method, on the finest steps with which most methods succeeded.

    Of a sweep up to 100 members on the finest steps by the first method, evenly chosen. Runs that
    failed or diverged are shown where all did. Columns are those of the degrees, or of the values
    of the swept key that has fewest.

    Raises
    ------
    NothingToDraw
        If no run is drawable, for this reason.
    """
    moving = [one for one in finished if one.trajectory.time.size > 1]
    usable = [one for one in moving if is_drawable(one)]
    if not usable:
        raise NothingToDraw(reason if moving else "every run failed at its start")
    able = [one for one in usable if one.status in ("ok", "floor")] or usable
    if experiment.members:
        finest = finest_of_members(able)
        few = finest[:: -(-len(finest) // _MOST_MEMBERS)]
        return _members(experiment, few, in_columns=in_columns)
    counts = Counter(one.run.n_steps for one in able)
    n_steps = max(counts, key=lambda n: (counts[n], n))
    shown = [one for one in able if one.run.n_steps == n_steps]
    step = f"$h={shown[0].run.step_size:.4g}$ {experiment.units.get('time', '')}".rstrip()
    is_equal = experiment.grading == 1.0 and experiment.accuracy is None
    columns, words = {}, {}
    for degree, own in (by_degree(shown) if in_columns else {"": shown}).items():
        columns[", ".join(filter(None, [degree, step * is_equal]))] = own
        known = method_words([one.run.method for one in own])
        for one in own:
            label, look = known[one.run.method.case].values()
            words[one] = {"label": label, "look": replace(look, marker="")}
    return Shown(columns=columns, words=words, titles={})


def _members(experiment: Experiment, shown: Sequence[FinishedRun], *, in_columns: bool) -> Shown:
    """Members, in columns by the key that has the fewest values of several."""
    units, first = experiment.units, experiment.members[0]
    counts = {
        key: len({value_in_words(one.values[key]) for one in experiment.members})
        for key in first.unnamed
    }
    is_many = in_columns and len(counts) > 1 and len(experiment.members) > _MOST_NAMED
    key = min(counts, key=lambda one: counts[one]) if is_many else ""
    key = key if 1 < counts.get(key, 0) <= _MOST_PANELS else ""
    label = key and f"{key_label(key, units, first.specification, experiment.swept)} = "
    sizes = {one.run.step_size for one in shown}
    is_equal = len(sizes) == 1 and experiment.grading == 1.0 and experiment.accuracy is None
    step = f"$h={min(sizes):.4g}$ {units.get('time', '')}".rstrip() * is_equal
    columns: dict[str, list[FinishedRun]] = {}
    for one in shown:
        values = {} if one.run.member is None else one.run.member.values
        columns.setdefault(label + value_in_words(values[key]) if label else step, []).append(one)
    words, titles = distinguish([one.run.member for one in shown], units, without=(key,))
    return Shown(columns=columns, words=dict(zip(shown, words, strict=True)), titles=titles)


def members_apart(
    finished: Sequence[FinishedRun], *, without: Collection[str] = ()
) -> list[list[FinishedRun]]:
    """The runs of every member, together with those that differ in the keys `without` alone."""
    groups: dict[tuple[str, ...], list[FinishedRun]] = {}
    for one in finished:
        if one.run.member is not None:
            values = one.run.member.values.items()
            own = [value_in_words(value) for key, value in values if key not in without]
            groups.setdefault((one.run.member.name, *own), []).append(one)
    return list(groups.values())


def by_degree(finished: Sequence[FinishedRun]) -> dict[str, list[FinishedRun]]:
    """The runs of every degree of BDF, by title; an empty one where there is only one degree.

    Methods that have no choice of it are in all.
    """
    methods = [one.run.method for one in finished]
    degrees = [
        0 if isinstance(one, Baseline) or one.is_runge_kutta else one.degree for one in methods
    ]
    every = sorted(set(degrees) - {0})
    if len(every) < 2:
        return {"": list(finished)}
    pairs = list(zip(finished, degrees, strict=True))
    return {f"degree {n}": [one for one, own in pairs if own in (0, n)] for n in every}
