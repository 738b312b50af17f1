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
from fvi_cli.studies.order import OrderCase, OrderTable, order_table

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
        "trajectory": Trajectory(**trajectory),
        "floor": 1e-13,
        "status": "ok",
        "order_smooth": 2.0,
        "reference": "expression",
        **{key: value for key, value in changes.items() if key in own},
    }
    return FinishedRun(run=run, error=error, **values)


def powers(run: Run) -> FinishedRun:
    """BDF1 has order 1, everything else order 2, with round constants."""
    order = 1 if run.method == BDF1 else 2
    return made_run(run, 2.0 ** (-order * math.log2(run.n_steps)), order_smooth=float(order))


def table_of(
    make: Callable[[Run], FinishedRun] = powers,
    *methods: AnyMethod,
    count: int | None = None,
    **changes: Any,
) -> OrderTable:
    """The orders of an experiment of which so many runs are finished."""
    described = made_experiment(methods or (BDF1, BDF2), **changes)
    return order_table(described, [make(run) for run in described.runs()[:count]])


def row(n_steps: int, error: float, **changes: Any) -> FinishedRun:
    run = Run(experiment=made_experiment(), method=BDF2, n_steps=n_steps)
    status = "ok" if math.isfinite(error) else "diverged"
    return made_run(run, error, **{"status": status, **changes})


def one_case(*rows: FinishedRun, name: str = "made-up") -> OrderTable:
    """A table of BDF2 alone."""
    case = OrderCase(method=BDF2, rows=rows)
    problem = dataclasses.replace(made_experiment().problem, equation="x'' = 0")
    return OrderTable(experiment=made_experiment(name=name, problem=problem), cases=(case,))


def rendered(name: str, made: Sequence[OrderTable]) -> dict[str, str]:
    """The text of every form, by what its file has behind the name."""
    texts = reports.rendered(order_report(name, made))
    return {file.removeprefix(name)[1:]: text for file, text in texts.items()}


# --- studies for figures --------------------------------------------------------------------------

NODES = (BDF1, BDF2, BDF3)
LADDER = tuple(2**k for k in range(3, 9))
ORDERS = {"bdf1": 1.0, "bdf2": 2.0, "bdf3": 2.0}


def swinging(*, exact: bool = True) -> Problem:
    """x'' + x = 0, x(0) = 0, x'(0) = 1, with a damping of coefficient zero for the title."""
    return Problem(
        kind="bagley-torvik",
        scene=spring((1.5, np.zeros((1, 1))), T=8.0, v=1.0),
        exact=(lambda t: np.sin(t)[:, None]) if exact else None,
    )


def power_law(run: Run) -> float:
    quadrature = run.method.cq
    share = 1 + list(ORDERS).index(quadrature) if quadrature in ORDERS else 1
    return 0.1 / share * run.step_size ** ORDERS.get(quadrature, 1.0)


def made_study(
    methods: Sequence[AnyMethod] = NODES,
    steps: Sequence[int] = LADDER,
    *,
    error: Callable[[Run], float] = power_law,
    status: Callable[[Run], str] = lambda run: "ok",
    problem: AnyProblem | None = None,
    **changes: Any,
) -> tuple[Experiment, list[FinishedRun]]:
    """Runs whose trajectory is the sine plus the error at every point but the first."""
    one = made_experiment(methods, steps, problem or swinging(), **changes)
    finished = []
    for run in one.runs():
        time = run.step_size * np.arange(run.n_steps + 1)
        offset = np.where(time > 0, error(run), 0.0)
        made = made_run(
            run,
            error(run),
            status=status(run),
            order_smooth=ORDERS.get(run.method.cq, math.nan),
            time=time,
            position=(np.sin(time) + offset)[:, None],
            momentum=np.cos(time)[:, None],
            energy=0.5 + offset,
        )
        finished.append(made)
    return one, finished
