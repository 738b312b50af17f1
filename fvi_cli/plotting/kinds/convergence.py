"""Errors against step size, and what accuracy costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.plotting.draw import figure
from fvi_cli.plotting.kinds.members import distinguish, member_curves, titles_of
from fvi_cli.plotting.ladders import finish_ladders, ladder
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import method_looks, method_names
from fvi_cli.plotting.words import fraction_in_words
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import kind_title
from fvi_cli.studies.cost import CostRow, CostTable
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.norms import Norm

Study = tuple[Experiment, Sequence[FinishedRun]]

NORM_LABELS: dict[Norm, str] = {
    "max": r"$\mathrm{max}_k\,|x_k-x(t_k)|$",
    "final": "$|x_N-x(T)|$",
    "l2": r"$(\Sigma_k\,h_k\,|x_k-x(t_k)|^2)^{1/2}$",
}


def convergence_figure(studies: Sequence[Study]) -> Figure:
    """Draw the error of every run against its step size, a panel for each experiment and degree.

    Methods without a degree of their own, such as Gauss, are in every panel of their experiment.
    """
    titles = _titles([experiment for experiment, _ in studies])
    panels = [
        Panel(
            curves=error_curves(own, names=method_names([one.run.method for one in own])),
            title=f"{title}, degree {degree}" if degree else title,
            **_axes(experiment),
            **explained(own),
        )
        for title, (experiment, finished) in zip(titles, studies, strict=True)
        for degree, own in by_degree(finished).items()
    ]
    return _ladders(panels, sharey=len(studies) == 1)


def check_errors(finished: Sequence[FinishedRun]) -> None:
    """Raise :class:`NothingToDraw` where no run has an error and none was lost."""
    if not any(math.isfinite(one.error) or one.status != "ok" for one in finished):
        raise NothingToDraw("no error is known; write exact: 1 - cos(t), or a ladder")


def sweep_convergence_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the errors of members against the step size, one panel for each method."""
    having = [one for one in finished if is_measured(one) and one.error > 0]
    if not having:
        raise NothingToDraw("no member has an error above 0")
    found = distinguish(experiment.members, experiment.units)
    panels = []
    for case, title in method_names([one.run.method for one in having]).items():
        own = [one for one in having if one.run.method.case == case]
        ladders: dict[int, list[FinishedRun]] = {}
        for one in sorted(own, key=lambda one: one.run.step_size):
            if one.run.member is not None:
                ladders.setdefault(one.run.member.number, []).append(one)
        lines = [
            (
                rows[0],
                np.array([one.run.step_size for one in rows]),
                np.array([one.error for one in rows]),
            )
            for _, rows in sorted(ladders.items())
        ]
        curves, orders = member_curves(found, lines), explained(own)["orders"]
        panels.append(Panel(title=title, curves=curves, orders=orders, **_axes(experiment)))
    count = len(experiment.members)
    return _ladders(panels, sharey=True, **titles_of(found, count, experiment.members))


def _ladders(panels: Sequence[Panel], *, sharey: bool, **titles: Any) -> Figure:
    """A figure of ladders: one in a column, several in rows of two or three."""
    columns = min(len(panels), 2 if len(panels) in (2, 4) else 3)
    return figure(
        in_rows(panels, columns),
        ladder,
        height=2.9 if columns < 3 else 2.2,
        is_wide=columns > 1,
        sharey=sharey,
        finish=finish_ladders,
        **titles,
    )


def in_rows(panels: Sequence[Any], columns: int) -> list[list[Any]]:
    """Panels in rows; places of the last one are left empty."""
    padded = [*panels, *[None] * (-len(panels) % columns)]
    return [padded[k : k + columns] for k in range(0, len(padded), columns)]


def by_degree(finished: Sequence[FinishedRun]) -> dict[int, list[FinishedRun]]:
    """The runs of every degree of BDF; 0 where there is only one."""
    degrees = {one: _degree(one.run.method) for one in finished}
    every = sorted(set(degrees.values()) - {0})
    if len(every) < 2:
        return {0: list(finished)}
    return {degree: [one for one in finished if degrees[one] in (0, degree)] for degree in every}


def _degree(method: AnyMethod) -> int:
    """The degree of a BDF method; 0 of methods that have no choice of it."""
    return 0 if isinstance(method, Baseline) or method.is_runge_kutta else method.degree


