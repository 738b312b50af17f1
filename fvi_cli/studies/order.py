"""Orders of convergence: pairwise, and by least squares over the rows that may be used."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem
from fvi_cli.studies.experiment import Experiment, FinishedRun, Observed
from fvi_cli.studies.members import Member
from fvi_cli.studies.norms import Norm


@dataclass(frozen=True, kw_only=True)
class OrderRow:
    """One run in an order table."""

    n_steps: int
    step_size: float
    error: float
    """The error in the table's norm; nan where it has no meaning."""
    floor: float
    """Errors below are round-off or the reference's own."""
    status: Observed
    order_smooth: float
    seconds: float = math.nan
    """Time of the steps."""
    history_operations: int = 0
    message: str = ""
    remarks: tuple[str, ...] = ()
    """Events of the run and warnings, in words."""

    @property
    def used_in_fit(self) -> bool:
        """Whether the slope uses it: status ``ok``, and an error above the floor."""
        return self.status == "ok" and 0 < self.error < math.inf and not self.error <= self.floor


@dataclass(frozen=True, kw_only=True)
class OrderCase:
    """The rows of one method, with the slope through the rows that are used in the fit."""

    method: AnyMethod
    rows: tuple[OrderRow, ...]
    claim: float = math.nan
    """The order that the source of the experiment claims; nan where it claims none."""

    @functools.cached_property
    def slope(self) -> float:
        """Least-squares slope of log(error) against log(h); nan with fewer than two rows."""
        used = [row for row in self.rows if row.used_in_fit]
        return fit_slope([row.n_steps for row in used], [row.error for row in used])

    def pairwise_order(self, index: int) -> float:
        """log(e_previous / e) / log(N / N_previous) of a row.

        Nan for the first row, and where one of the two is not used.
        """
        before, row = self.rows[max(index - 1, 0)], self.rows[index]
        if not (before.used_in_fit and row.used_in_fit):
            return math.nan
        return pairwise_order(before.error, row.error, before.n_steps, row.n_steps)

    @property
    def order_smooth(self) -> float:
        """The order expected on the finest step."""
        return self.rows[-1].order_smooth if self.rows else math.nan


@dataclass(frozen=True, kw_only=True)
class OrderTable:
    """The order table of one experiment."""

    experiment: str
    equation: str
    gamma: str
    """Orders of damping in the equation, joined by ``;``; empty for a sweep."""
    reference: str
    norm: Norm
    final_time: float
    cases: tuple[OrderCase, ...]
    member: Member | None = None
    """The member of a sweep; None: there is no sweep."""

    @property
    def swept(self) -> Mapping[str, Any]:
        """Swept values of the member by key path; empty without a sweep."""
        return {} if self.member is None else self.member.values

    @property
    def title(self) -> str:
        """The experiment, and the member where there is a sweep."""
        return f"{self.experiment} ({self.member.label})" if self.member else self.experiment


def tables_of_members(experiment: Experiment, finished: Iterable[FinishedRun]) -> list[OrderTable]:
    """The table of `experiment`; for a sweep, one for every member that has finished runs."""
    if not experiment.members:
        return [order_table(experiment, finished)]
    by_member: dict[Member, list[FinishedRun]] = {}
    for one in finished:
        if one.run.member is not None:
            by_member.setdefault(one.run.member, []).append(one)
    return [
        replace(order_table(experiment, by_member[member]), member=member)
        for member in experiment.members
        if member in by_member
    ]


def order_table(experiment: Experiment, finished: Iterable[FinishedRun]) -> OrderTable:
    """The table of all finished runs of `experiment`, in the order of its methods."""
    runs = sorted(finished, key=lambda one: one.run.n_steps)
    cases = []
    for method in experiment.methods:
        rows = tuple(_row(one) for one in runs if one.run.method == method)
        claim = experiment.claim(method)
        if rows:
            known = math.nan if claim is None else claim
            cases.append(OrderCase(method=method, rows=rows, claim=known))
    problem = experiment.problem
    return OrderTable(
        experiment=experiment.name,
        equation=problem.equation,
        gamma="" if experiment.members else _orders_of(problem),
        reference=runs[0].reference if runs else problem.exact_source,
        norm=experiment.norm,
        final_time=problem.final_time,
        cases=tuple(cases),
    )


def _row(finished: FinishedRun) -> OrderRow:
    return OrderRow(
        n_steps=finished.run.n_steps,
        step_size=finished.run.step_size,
        error=finished.error,
        floor=finished.floor,
        status=finished.status,
        order_smooth=finished.order_smooth,
        seconds=finished.trajectory.seconds,
        history_operations=finished.trajectory.history_operations,
        message=finished.trajectory.message,
        remarks=finished.trajectory.remarks,
    )


def _orders_of(problem: AnyProblem) -> str:
    if isinstance(problem, DerivativeProblem):
        return f"{problem.order:.15g}"
    return ";".join(f"{term.order:.15g}" for term in problem.scene.damping)


def pairwise_order(coarse: float, fine: float, n_coarse: int, n_fine: int) -> float:
    """Order from two errors; nan where it has no meaning."""
    if not (0 < coarse < math.inf and 0 < fine < math.inf) or n_coarse == n_fine:
        return math.nan
    return math.log(coarse / fine) / math.log(n_fine / n_coarse)


def fit_slope(n_steps: Iterable[int], errors: Iterable[float]) -> float:
    """Least-squares slope of log(error) against log(1/N); nan with fewer than two points."""
    abscissa = -np.log10(np.array(list(n_steps), dtype=float))
    ordinate = np.log10(np.array(list(errors), dtype=float))
    return float(np.polyfit(abscissa, ordinate, 1)[0]) if abscissa.size > 1 else math.nan
