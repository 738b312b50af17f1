"""What accuracy may cost, read off the tables that ``fvi cost`` measures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.measuring import number, table, yardstick_seconds, yes_or_no
from fvi_cli.api import cost, load
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.studies.cost import CostTable

CONFIGS = ("cost-step-forced", "cost-pendulum")
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


def run_accuracy(configs: Sequence[str] = CONFIGS) -> list[Goal]:
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
    by_name = {table.experiment.name: table for table in tables}
    goals: list[Goal] = []
    if "cost-pendulum" in by_name:
        goals.append(_pendulum_goal(by_name["cost-pendulum"]))
    if "cost-step-forced" in by_name:
        goals.append(_step_goal(by_name["cost-step-forced"], yardstick))
    return goals


def _pendulum_goal(table: CostTable) -> Goal:
    times = {row.run.method: least_seconds(table, row.run.method, 1e-7) for row in table.rows}
    ours = min(time for method, time in times.items() if isinstance(method, Method))
    baselines = {m.case: time for m, time in times.items() if isinstance(m, Baseline)}
    name = min(baselines, key=baselines.__getitem__, default="none")
    theirs = baselines.get(name, math.nan)
    return Goal(
        name="pendulum to 1e-7: the fastest baseline's time over ours",
        measured=theirs / ours,
        bound=10.0,
        is_least=True,
        how=f"{name} {theirs:.2g} s over {ours:.2g} s; infinite where no baseline gets there",
    )


def _step_goal(table: CostTable, yardstick: float) -> Goal:
    methods = {row.run.method for row in table.rows if isinstance(row.run.method, Method)}
    whole = min(least_seconds(table, method, 1e-9) for method in methods)
    return Goal(
        name="step-forced Bagley-Torvik, T = 50, to 1e-9, over one rfft of 2^20 points",
        measured=whole / yardstick,
        bound=5.0,
        is_least=False,
        how=f"{whole:.2g} s; one rfft of 2^20 points takes {yardstick:.2g} s",
    )


def least_seconds(table: CostTable, method: AnyMethod, accuracy: float) -> float:
    """Least time of a method until an error of at most `accuracy`; infinite: not reached."""
    return min(
        (
            row.seconds
            for row in table.rows
            if row.run.method == method and row.is_usable and row.error <= accuracy
        ),
        default=math.inf,
    )
