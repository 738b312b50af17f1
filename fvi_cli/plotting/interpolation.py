"""Sketch of the discrete trajectory: polynomials on steps, control and quadrature points."""

from __future__ import annotations

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.method import RuleSpecification
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.plotting.style import (
    COLOURS,
    GUIDE_COLOUR,
    INK,
    journal_style,
    legend_of,
    new_figure,
)

_N_STEPS = 3
_DEGREE = 2
_HIGHEST = 1.45


@journal_style()
def interpolation_figure() -> Figure:
    """Draw how a Galerkin variational integrator of degree s = 2 approximates a curve.

    Every step has a polynomial of degree s through s + 1 Lobatto control points, the outer two
    shared with the neighbours, and s Gauss points at which the Lagrangian is evaluated. The
    polynomials are drawn at a distance from the curve, so that both are visible.
    """
    nodes = RuleSpecification(points=_DEGREE).build().nodes
    basis = lobatto_basis(_DEGREE)
    control, tau = basis.control_points, np.linspace(0.0, 1.0, 101)
    # arbitrary values, which make the kinks at the nodes visible
    main = _smooth(np.arange(_N_STEPS + 1.0)) + np.array([-0.07, 0.12, -0.1, 0.06])
    figure = new_figure(2.0)
    axes = figure.subplots()
    time = np.linspace(-0.12, _N_STEPS + 0.12, 301)
    axes.plot(time, _smooth(time), color=GUIDE_COLOUR, linestyle=(0, (4, 2)), label="$x(t)$")
    for step in range(_N_STEPS):
        values = _smooth(step + control) + (0.1, -0.17, 0.2)[step]
        values[0], values[-1] = main[step], main[step + 1]
        at_points = values @ basis.values(nodes)
        label = "$x_d(t)$, degree $s = 2$" if step == 0 else "_piece"
        piece = axes.plot(step + tau, values @ basis.values(tau), color=COLOURS[0], label=label)[0]
        piece.set(linewidth=1.5, zorder=3)
        for node, value in zip(nodes, at_points, strict=True):
            drop = axes.plot([step + node] * 2, [0.0, value], color=COLOURS[2], label="_drop")[0]
            drop.set(linewidth=0.6, linestyle=(0, (1, 1.5)), zorder=1.5)
        label = "quadrature points" if step == 0 else "_points"
        _mark(axes, step + nodes, at_points, "x", COLOURS[2], label)
        label = "inner control points" if step == 0 else "_inner"
        _mark(axes, step + control[1:-1], values[1:-1], "o", COLOURS[1], label, face="white")
        if step == 1:
            _name_points(axes, nodes, control, values)
    label = "control points at nodes"
    _mark(axes, np.arange(_N_STEPS + 1.0), main, "o", COLOURS[1], label, face=COLOURS[1])
    _dress(axes)
    legend_of(figure, axes.get_legend_handles_labels()[0])
    return figure


def _smooth(time: Array) -> Array:
    return np.asarray(0.85 + 0.27 * np.sin(1.9 * time - 0.6) + 0.03 * time)


def _mark(
    axes: Axes, x: Array, y: Array, marker: str, colour: str, label: str, face: str = "none"
) -> None:
    line = axes.plot(x, y, marker, color=colour, label=label, markersize=5, zorder=5)[0]
    line.set(markerfacecolor=face, markeredgewidth=1.2)


def _name_points(axes: Axes, nodes: Array, control: Array, values: Array) -> None:
    """Label the points of the second step."""
    last = control.size - 1
    for index, node in enumerate(nodes, start=1):
        _measure(axes, (1.0, 1.0 + node), 0.02 + 0.15 * index, f"$c_{{{index}}}h$", COLOURS[2])
    for index, (place, value) in enumerate(zip(control, values, strict=True)):
        name = {0: "x_k = x_k^0", last: f"x_k^{{{last}}} = x_{{k+1}}"}.get(
            index, f"x_k^{{{index}}}"
        )
        offset, across, along = (
            ((4, 6), "left", "bottom") if index == 0 else ((-3, -6), "right", "top")
        )
        words = axes.annotate(f"${name}$", (1 + place, value), offset, ha=across, va=along)
        words.set(
            fontsize=rcParams["legend.fontsize"],
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.2},
        )
        words.set_zorder(2)
        words.anncoords = "offset points"


def _measure(axes: Axes, ends: tuple[float, float], height: float, words: str, colour: str) -> None:
    """Draw an arrow between two times with the name of its length."""
    arrow = {"arrowstyle": "<->", "linewidth": 0.7, "color": colour, "shrinkA": 0, "shrinkB": 0}
    arrow["mutation_scale"] = 7
    axes.annotate("", xy=(ends[0], height), xytext=(ends[1], height), arrowprops=arrow)
    text = axes.text(sum(ends) / 2, height + 0.02, words, ha="center", va="bottom", color=colour)
    text.set(fontsize=rcParams["legend.fontsize"])


def _dress(axes: Axes) -> None:
    """Reduce the axes to the time with its grid, and mark the length of one step."""
    axes.set_xlim(-0.2, _N_STEPS + 0.2)
    axes.set_ylim(0.0, _HIGHEST)
    axes.spines[["left", "right", "top"]].set_visible(False)
    axes.tick_params(top=False, right=False, left=False, labelleft=False, direction="out")
    axes.set_xticks(range(_N_STEPS + 1), ["$t_{k-1}$", "$t_k$", "$t_{k+1}$", "$t_{k+2}$"])
    _measure(axes, (0.0, 1.0), 0.17, "$h$", INK)
    for node in range(_N_STEPS + 1):
        axes.axvline(node, color="#cccccc", linewidth=0.5, zorder=0.5, label="_grid")
