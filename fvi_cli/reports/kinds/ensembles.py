"""Mean and spread over the members of a sweep, at every time and for their peaks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.reports.kinds.designs import CLOSE, GOOD
from fvi_cli.reports.table import About, Column, Sheet
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import FinishedRun, finest_of_members
from fvi_cli.studies.figure_settings import FigureSettings

_INSTANTS = 11
"""Number of times of a motion in the table, from its first to its last."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ensemble:
    """One coordinate or quantity of all members, or of those of one design."""

    of: FinishedRun  # the first member
    name: str
    design: str  # empty if the members are not those of one design
    time: Array  # (n,)
    values: Array  # a row for every member, (m, n)
    peaks: Array  # largest absolute values, (m,), also between the times if these are known

    @property
    def mean(self) -> Array:
        """The mean at every time, ``(n,)``."""
        return np.asarray(self.values.mean(axis=0))

    @property
    def deviation(self) -> Array:
        """The standard deviation at every time, with divisor m - 1, ``(n,)``."""
        return _deviation(self.values)


def _deviation(values: Array) -> Array:
    if len(values) < 2:
        return np.full(values.shape[1:], np.nan)
    return np.asarray(values.std(axis=0, ddof=1))


def members_at_equal_times(finished: Sequence[FinishedRun]) -> list[FinishedRun]:
    """The run of every member that reached its end; empty if their times differ."""
    ended = [one for one in finest_of_members(finished) if one.status in GOOD]
    times = [one.trajectory.time for one in ended]
    if any(time.size < 2 or time.shape != times[0].shape for time in times):
        return []
    return ended if all(np.allclose(time, times[0], rtol=1e-12) for time in times) else []


def ensembles(finished: Sequence[FinishedRun], names: Sequence[str]) -> list[Ensemble]:
    """Ensembles of coordinates and quantities; for designs with a sweep one for each design.

    Members that did not reach their end are left out.
    """
    groups: dict[str, list[FinishedRun]] = {}
    for one in members_at_equal_times(finished):
        member = one.run.member
        is_design = member is not None and bool(member.name and member.unnamed)
        groups.setdefault(member.name if is_design and member else "", []).append(one)
    return [_ensemble(own, name, design) for name in names for design, own in groups.items()]


def _ensemble(members: Sequence[FinishedRun], name: str, design: str) -> Ensemble:
    problem = members[0].run.problem
    coordinates = problem.coordinates if isinstance(problem, Problem) else ()
    rows, peaks = [], []
    for one in members:
        observed = one.trajectory.observed
        if observed is not None and name in observed.quantities:
            rows.append(observed.quantities[name])
            peaks.append(observed.extents[name].peak)
        else:
            rows.append(one.trajectory.position[:, coordinates.index(name)])
            peaks.append(float(np.abs(rows[-1]).max()))
    return Ensemble(
        of=members[0],
        name=name,
        design=design,
        time=members[0].trajectory.time,
        values=np.array(rows),
        peaks=np.array(peaks),
    )


_COLUMNS = (
    Column("experiment", "name of the experiment", get="of.run.experiment.name"),
    Column("design", "name of the design; empty: all members"),
    Column("case", "name of the method in files", get="of.run.method.case"),
    Column("n_steps", "number N of steps", get="of.run.n_steps"),
    Column("quantity", "coordinate or quantity", "quantity", get="name"),
    Column("what", "value at a time, or peak of a whole run", "what"),
    Column("t", "time of the value", "at t", ".6g", CLOSE),
    Column("members", "number of members", "members"),
    Column("mean", "mean over the members", "mean", ".6g", CLOSE),
    Column("deviation", "standard deviation, with m - 1", "deviation", ".4g", CLOSE),
    Column("least", "smallest of a member", "least", ".6g", CLOSE),
    Column("greatest", "largest of a member", "greatest", ".6g", CLOSE),
)


def _rows(one: Ensemble) -> Iterator[About]:
    chosen = np.unique(np.linspace(0, one.time.size - 1, _INSTANTS).round().astype(int))
    columns = [("value", float(one.time[k]), one.values[:, k]) for k in chosen]
    for what, t, values in [*columns, ("peak", None, one.peaks)]:
        yield About(
            **{name: getattr(one, name) for name in ("of", "name", "design")},
            what=what,
            t=t,
            members=len(values),
            mean=float(values.mean()),
            deviation=float(_deviation(values[:, None])[0]),
            least=float(values.min()),
            greatest=float(values.max()),
        )


def ensemble_sheet(finished: Sequence[FinishedRun]) -> Sheet | None:
    """Mean and spread at some times and of peaks, for experiments with an ``ensemble`` figure."""
    found: list[Ensemble] = []
    for experiment in {id(one.run.experiment): one.run.experiment for one in finished}.values():
        figures = [one for one in experiment.figures if isinstance(one, FigureSettings)]
        names = dict.fromkeys(name for one in figures for name in one.ensemble or ())
        own = [one for one in finished if one.run.experiment is experiment]
        found += ensembles(own, list(names))
    if not found:
        return None
    columns = tuple(
        Column(one.name, one.meaning, "design") if one.name == "design" and is_named else one
        for one in _COLUMNS
        for is_named in [any(e.design for e in found)]
    )
    rows = (row for one in found for row in _rows(one))
    keys = ("experiment", "design", "quantity", "what", "t")
    return Sheet.of("ensemble", columns, rows, keys, is_file=False)
