"""What accuracy may cost, read off the tables that ``fvi cost`` measures."""

from __future__ import annotations

import math

from benchmarks.measuring import Figure, figure_of, yardstick_seconds
from fvi_cli.api import cost, load
from fvi_cli.integrator.method import Baseline
from fvi_cli.studies.cost import CostTable

CONFIGS = ("cost-pendulum", "cost-step-forced")


def run_accuracy() -> list[Figure]:
    """Measure the configurations and the yardstick, all in this process."""
    pendulum, step_forced = (table for name in CONFIGS for table in cost(load(name)))
    return [pendulum_figure(pendulum), step_figure(step_forced)]


def pendulum_figure(table: CostTable) -> Figure:
    """Our time over that of the fastest baseline, for errors of 1e-7."""
    ours, theirs = (_least(table, 1e-7, of_baselines=own) for own in (False, True))
    name = "pendulum to 1e-7: our time over the fastest baseline's"
    return figure_of(name, 0.1, ours, theirs)


def step_figure(table: CostTable) -> Figure:
    """Our time over one transform, for errors of 1e-9 beside jumps."""
    name = "step-forced Bagley-Torvik, T = 50, to 1e-9, over one rfft of 2^20 points"
    return figure_of(name, 5.0, _least(table, 1e-9), yardstick_seconds(2**20))


def _least(table: CostTable, accuracy: float, *, of_baselines: bool = False) -> float:
    """Least time to an error of at most `accuracy`; infinite: not reached."""
    reached = (
        row.seconds
        for row in table.rows
        if isinstance(row.finished.run.method, Baseline) == of_baselines
        and row.is_usable
        and row.finished.error <= accuracy
    )
    return min(reached, default=math.inf)