def error_curves(finished: Sequence[FinishedRun], names: Mapping[str, str]) -> list[Curve]:
    """Errors by method over the step size; lines are broken where a run has none.

    An error of exactly zero is drawn below the floor.
    """
    by_case: dict[str, list[FinishedRun]] = {}
    for item in sorted(finished, key=lambda item: item.run.step_size):
        by_case.setdefault(item.run.method.case, []).append(item)
    looks = method_looks([item.run.method for item in finished])
    return [
        Curve(
            x=np.array([one.run.step_size for one in rows]),
            y=np.array(
                [max(one.error, one.floor / 100) if is_measured(one) else np.nan for one in rows]
            ),
            label=names[case],
            look=looks[case],
            lost=[one.run.step_size for one in rows if not is_measured(one)],
        )
        for case, rows in by_case.items()
    ]


def is_measured(one: FinishedRun) -> bool:
    """Whether a run has an error that is drawn."""
    return one.status in ("ok", "floor") and math.isfinite(one.error)


def explained(finished: Sequence[FinishedRun]) -> dict[str, Any]:
    """Orders of theory and of the source for a panel, and the floor if a run reaches it."""
    able = [one for one in finished if one.status == "ok"]
    finest = {one.run.method: one for one in sorted(able, key=lambda one: -one.run.step_size)}
    stated = (one.run.experiment.claim(one.run.method) for one in finest.values())
    claims = {claim for claim in stated if claim is not None}
    orders = {one.order_smooth for one in finest.values() if math.isfinite(one.order_smooth)}
    floors = [one.floor for one in finished if is_measured(one) and one.error < one.floor]
    return {
        "orders": sorted(orders),
        "stated": sorted(claims - orders),
        "floor": max(floors, default=0.0),
    }


def _axes(experiment: Experiment) -> dict[str, Any]:
    return {"x": step_label(experiment), "y": _error_label(experiment)}


def step_label(experiment: Experiment) -> str:
    """The label of the axis of step sizes; for graded meshes these are means."""
    words = "step size $h$" if experiment.grading == 1.0 else "mean step size $h=T/N$"
    return with_unit(words, experiment.units, "time")


def _error_label(experiment: Experiment) -> str:
    """The label of the axis of errors."""
    label, units = f"error {NORM_LABELS[experiment.norm]}", experiment.units
    if experiment.norm != "l2":
        return with_unit(label, units, "length")
    has_unit = {"length", "time"} <= units.keys()
    return rf"{label} ({units['length']} {units['time']}$^{{1/2}}$)" if has_unit else label


def _titles(experiments: Sequence[Experiment]) -> list[str]:
    """Kind and damping orders of every experiment; its name if others have the same."""
    titles = []
    for experiment in experiments:
        problem = experiment.problem
        title = kind_title(problem.kind)
        if problem.kind == "lagrangian" or (isinstance(problem, Problem) and problem.scene.laws):
            title = experiment.name.replace("-", " ")
        elif isinstance(problem, Problem) and problem.scene.damping:
            orders = dict.fromkeys(fraction_in_words(term.order) for term in problem.scene.damping)
            title += rf", $\gamma = {', '.join(orders)}$"
        titles.append(title)
    return [
        title if titles.count(title) == 1 else experiment.name
        for title, experiment in zip(titles, experiments, strict=True)
    ]


def cost_figures(name: str, tables: Sequence[CostTable]) -> dict[str, Figure]:
    """Least time, and history operations, against the error; a row for every experiment."""
    costs: dict[str, Callable[[CostRow], float]] = {"least time (s)": lambda row: row.seconds}
    if any(row.history_operations for table in tables for row in table.rows):
        costs["multiply-adds on the history"] = lambda row: row.history_operations
    rows = [
        [
            Panel(
                curves=_cost_curves(table, cost),
                x=_error_label(table.experiment),
                y=label,
                title=table.experiment.name if len(tables) > 1 else "",
            )
            for label, cost in costs.items()
        ]
        for table in tables
    ]
    made = figure(rows, ladder, height=2.9, is_wide=len(costs) > 1, finish=finish_ladders)
    return {f"{name}-cost": made}


def _cost_curves(table: CostTable, cost: Callable[[CostRow], float]) -> list[Curve]:
    """The runs of every method as points of error and cost; an error of 0 is below the floor."""
    methods = [row.run.method for row in table.rows]
    looks, names, curves = method_looks(methods), method_names(methods), []
    for case in looks:
        rows = [r for r in table.rows if r.run.method.case == case and r.is_usable and cost(r) > 0]
        if rows:
            errors = np.array([max(r.error, r.floor / 100) for r in rows])
            costs = np.array([float(cost(r)) for r in rows])
            curves.append(Curve(x=errors, y=costs, label=names[case], look=looks[case]))
    return curves
