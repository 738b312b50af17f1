"""What accuracy costs, as a picture: time and work against the error, and what is cheapest."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from fvi_cli.effects.scene import Derivative
from fvi_cli.integrator.method_names import method_names
from fvi_cli.plotting.curves import Curve, Panel, take_turns
from fvi_cli.plotting.ladders.convergence import error_label
from fvi_cli.plotting.looks import CHEAPEST, Look, MethodLook, method_looks
from fvi_cli.plotting.panels import ladders
from fvi_cli.plotting.style import INK, journal_style, label_size
from fvi_cli.plotting.ticks import logarithmic_ticks
from fvi_cli.plotting.words import fraction_in_words
from fvi_cli.reports.kinds.cost import curve_name
from fvi_cli.reports.writers.equations import to_mathematics
from fvi_cli.studies.cost import CostRow, CostTable
from fvi_cli.studies.cost_curves import CostCurve, cost_curves, pareto_front

_COARSEST, _LEAST, _FINEST = 3.0, 1e-13, 2e-15
DERIVATIVE_NAMES: Mapping[Derivative, str] = {
    "caputo": "Caputo",
    "riemann-liouville": "Riemann–Liouville",
}
_LONGEST_EQUATION = 48
_TOLERANCE = Look(colour=INK, marker="*", dashes=(0, (1, 1)), width=0.8, size=5.0)


def cost_figures(name: str, tables: Sequence[CostTable]) -> dict[str, Figure]:
    """A figure for every experiment of a configuration, by the name of its files."""
    names = cost_figure_names(name, tables)
    return {title: cost_figure(table) for title, table in zip(names, tables, strict=True)}


def cost_figure_names(name: str, tables: Sequence[CostTable]) -> list[str]:
    """Names of the files: of the configuration where it has one experiment, or of experiments."""
    if len(tables) == 1:
        return [f"{name}-cost"]
    return [f"{table.experiment}-cost" for table in tables]


def cost_figure(table: CostTable) -> Figure:
    """Set-up plus stepping time, and history operations, against the error reached.

    Accuracy grows to the right. Runs that no other beats in both error and time have a broad
    line behind them. Baselines are grey. Stars are searches for a tolerance with all their runs.
    Where no method sums over the past there is no panel of work. A method that has nothing but
    round-off from the coarsest step on is exact by chance; it is named and not drawn.
    """
    everything = cost_curves(table)
    curves = [curve for curve in everything if not curve.is_exact_by_chance]
    names = method_names([case.method for case in table.cases])
    chance = [curve_name(one, names) for one in everything if one.is_exact_by_chance]
    looks = method_looks([case.method for case in table.cases])
    own = {
        one.key: MethodLook(label=curve_name(one, names), look=looks[one.methods[0].case].look)
        for one in curves
    }
    runs = [run for _, run in pareto_front(curves) if run.error < _COARSEST]
    # less than that is round-off, which no run need beat
    runs = runs[:1] + [fine for coarse, fine in pairwise(runs) if coarse.error > _LEAST]
    front = [(_shown(run), run.seconds) for run in runs]
    met = [
        (max(row.error, _FINEST), row.seconds)
        for row in table.by_tolerance
        if row.outcome == "met" and row.error > 0
    ]
    times = _panel("set-up and stepping time (s)", curves, own, lambda point: point.seconds)
    more = (("quickest to its error", CHEAPEST, front), ("with a tolerance", _TOLERANCE, met))
    added = [
        Curve(x=np.array(xy)[:, 0], y=np.array(xy)[:, 1], label=label, look=look)
        for label, look, xy in more
        if xy
    ]
    panels = [replace(times, curves=[*times.curves, *added])]
    if table.has_memory:
        label = "multiply-adds on the history"
        panels.append(_panel(label, curves, own, lambda point: float(point.history_operations)))
    words = f"exact here up to round-off, not drawn: {', '.join(chance)}" if chance else ""
    figure = ladders(
        panels,
        x=f"{error_label(table.norm, table.units)}, more accurate to the right",
        title=words,
        above=False,
        shared=True,
    )
    with journal_style():
        figure.suptitle(_title(table), fontsize=label_size())
        figure.set_figheight(figure.get_figheight() + 0.55)
        errors = np.concatenate([curve.x for panel in panels for curve in panel.curves])
        wide = max(0.06 * math.log10(errors.max() / errors.min()), 0.3)
        left, right = min(errors.max() * 10**wide, 2 * _COARSEST), errors.min() / 10**wide
        figure.axes[0].set_xlim(left, right)
        base = 1000 if left / right > 1e6 else 10
        for axes in figure.axes[: len(panels)]:
            axes.xaxis.set_major_locator(LogLocator(base=base, numticks=12))
            axes.xaxis.set_minor_locator(LogLocator(base=10, numticks=30))
            axes.xaxis.set_minor_formatter(NullFormatter())
            logarithmic_ticks(axes.yaxis, 8)
            take_turns(axes)
    return figure


def _panel(
    label: str,
    curves: Sequence[CostCurve],
    looks: Mapping[str, MethodLook],
    value: Callable[[CostRow], float],
) -> Panel:
    found = []
    for curve in curves:
        points = curve.unbeaten if curve.is_by_tolerance else curve.points
        drawn = [p for p in points if value(p) > 0 and _shown(p) < _COARSEST]
        own = looks[curve.key]
        x, y = np.array([(_shown(p), value(p)) for p in drawn]).reshape(-1, 2).T
        found.append(Curve(x=x, y=y, label=own.label, look=own.look))
    return Panel(curves=found, y=label, has_slopes=False)


def _shown(point: CostRow) -> float:
    """An error of exactly 0 stands at the unit of round-off."""
    return max(point.error, point.floor / 100, 1e-300)


def _title(table: CostTable) -> str:
    """The equation of motion where it is short, the orders, whose derivative it is, the time."""
    orders = [float(order) for order in table.gamma.split(";") if order != "-"]
    words = [rf"$\gamma = {', '.join(map(fraction_in_words, orders))}$"] if orders else []
    if any(order != 1 for order in orders):
        words.append(f"{DERIVATIVE_NAMES[table.derivative]} derivative")
    words.append(f"$T = {table.final_time:g}$ {table.units.get('time', '')}".rstrip())
    below = ", ".join(words)
    if len(table.equation) > _LONGEST_EQUATION:
        return below
    is_single = len(orders) == 1 and not table.has_laws
    text = table.equation.replace("sum ", "") if is_single else table.equation
    equation = "".join(f"${part}$" if maths else part for part, maths in to_mathematics(text))
    equation = re.sub(r"([A-Za-z])''", r"\\ddot{\1}", re.sub(r"\\,", r"\\;", equation))
    return f"{equation}\n{below}"
