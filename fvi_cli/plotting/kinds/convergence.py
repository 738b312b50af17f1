"""Errors against step size, and what accuracy costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.draw import figure, finish_ladders, ladder
from fvi_cli.plotting.kinds.runs import by_degree, distinguish, mean_of, members_apart
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import method_words
from fvi_cli.plotting.words import fraction_in_words
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.cost import CostRow, CostTable
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.norms import Norm

Study = tuple[Experiment, Sequence[FinishedRun]]

_FINEST, _NEAR = 3, 0.07  # steps that tell the order of a curve, and how near it is, relative

NORM_LABELS: dict[Norm, str] = {
    "max": r"$\mathrm{max}_k\,|x_k-x(t_k)|$",
    "final": "$|x_N-x(T)|$",
    "l2": r"$(\Sigma_k\,h_k\,|x_k-x(t_k)|^2)^{1/2}$",
}


def convergence_figure(studies: Sequence[Study]) -> Figure:
    """Draw the error of every run against its step size, a panel for each experiment and degree.

    Methods without a degree of their own, such as Gauss, are in every panel of their experiment.
    """
    panels = [
        _ladder(experiment, own, title=_title(experiment, degree, has_name=len(studies) > 1))
        for experiment, finished in studies
        for degree, own in by_degree(finished).items()
    ]
    return _ladders(panels, sharey=len(studies) == 1)


def _title(experiment: Experiment, degree: str, *, has_name: bool) -> str:
    """Degree and order of the damping if it is one, and the experiment where several are drawn."""
    scene = experiment.problem.scene
    found = {term.order for term in scene.active_damping} if scene else set()
    order = rf"$\gamma={fraction_in_words(found.pop())}$" if len(found) == 1 else ""
    return ", ".join(filter(None, [experiment.name * has_name, degree, order]))


def has_errors(finished: Sequence[FinishedRun]) -> bool:
    """Whether a run has an error above 0, or was lost."""
    return any(one.error > 0 or one.status not in ("ok", "floor") for one in finished)


def sweep_convergence_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the errors of members against the step size, one panel for each method."""
    if not any(is_measured(one) and one.error > 0 for one in finished):
        raise NothingToDraw("no error is known; write exact: 1 - cos(t), or a ladder")
    panels = []
    for case, method in method_words([one.run.method for one in finished]).items():
        own = [one for one in finished if one.run.method.case == case]
        groups = members_apart(own)
        words, titles = distinguish([rows[0].run.member for rows in groups], experiment.units)
        curves = list(map(_curve, groups, words))
        curves += mean_of(curves)
        panels.append(_ladder(experiment, own, title=method["label"], curves=curves))
    return _ladders(panels, sharey=True, **titles)


def _ladder(experiment: Experiment, finished: Sequence[FinishedRun], **options: Any) -> Panel:
    """A panel of errors over step sizes, with slopes and floor; by default of every method."""
    curves = options.pop("curves", None) or error_curves(finished)
    x, y = step_label(experiment), _error_label(experiment)
    usual = {"curves": curves, "x": x, "y": y, **_explained(finished, curves)}
    return Panel(**usual | options)


def _ladders(panels: Sequence[Panel], *, sharey: bool, **titles: Any) -> Figure:
    """A figure of ladders: one in a column, several in rows of two or three."""
    columns = min(len(panels), 2 if len(panels) in (2, 4) else 3)
    titles |= {"columns": columns, "height": 2.9 if columns < 3 else 2.2, "sharey": sharey}
    return figure(panels, ladder, finish=finish_ladders, **titles)


def error_curves(finished: Sequence[FinishedRun]) -> list[Curve]:
    """Errors by method over the step size."""
    words = method_words([one.run.method for one in finished])
    return [
        _curve([one for one in finished if one.run.method.case == case], own)
        for case, own in words.items()
    ]


def _curve(finished: Sequence[FinishedRun], words: Mapping[str, Any]) -> Curve:
    """Errors over step sizes, broken where a run has none; one of 0 is below the floor."""
    rows = sorted(finished, key=lambda one: one.run.step_size)
    errors = [max(one.error, one.floor / 100) if is_measured(one) else np.nan for one in rows]
    sizes = np.array([one.run.step_size for one in rows])
    return Curve(x=sizes, y=np.array(errors), lost=sizes[np.isnan(errors)].tolist(), **words)


def is_measured(one: FinishedRun) -> bool:
    """Whether a run has an error that is drawn."""
    return one.status in ("ok", "floor") and math.isfinite(one.error)


