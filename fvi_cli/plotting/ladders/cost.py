"""Figures of cost: time and work against the error, and the cheapest runs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from matplotlib import rcParams
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from fvi_cli.effects.scene import Derivative
from fvi_cli.integrator.method_names import method_names
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.ladders.convergence import error_label
from fvi_cli.plotting.looks import CHEAPEST, Look, method_looks
from fvi_cli.plotting.panels import ladders
from fvi_cli.plotting.style import INK, journal_style
from fvi_cli.plotting.words import fraction_in_words, typeset_formulas
from fvi_cli.reports.kinds.cost import curve_name
from fvi_cli.studies.cost import CostRow, CostTable
from fvi_cli.studies.cost_curves import cost_curves, unbeaten

_COARSEST, _LEAST, _FINEST = 1.0, 1e-13, 2e-15  # errors; below _LEAST they are round-off
DERIVATIVE_NAMES: Mapping[Derivative, str] = {
    "caputo": "Caputo",
    "riemann-liouville": "Riemann–Liouville",
}
_LONGEST_EQUATION = 48
_THIN = 0.7  # width, in points, of lines of methods that are never the quickest
_TOLERANCE = Look(colour=INK, marker="*", has_line=False, size=5.0)


def cost_figures(name: str, tables: Sequence[CostTable]) -> dict[str, Figure]:
    """A figure for every experiment of a configuration, by the name of its files."""
    names = cost_figure_names(name, tables)
    return {title: cost_figure(table) for title, table in zip(names, tables, strict=True)}


def cost_figure_names(name: str, tables: Sequence[CostTable]) -> list[str]:
    """Names of the files: from the configuration if it has one experiment, else by experiment."""
    if len(tables) == 1:
        return [f"{name}-cost"]
    return [f"{table.experiment}-cost" for table in tables]


def cost_figure(table: CostTable) -> Figure:
    """Set-up plus stepping time, and history operations, against the error reached.

    Accuracy increases to the right. A run of a method is drawn if no other run of that method beats
    it. A broad line connects the runs that no run of any method beats. Lines of methods that are
    never the quickest are thin, those of baselines grey. Stars are searches for a tolerance with
    all their runs. There is no panel of work if no method sums over the past. A method whose errors
    are all round-off is exact by chance; it is named but not drawn.
    """
    everything = cost_curves(table)
    curves = [curve for curve in everything if not curve.is_exact_by_chance]
    names = method_names([case.method for case in table.cases])
    chance = [curve_name(one, names) for one in everything if one.is_exact_by_chance]
    looks = method_looks([case.method for case in table.cases])
    met = [
        (max(row.error, _FINEST), row.seconds)
        for row in table.by_tolerance
        if row.outcome == "met" and row.error > 0
    ]
    kinds: list[tuple[str, Callable[[CostRow], float], list[_Run]]] = [
        ("set-up and stepping time (s)", lambda row: row.seconds, met)
    ]
    if table.has_memory:
        kinds.append(("multiply-adds on the history", lambda row: row.history_operations, []))
    panels: list[Panel] = []
    slow: set[int] = set()
    for label, value, more in kinds:
        runs = [_unbeaten((_shown(p), value(p)) for p in _needed(c.points)) for c in curves]
        best = _unbeaten([*more, *chain(*runs)])
        slow = slow if panels else {k for k, own in enumerate(runs) if not {*own} & {*best}}
        found = []
        for k, (curve, own) in enumerate(zip(curves, runs, strict=True)):
            look = looks[curve.method.case].look
            look = replace(look, width=_THIN) if k in slow else look
            found.append(_curve(own, curve_name(curve, names), look))
        found += [_curve(best, "least of all runs", CHEAPEST)] if best else []
        found += [_curve(more, "for a tolerance", _TOLERANCE)] if more else []
        panels.append(Panel(curves=found, y=f"least {label}", has_slopes=False))
    remarks = ["thin: never of least time"]
    remarks += ["stars count too: Gauss for a tolerance, time of the whole search"] if met else []
    remarks += [f"exact here up to round-off, not drawn: {', '.join(chance)}"] if chance else []
    figure = ladders(
        panels,
        x=f"{error_label(table.norm, table.units)}, more accurate to the right",
        title="\n".join(remarks),
        above=False,
        shared=True,
    )
    with journal_style():
        figure.suptitle(_title(table), fontsize=rcParams["axes.labelsize"])
        figure.set_figheight(figure.get_figheight() + 0.55)
        errors = np.concatenate([curve.x for panel in panels for curve in panel.curves])
        wide = max(0.06 * math.log10(errors.max() / errors.min()), 0.3)
        left, right = min(errors.max() * 10**wide, 2 * _COARSEST), errors.min() / 10**wide
        figure.axes[0].set_xlim(left, right)
        base = 1000 if left / right > 1e6 else 10
        for axes in figure.axes:
            axes.xaxis.set_major_locator(LogLocator(base=base, numticks=12))
            axes.xaxis.set_minor_locator(LogLocator(base=10, numticks=30))
            axes.xaxis.set_minor_formatter(NullFormatter())
    return figure


_Run = tuple[float, float]  # error and cost


def _unbeaten(runs: Iterable[_Run]) -> list[_Run]:
    """The runs for which no cheaper run is as accurate; the coarsest first."""
    return unbeaten((run for run in runs if run[0] < _COARSEST and run[1] > 0), lambda run: run)


def _needed(points: Sequence[CostRow]) -> list[CostRow]:
    """The runs above round-off, and of the runs in round-off the one with the fewest steps."""
    reached = [p for p in points if _shown(p) <= _LEAST]
    first = sorted(reached, key=lambda p: (p.n_steps, p.seconds))[:1]
    return [*first, *(p for p in points if p not in reached)]


def _curve(runs: Sequence[_Run], label: str, look: Look) -> Curve:
    x, y = np.array(runs).reshape(-1, 2).T
    return Curve(x=x, y=y, label=label, look=look)


def _shown(point: CostRow) -> float:
    """The error for the axis, at least a hundredth of the floor, also for an error of 0."""
    return max(point.error, point.floor / 100, 1e-300)


def _title(table: CostTable) -> str:
    """The equation of motion if it is short, the orders, the kind of derivative, the time."""
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
    equation = typeset_formulas(text).replace(r"\,", r"\;")
    equation = re.sub(r"([A-Za-z])''", r"\\ddot{\1}", equation)
    return f"{equation}\n{below}"
