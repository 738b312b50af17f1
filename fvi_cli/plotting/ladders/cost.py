"""What accuracy costs, as a picture: time and work against the error, and who is cheapest."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from fvi_cli.effects.scene import Derivative
from fvi_cli.integrator.method_names import method_names
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.ladders.convergence import error_label
from fvi_cli.plotting.looks import Look, MethodLook, method_looks
from fvi_cli.plotting.panels import ladders
from fvi_cli.plotting.slopes import make_room
from fvi_cli.plotting.style import DECORATION, INK, journal_style, label_size, note, text_width
from fvi_cli.plotting.ticks import logarithmic_ticks
from fvi_cli.plotting.words import fraction_in_words
from fvi_cli.reports.kinds.cost import curve_name
from fvi_cli.reports.writers.equations import to_mathematics
from fvi_cli.studies.cost import CostRow, CostTable
from fvi_cli.studies.cost_curves import Band, CostCurve, cheapest_bands, cost_curves

FRONT_COLOUR = "#f6d27c"
_COARSEST, _FINEST = 3.0, 2e-15
DERIVATIVE_NAMES: Mapping[Derivative, str] = {
    "caputo": "Caputo",
    "riemann-liouville": "Riemann–Liouville",
}
_STRIP = 0.1  # of a panel's height
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

    Accuracy grows to the right. The strip on top of the panel of times names the cheapest method
    at every accuracy, whose runs have a broad line behind them. Baselines are grey. Stars are
    searches for a tolerance with all their runs. Where no method sums over the past there is no
    panel of work. A method that has nothing but round-off from the coarsest step on is exact by
    chance; it is named and not drawn.
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
    panels = [_panel("set-up and stepping, seconds", curves, own, lambda point: point.seconds)]
    met = [row for row in table.by_tolerance if row.outcome == "met" and row.error > 0]
    if met:
        errors = np.array([max(row.error, _FINEST) for row in met])
        seconds = np.array([row.seconds for row in met])
        found = Curve(x=errors, y=seconds, label="by tolerance", look=_TOLERANCE)
        panels = [Panel(curves=[*panels[0].curves, found], y=panels[0].y, has_slopes=False)]
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
        times = figure.axes[0]
        errors = np.concatenate([curve.x for panel in panels for curve in panel.curves])
        wide = max(0.06 * math.log10(errors.max() / errors.min()), 0.3)
        times.set_xlim(min(errors.max() * 10**wide, 2 * _COARSEST), errors.min() / 10**wide)
        decades = math.log10(times.get_xlim()[0] / times.get_xlim()[1])
        for axes in figure.axes[: len(panels)]:
            axes.xaxis.set_major_locator(LogLocator(base=1000 if decades > 6 else 10, numticks=12))
            axes.xaxis.set_minor_locator(LogLocator(base=10, numticks=30))
            axes.xaxis.set_minor_formatter(NullFormatter())
            logarithmic_ticks(axes.yaxis, 8)
        bands = cheapest_bands(curves)
        for band in bands:
            _draw_front(times, band)
        times.set_title("cheapest method (broad line):", loc="left", fontsize="small", pad=2.5)
        figure.draw_without_rendering()
        _draw_bands(times, bands, own)
    return figure


def _panel(
    label: str,
    curves: Sequence[CostCurve],
    looks: Mapping[str, MethodLook],
    value: Callable[[CostRow], float],
) -> Panel:
    found = []
    for curve in curves:
        drawn = [p for p in curve.points if value(p) > 0 and _shown(p) < _COARSEST]
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


def _draw_front(axes: Axes, band: Band) -> None:
    """A broad line behind those runs of the cheapest method in its band that it does not beat."""
    own = [
        p
        for p in band.curve.points
        if band.fine <= _shown(p) <= band.coarse
        and not any(q.error <= p.error and q.seconds < p.seconds for q in band.curve.points)
    ]
    line = axes.plot([_shown(p) for p in own], [p.seconds for p in own], color=FRONT_COLOUR)[0]
    # one run alone is a broad dot
    line.set(linewidth=6, marker="o", markersize=6, markeredgewidth=0, zorder=1)
    line.set(label="_cheapest", solid_capstyle="round")


def _draw_bands(axes: Axes, bands: Sequence[Band], looks: Mapping[str, MethodLook]) -> None:
    """A strip at the top with the name, or where that has no room the mark, of the cheapest."""
    make_room(axes, _STRIP)
    axes.yaxis.set_minor_locator(NullLocator())
    coarse, fine = axes.get_xlim()
    inches = axes.get_window_extent().width / axes.figure.dpi
    bottom, whole = 1 - _STRIP, math.log10(coarse / fine)

    def draw(left: float, right: float, colour: str, alpha: float) -> None:
        box = Rectangle((left, bottom), right - left, _STRIP, transform=axes.transAxes, alpha=alpha)
        box.set(facecolor=colour, edgecolor="white", linewidth=0.8)
        axes.add_patch(box)

    draw(0, 1, "#f4f4f4", 1.0)
    for band in bands:
        left, right = (
            min(max(math.log10(coarse / error) / whole, 0.0), 1.0)
            for error in (band.coarse, band.fine)
        )
        own = looks[band.curve.key]
        draw(left, right, own.look.colour, 0.3)
        edge = axes.plot([right, right], [0, 1], transform=axes.transAxes, **DECORATION)[0]
        edge.set(color="#bbbbbb", linewidth=0.5, label="_edge", zorder=0.5)
        middle, height = (left + right) / 2, bottom + _STRIP / 2
        if text_width(own.label) < (right - left) * inches - 0.03:
            note(axes, middle, height, own.label)
        elif (right - left) * inches > 0.07:
            mark = axes.plot(
                [middle], [height], transform=axes.transAxes, **DECORATION, **own.look.properties()
            )[0]
            mark.set(label="_mark", linestyle="none")