def _explained(finished: Sequence[FinishedRun], curves: Sequence[Curve]) -> dict[str, Any]:
    """Orders that the finest runs of curves have, those of the source, and the floor if reached."""
    able = [one for one in finished if one.status == "ok"]
    finest = {one.run.method: one for one in sorted(able, key=lambda one: -one.run.step_size)}
    stated = (one.run.experiment.claim(one.run.method) for one in finest.values())
    claims = {claim for claim in stated if not math.isnan(claim)}
    floors = [one.floor for one in finished if is_measured(one) and one.error < one.floor]
    theory = {one.order_smooth for one in finest.values() if math.isfinite(one.order_smooth)}
    floor, orders = max(floors, default=0.0), set()
    for one in curves:
        x, y = one.x[one.y > floor], one.y[one.y > floor]
        slopes = np.diff(np.log(y)) / np.diff(np.log(x))
        slope = np.median(slopes[:_FINEST]) if x.size > 1 else 0.0
        usual = (*theory, round(2.0 * slope) / 2.0)  # where theory has no order, halves
        orders |= set([order for order in usual if abs(slope - order) < _NEAR * order][:1])
    return {"orders": sorted(orders), "stated": sorted(claims - orders), "floor": floor}


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


def saturation_figure(studies: Sequence[Study]) -> Figure:
    r"""Draw the error of convolution quadrature of :math:`D^\gamma f`, a row for every norm.

    For :math:`f \sim t^b` at 0 the order is :math:`\min(p, b-\gamma)` in the maximum norm over
    the grid and :math:`\min(p, b+1)` at a fixed time (Lubich, *Discretized fractional calculus*,
    1986). There is a column for every b.
    """
    found: dict[Norm, dict[float, tuple[Experiment, list[FinishedRun]]]] = {}
    for experiment, finished in studies:
        row = found.setdefault(experiment.norm, {})
        row.setdefault(_exponent(experiment), (experiment, []))[1].extend(finished)
    columns = sorted({b for row in found.values() for b in row})
    drawn = [
        _saturation(*row[b], b) if b in row else None for row in found.values() for b in columns
    ]
    count, high = len(columns), 1.68 if len(columns) > 2 else 2.6
    return figure(drawn, ladder, columns=count, height=high, sharex=True, finish=finish_ladders)


def _saturation(experiment: Experiment, rows: Sequence[FinishedRun], b: float) -> Panel:
    """The ladders of one exponent in one norm, with the highest slope up to the limit."""
    order, end = getattr(experiment.problem, "order", math.nan), experiment.problem.final_time
    where = {"max": "largest", "l2": "mean square", "final": f"at $t={end:g}$"}
    power = f"^{{{fraction_in_words(order)}}}"
    title, y = f"{where[experiment.norm]}, $b={b:g}$", f"$|D_h{power}f-D{power}f|$"
    panel = _ladder(experiment, rows, title=title, y=y)
    limit = {"max": b - order, "l2": b - order + 0.5, "final": b + 1.0}[experiment.norm]
    return replace(panel, orders=[one for one in panel.orders if one <= limit][-1:])


def _exponent(experiment: Experiment) -> float:
    """The b of f(t) ~ c t^b at 0, from the function itself, to three decimals."""
    problem = experiment.problem
    if not isinstance(problem, DerivativeProblem):
        return math.nan
    near = problem.final_time * np.array([1e-6, 1e-5])
    values = np.abs(problem.function(near)).reshape(2, -1)[:, 0]
    return round(math.log10(values[1] / values[0]), 3) if np.all(values > 0) else math.nan


def cost_figures(name: str, tables: Sequence[CostTable]) -> dict[str, Figure]:
    """Least time, and history operations, against the error; a row for every experiment."""
    costs: dict[str, Callable[[CostRow], float]] = {"least time (s)": lambda row: row.seconds}
    if any(_operations(row) for table in tables for row in table.rows):
        costs["multiply-adds on the history"] = _operations
    panels = [
        Panel(
            curves=_cost_curves(table, cost),
            x=_error_label(table.experiment),
            y=label,
            title=table.experiment.name if len(tables) > 1 else "",
        )
        for table in tables
        for label, cost in costs.items()
    ]
    made = figure(panels, ladder, columns=len(costs), height=2.9, finish=finish_ladders)
    return {f"{name}-cost": made}


def _operations(row: CostRow) -> float:
    return row.finished.trajectory.history_operations


def _cost_curves(table: CostTable, cost: Callable[[CostRow], float]) -> list[Curve]:
    """The runs of every method as points of error and cost; an error of 0 is below the floor."""
    curves = []
    for case, words in method_words([row.finished.run.method for row in table.rows]).items():
        own = [row for row in table.rows if row.finished.run.method.case == case]
        pairs = [
            (max(row.finished.error, row.finished.floor / 100), cost(row))
            for row in own
            if row.is_usable and cost(row) > 0
        ]
        if pairs:
            x, y = np.array(pairs).T
            curves.append(Curve(x=x, y=y, **words))
    return curves
