"""Orders of convergence: pairwise, and by least squares over the rows that may be used."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.members import Member


@dataclass(frozen=True, kw_only=True)
class OrderCase:
    """The rows of one method, with the slope through the rows that are used in the fit."""

    method: AnyMethod
    rows: tuple[FinishedRun, ...]
    """At least one, steps increasing."""

    @functools.cached_property
    def slope(self) -> float:
        """Least-squares slope of log(error) against log(h); nan with fewer than two rows."""
        used = [row for row in self.rows if row.used_in_fit]
        return fit_slope([row.run.n_steps for row in used], [row.error for row in used])

    def pairwise_order(self, index: int) -> float:
        """log(e_previous / e) / log(N / N_previous) of a row.

        Nan for the first row, and where one of the two is not used.
        """
        before, row = self.rows[max(index - 1, 0)], self.rows[index]
        if before is row or not (before.used_in_fit and row.used_in_fit):
            return math.nan
        return math.log(before.error / row.error) / math.log(row.run.n_steps / before.run.n_steps)

    @property
    def claim(self) -> float:
        """The order that the source of the experiment claims; nan where it claims none."""
        return self.rows[0].run.experiment.claim(self.method)

    @property
    def order_smooth(self) -> float:
        """The order expected on the finest step."""
        return self.rows[-1].order_smooth


@dataclass(frozen=True, kw_only=True)
class OrderTable:
    """The order table of one experiment."""

    experiment: Experiment
    cases: tuple[OrderCase, ...]
    member: Member | None = None
    """The member of a sweep; None: there is no sweep."""

    @property
    def swept(self) -> Mapping[str, Any]:
        """Swept values of the member by key path; empty without a sweep."""
        return {} if self.member is None else self.member.values


def tables_of_members(experiment: Experiment, finished: Iterable[FinishedRun]) -> list[OrderTable]:
    """The table of `experiment`; for a sweep, one for every member that has finished runs."""
    by_member: dict[Member | None, list[FinishedRun]] = {}
    for one in finished:
        by_member.setdefault(one.run.member, []).append(one)
    return [
        order_table(experiment, by_member.get(member, []), member)
        for member in experiment.members or (None,)
        if member is None or member in by_member
    ]


def order_table(
    experiment: Experiment, finished: Iterable[FinishedRun], member: Member | None = None
) -> OrderTable:
    """The table of all finished runs of `experiment`, in the order of its methods."""
    runs = sorted(finished, key=lambda one: one.run.n_steps)
    rows = {m: tuple(one for one in runs if one.run.method == m) for m in experiment.methods}
    cases = tuple(OrderCase(method=method, rows=own) for method, own in rows.items() if own)
    return OrderTable(experiment=experiment, cases=cases, member=member)


def fit_slope(n_steps: Iterable[int], errors: Iterable[float]) -> float:
    """Least-squares slope of log(error) against log(1/N); nan with fewer than two points."""
    abscissa = -np.log10(np.array(list(n_steps), dtype=float))
    ordinate = np.log10(np.array(list(errors), dtype=float))
    return float(np.polyfit(abscissa, ordinate, 1)[0]) if abscissa.size > 1 else math.nan
