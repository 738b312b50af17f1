"""The figure of cost: time and work against the error."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.ladders.convergence import error_label
from fvi_cli.plotting.looks import method_looks
from fvi_cli.plotting.panels import ladders
from fvi_cli.studies.cost import CostRow, CostTable

Cost = Callable[[CostRow], float]


def cost_figures(name: str, tables: Sequence[CostTable]) -> dict[str, Figure]:
    """The figure of a configuration, by the name of its file."""
    return {f"{name}-cost": cost_figure(tables)}


def cost_figure(tables: Sequence[CostTable]) -> Figure:
    """Least time, and history operations, against the error reached; accuracy to the right.

    A row of panels for every experiment; none for work where no method sums over the past.
    """
    costs: list[tuple[str, Cost]] = [("least time (s)", lambda row: row.seconds)]
    if any(row.history_operations for table in tables for row in table.rows):
        costs.append(("multiply-adds on the history", lambda row: row.history_operations))
    panels = [
        Panel(
            curves=_curves(table, cost),
            y=label,
            x=error_label(table.experiment.norm, table.experiment.units, table.experiment.grading),
            title=table.experiment.name if len(tables) > 1 else "",
            has_slopes=False,
        )
        for table in tables
        for label, cost in costs
    ]
    figure = ladders(panels, columns=len(costs))
    for axes in figure.axes:
        axes.invert_xaxis()
    return figure


def _curves(table: CostTable, cost: Cost) -> list[Curve]:
    """The runs of every method as points of error and cost."""
    curves = []
    for case, look in method_looks([row.run.method for row in table.rows]).items():
        rows = [r for r in table.rows if r.run.method.case == case and r.is_usable and cost(r) > 0]
        # an error of 0 is drawn below the floor
        errors = np.array([max(r.error, r.floor / 100) for r in rows])
        costs = np.array([float(cost(r)) for r in rows])
        if rows:
            curves.append(Curve(x=errors, y=costs, label=look.label, look=look.look))
    return curves
