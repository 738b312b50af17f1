"""What accuracy may cost, read off the tables that ``fvi cost`` measures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.measuring import number, table, yardstick_seconds, yes_or_no
from fvi_cli.api import cost, load
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.render.cost import PAGE_CONFIGS
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.cost_curves import CostCurve, cost_curves

YARDSTICK_STEPS = 2**19
"""Half the length of the transform that times are compared with."""


@dataclass(frozen=True, kw_only=True)
class Goal:
    """One figure to meet.

    Parameters
    ----------
    name
        What is compared.
    measured
        The ratio; nan where something was not reached.
    bound
        Least or largest allowed ratio.
    is_least
        Whether `bound` is the least.
    how
        What went into the ratio.
    """

    name: str
    measured: float
    bound: float
    is_least: bool
    how: str

    @property
    def is_met(self) -> bool:
        """Whether it holds; not where there is nothing to compare."""
        if self.is_least:
            return self.measured >= self.bound
        return self.measured <= self.bound


def run_accuracy(configs: Sequence[str] = PAGE_CONFIGS) -> list[Goal]:
    """Measure the configurations and the yardstick, all in this process."""
    tables = [table for name in configs for table in cost(load(name))]
    return cost_goals(tables, yardstick_seconds(YARDSTICK_STEPS))


def accuracy_table(goals: Sequence[Goal]) -> str:
    """The figures to meet, and below them what went into each."""
    measured = table(
        "Ratios of seconds until a run with that error is done (`fvi cost` measures them).",
        ("what", "measured", "bound", "met"),
        [
            (
                goal.name,
                number(goal.measured, ".3g"),
                f"at {'least' if goal.is_least else 'most'} {goal.bound:g}",
                yes_or_no(goal.is_met),
            )
            for goal in goals
        ],
    )
    return "\n".join([measured, *(f"- {goal.name}: {goal.how}" for goal in goals), ""])


def cost_goals(tables: Sequence[CostTable], yardstick: float) -> list[Goal]:
    """The figures to meet on the tables that are there.

    Parameters
    ----------
    tables
        Measured in one run of one process.
    yardstick
        Seconds of one real transform of 2^20 points in that process.
    """
    by_name = {table.experiment: table for table in tables}
    goals: list[Goal] = []
    if "cost-pendulum" in by_name:
        goals += _pendulum_goals(by_name["cost-pendulum"])
    if "cost-step-forced" in by_name:
        goals += _step_goals(by_name["cost-step-forced"], yardstick)
    if "cost-damped-oscillator" in by_name:
        goals += _oscillator_goals(by_name["cost-damped-oscillator"])
    return goals


def _pendulum_goals(table: CostTable) -> list[Goal]:
    curves = {curve.key: curve for curve in cost_curves(table)}
    blocks = [curve for curve in curves.values() if _is_ours(curve)]
    baselines = [curve for curve in curves.values() if isinstance(curve.methods[0], Baseline)]
    ours = _least_seconds(blocks, 1e-9)
    goals = []
    if "gruenwald-letnikov" in curves:
        theirs, how = _seconds(curves["gruenwald-letnikov"], 1e-9)
        goals.append(
            Goal(
                name="pendulum to 1e-9: Grünwald-Letnikov's time over ours",
                measured=theirs / ours,
                bound=2000.0,
                is_least=True,
                how=f"{theirs:.2g} s {how} over {ours:.2g} s",
            )
        )
    if baselines:
        ours = _least_seconds(blocks, 1e-7)
        times = {curve.key: _seconds(curve, 1e-7) for curve in baselines}
        known = {key: time for key, time in times.items() if not math.isnan(time[0])}
        name = min(known, key=lambda key: known[key][0], default="none")
        theirs, how = known.get(name, (math.nan, ""))
        goals.append(
            Goal(
                name="pendulum to 1e-7: the fastest baseline's time over ours",
                measured=theirs / ours,
                bound=100.0,
                is_least=True,
                how=f"{name} {theirs:.2g} s {how} over {ours:.2g} s",
            )
        )
    return goals


def _step_goals(table: CostTable, yardstick: float) -> list[Goal]:
    rows = [
        row
        for case in table.cases
        if isinstance(case.method, Method)
        for row in case.rows
        if row.is_usable and row.error <= 1e-9
    ]
    stepping = min((row.stepping_seconds_min for row in rows), default=math.nan)
    whole = min((row.seconds for row in rows), default=math.nan)
    shared = f"one rfft of 2^20 points takes {yardstick:.2g} s"
    return [
        Goal(
            name="step-forced Bagley-Torvik, T = 50, to 1e-9: steps over one rfft of 2^20 points",
            measured=stepping / yardstick,
            bound=1.5,
            is_least=False,
            how=f"{stepping:.2g} s; {shared}",
        ),
        Goal(
            name="the same, set-up included",
            measured=whole / yardstick,
            bound=5.0,
            is_least=False,
            how=f"{whole:.2g} s; {shared}",
        ),
    ]


def _oscillator_goals(table: CostTable) -> list[Goal]:
    curves = cost_curves(table)
    theirs = next((curve for curve in curves if curve.is_by_tolerance), None)
    ratios: dict[int, tuple[float, float, float]] = {}
    for curve in curves:
        for point in curve.points if _is_ours(curve) else ():
            if theirs is None or point.error > 1e-9:
                continue
            n_steps = point.n_steps
            same = CostCurve(
                key=theirs.key,
                methods=theirs.methods,
                points=tuple(p for p in theirs.points if p.n_steps == n_steps),
            )
            seconds = same.seconds_to(1e-9)
            if not math.isnan(seconds):
                ratio = point.seconds / seconds
                ratios[n_steps] = min(
                    ratios.get(n_steps, (math.inf, 0, 0)), (ratio, point.seconds, seconds)
                )
    # the grid on which we look worst, each time by our quickest method
    n_steps = max(ratios, key=lambda n: ratios[n][0], default=0)
    ratio, ours, other = ratios.get(n_steps, (math.nan, math.nan, math.nan))
    return [
        Goal(
            name="damped oscillator to 1e-9: our time over DOP853's at the same points",
            measured=ratio,
            bound=5.0,
            is_least=False,
            how=f"{ours:.2g} s over {other:.2g} s at N = {n_steps}, the least favourable of "
            f"{len(ratios)} grids",
        )
    ]


def _is_ours(curve: CostCurve) -> bool:
    return isinstance(curve.methods[0], Method)


def _least_seconds(curves: list[CostCurve], accuracy: float) -> float:
    times = [curve.seconds_to(accuracy) for curve in curves]
    return min((time for time in times if not math.isnan(time)), default=math.nan)


def _seconds(curve: CostCurve, accuracy: float) -> tuple[float, str]:
    """Time to an accuracy and how it is known."""
    seconds = curve.seconds_to(accuracy)
    if not math.isnan(seconds):
        return seconds, "(measured)"
    return curve.extrapolated_seconds(accuracy), "(extrapolated)"
