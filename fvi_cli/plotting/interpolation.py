"""Sketch of the discrete trajectory: polynomials on steps, control and quadrature points."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.method import RuleSpecification
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.plotting.style import (
    COLOURS,
    GUIDE_COLOUR,
    INK,
    SMALL_TEXT,
    journal_style,
    new_figure,
)

_N_STEPS = 3
_DEGREE = 2
_HIGHEST = 1.45


def interpolation_figure() -> Figure:
    """Draw how a Galerkin variational integrator of degree s = 2 sees a curve.

    On every step a polynomial of degree s through s + 1 Lobatto control points, the outer two
    shared with the neighbours, and the s Gauss points at which the Lagrangian is evaluated.
    The polynomials stay away from the curve, so that the eye can tell them apart.
    """
    quadrature = RuleSpecification(points=_DEGREE).build()
    basis = lobatto_basis(_DEGREE)
    control = basis.control_points
    tau = np.linspace(0.0, 1.0, 101)
    # any values will do for a sketch; these make the kinks at the nodes visible
    main = _smooth(np.arange(_N_STEPS + 1.0)) + np.array([-0.07, 0.12, -0.1, 0.06])
    with journal_style():
        figure = new_figure(2.45)
        axes = figure.subplots()
        time = np.linspace(-0.12, _N_STEPS + 0.12, 301)
        axes.plot(time, _smooth(time), color=GUIDE_COLOUR, linestyle=(0, (4, 2)), label="$x(t)$")
        for step in range(_N_STEPS):
            values = _smooth(step + control) + (0.1, -0.17, 0.2)[step]
            values[0], values[-1] = main[step], main[step + 1]
            at_points = values @ basis.values(quadrature.nodes)
            axes.plot(
                step + tau,
                values @ basis.values(tau),
                color=COLOURS[0],
                linewidth=1.5,
                label="$x_d(t)$, degree $s$" if step == 0 else "_piece",
                zorder=3,
            )
            _draw_points(axes, step, quadrature.nodes, at_points, is_first=step == 0)
            axes.plot(
                step + control[1:-1],
                values[1:-1],
                linestyle="none",
                marker="o",
                markersize=5,
                markerfacecolor="white",
                markeredgecolor=COLOURS[1],
                markeredgewidth=1.2,
                label="inner control points" if step == 0 else "_inner",
                zorder=5,
            )
            if step == 1:
                _name_controls(axes, control, values)
        axes.plot(
            np.arange(_N_STEPS + 1),
            main,
            linestyle="none",
            marker="o",
            markersize=5,
            markerfacecolor=COLOURS[1],
            markeredgecolor=COLOURS[1],
            label="control points at nodes",
            zorder=5,
        )
        _dress(axes)
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def _smooth(time: Array) -> Array:
    return np.asarray(0.85 + 0.27 * np.sin(1.9 * time - 0.6) + 0.03 * time)


def _draw_points(axes: Axes, step: int, nodes: Array, values: Array, *, is_first: bool) -> None:
    for node, value in zip(nodes, values, strict=True):
        axes.plot(
            [step + node] * 2,
            [0.0, value],
            color=COLOURS[2],
            linewidth=0.6,
            linestyle=(0, (1, 1.5)),
            label="_drop",
            zorder=1.5,
        )
    axes.plot(
        step + nodes,
        values,
        linestyle="none",
        marker="x",
        markersize=5,
        markeredgewidth=1.3,
        color=COLOURS[2],
        label="quadrature points" if is_first else "_points",
        zorder=6,
    )
    if step == 1:
        for index, node in enumerate(nodes, start=1):
            axes.annotate(
                f"$c_{{{index}}}h$",
                xy=(step + node, 0.0),
                xytext=(-1.5 if index == nodes.size else 1.5, 2),
                textcoords="offset points",
                ha="right" if index == nodes.size else "left",
                va="bottom",
                fontsize=SMALL_TEXT,
                color=COLOURS[2],
            )


def _name_controls(axes: Axes, control: Array, values: Array) -> None:
    last = control.size - 1
    for index, (place, value) in enumerate(zip(control, values, strict=True)):
        name = {0: "x_k = x_k^0", last: f"x_k^{{{last}}} = x_{{k+1}}"}.get(
            index, f"x_k^{{{index}}}"
        )
        axes.annotate(
            f"${name}$",
            xy=(1 + place, value),
            xytext=(4, 6) if index == 0 else (-3, -6),
            textcoords="offset points",
            ha="left" if index == 0 else "right",
            va="bottom" if index == 0 else "top",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.2},
            zorder=2,
            fontsize=SMALL_TEXT,
        )


def _dress(axes: Axes) -> None:
    """Bare axis of time with the grid, and the length of one step."""
    axes.set_xlim(-0.2, _N_STEPS + 0.2)
    axes.set_ylim(0.0, _HIGHEST)
    for side in ("left", "right", "top"):
        axes.spines[side].set_visible(False)
    axes.tick_params(top=False, right=False, left=False, labelleft=False, direction="out")
    axes.set_xticks(range(_N_STEPS + 1), ["$t_{k-1}$", "$t_k$", "$t_{k+1}$", "$t_{k+2}$"])
    axes.annotate(
        "",
        xy=(0, 0.17),
        xytext=(1, 0.17),
        arrowprops={
            "arrowstyle": "<->",
            "linewidth": 0.7,
            "color": INK,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )
    axes.text(0.5, 0.2, "$h$", ha="center", va="bottom")
    for node in range(_N_STEPS + 1):
        axes.axvline(node, color="#cccccc", linewidth=0.5, zorder=0.5, label="_grid")
