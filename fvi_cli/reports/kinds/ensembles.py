"""Mean and spread over the members of a sweep: motions at every time, and peaks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.reports.columns import CLOSE, GOOD, Item
from fvi_cli.reports.naming import with_unit
from fvi_cli.reports.table import Column, Sheet
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import FinishedRun, finest_of_members


@dataclass(frozen=True, kw_only=True, eq=False)
class Ensemble:
    """One coordinate or quantity of all members, or of those of one design."""

    of: FinishedRun  # the first member
    name: str
    design: str  # empty if the members are not those of one design
    time: Array  # (n,)
    values: Array  # a row for every member, (m, n)

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
    rows = []
    for one in members:
        observed = one.trajectory.observed
        if observed is not None and name in observed.quantities:
            rows.append(observed.quantities[name])
        else:
            rows.append(one.trajectory.position[:, coordinates.index(name)])
    return Ensemble(
        of=members[0],
        name=name,
        design=design,
        time=members[0].trajectory.time,
        values=np.array(rows),
    )


COLUMNS = (
    Column("experiment", get="of.run.experiment.name"),
    Column("design", "design"),  # empty: all members
    Column("quantity"),
    Column(
        "",
        "peak of",
        get=lambda one: with_unit(one.quantity, one.of.run.experiment.units, one.quantity),
    ),
    Column("members", "members", get=lambda one: one.peaks.size),
    Column("mean", "mean", ".6g", CLOSE, get=lambda one: float(one.peaks.mean())),
    # with divisor m - 1
    Column("deviation", "deviation", ".4g", CLOSE, get=lambda one: float(_deviation(one.peaks))),
    Column("least", "least", ".6g", CLOSE, get=lambda one: float(one.peaks.min())),
    Column("greatest", "greatest", ".6g", CLOSE, get=lambda one: float(one.peaks.max())),
)


def ensemble_sheet(finished: Sequence[FinishedRun]) -> Sheet | None:
    """Mean and spread of the peaks of quantities over the members of sweeps."""
    groups: dict[tuple[str, str, str], list[tuple[FinishedRun, float]]] = {}
    experiments: dict[str, list[FinishedRun]] = {}
    for one in finished:
        if one.status in GOOD:
            experiments.setdefault(one.run.experiment.name, []).append(one)
    for one in (one for own in experiments.values() for one in finest_of_members(own)):
        member, observed = one.run.member, one.trajectory.observed
        if member is not None and member.unnamed and observed is not None:
            for name, extent in observed.extents.items():
                key = (one.run.experiment.name, member.name, name)
                groups.setdefault(key, []).append((one, extent.peak))
    items = [
        Item(of=own[0][0], design=design, quantity=name, peaks=np.array([peak for _, peak in own]))
        for (_, design, name), own in groups.items()
    ]
    sheet = Sheet(name="ensemble", columns=COLUMNS, items=items, is_file=False)
    return sheet if items else None
