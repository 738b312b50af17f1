"""Experiments and runs with errors that are made up, and tables of their orders."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from letters import spring

from fvi_cli import reports
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.reports.kinds.orders import order_report
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.order import OrderCase, OrderRow, OrderTable, order_table

BDF1, BDF2, BDF3 = (Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in (1, 2, 3))
STEPS = (2, 4, 8, 16)


def made_experiment(
    methods: Sequence[AnyMethod] = (BDF1, BDF2),
    steps: Sequence[int] = STEPS,
    problem: AnyProblem | None = None,
    **changes: Any,
) -> Experiment:
    usual = Problem(
        kind="bagley-torvik", scene=spring(T=1.0, v=1.0), equation="x'' + x = t**2*sin(t)"
    )
    values: dict[str, Any] = {
        "name": "made-up",
        "problem": problem or usual,
        "problem_specification": {},
        "methods": tuple(methods),
        "steps": tuple(steps),
        **changes,
    }
    return Experiment(**values)


def made_run(run: Run, error: float, **changes: Any) -> FinishedRun:
    """A run that came to this error; `changes` are of the run or of its trajectory."""
    own = {field.name for field in dataclasses.fields(FinishedRun)}
    time = np.linspace(0.0, run.problem.final_time, run.n_steps + 1)
    trajectory = {
        "time": time,
        "position": time[:, None],
        "n_steps": run.n_steps,
        "step_size": run.step_size,
        **{key: value for key, value in changes.items() if key not in own},
    }
    values = {
        "floor": 1e-13,
        "status": "ok",
        "expected_order": 2.0,
        "reference": "expression",
        **{key: value for key, value in changes.items() if key in own},
    }
    return FinishedRun(run=run, trajectory=Trajectory(**trajectory), error=error, **values)


def powers(run: Run) -> FinishedRun:
    """BDF1 has order 1, everything else order 2, with round constants."""
    order = 1 if run.method == BDF1 else 2
    return made_run(run, 2.0 ** (-order * math.log2(run.n_steps)), expected_order=float(order))


def table_of(
    make: Callable[[Run], FinishedRun] = powers,
    *methods: AnyMethod,
    count: int | None = None,
    **changes: Any,
) -> OrderTable:
    """The orders of an experiment of which so many runs are finished."""
    described = made_experiment(methods or (BDF1, BDF2), **changes)
    return order_table(described, [make(run) for run in described.runs()[:count]])


def row(n_steps: int, error: float, **changes: Any) -> OrderRow:
    made = OrderRow(
        n_steps=n_steps,
        step_size=1.0 / n_steps,
        error=error,
        floor=1e-13,
        status="ok" if math.isfinite(error) else "diverged",
        predicted="unknown",
        expected_order=2.0,
    )
    return dataclasses.replace(made, **changes)


def one_case(*rows: OrderRow, **changes: Any) -> OrderTable:
    """A table of BDF2 alone."""
    made = OrderTable(
        experiment="made-up",
        equation="x'' = 0",
        gamma="",
        reference="expression",
        norm="max",
        final_time=1.0,
        cases=(OrderCase(method=BDF2, rows=rows),),
    )
    return dataclasses.replace(made, **changes)


def rendered(name: str, made: Sequence[OrderTable]) -> dict[str, str]:
    """The text of every form, by what its file has behind the name."""
    texts = reports.rendered(order_report(name, made))
    return {file.removeprefix(name)[1:]: text for file, text in texts.items()}
