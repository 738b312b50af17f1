"""Sketch of the discrete trajectory: polynomials on steps, control and quadrature points."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.method import RuleSpecification
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import COLOURS, GREY, INK, PALE, Look

_N_STEPS, _DEGREE = 3, 2


def interpolation_figure() -> Figure:
    """Draw how a Galerkin variational integrator of degree s = 2 approximates a curve.

    Every step has a polynomial of degree s through s + 1 Lobatto control points, the outer two
    shared with the neighbours, and s Gauss points at which the Lagrangian is evaluated. The
    polynomials are drawn at a distance from the curve, so that both are visible.
    """
    nodes = RuleSpecification(points=_DEGREE).build().nodes
    basis, tau = lobatto_basis(_DEGREE), np.linspace(0.0, 1.0, 101)
    control, steps = basis.control_points, np.arange(_N_STEPS)[:, None]
    # arbitrary values, which make the kinks at the nodes visible
    main = _motion(np.arange(_N_STEPS + 1.0)) + np.array([-0.07, 0.12, -0.1, 0.06])
    values = _motion(steps + control) + np.array([[0.1], [-0.17], [0.2]])
    values[:, 0], values[:, -1] = main[:-1], main[1:]
    time = np.linspace(-0.12, _N_STEPS + 0.12, 301)
    dashed = Look(colour=GREY, dashes=(0, (4, 2)), width=1.1)
    curves = [Curve(x=time, y=_motion(time), label="$x(t)$", look=dashed)]
    for x, y in zip(steps + tau, values @ basis.values(tau), strict=True):
        look = Look(colour=COLOURS[0], width=1.5)
        curves.append(Curve(x=x, y=y, label="$x_d(t)$, degree $s=2$", look=look))
    for x, y, label, colour, marker in (
        (steps + nodes, values @ basis.values(nodes), "quadrature points", 2, "x"),
        (steps + control[1], values[:, 1], "inner control points", 4, "D"),
        (np.arange(_N_STEPS + 1.0), main, "control points at nodes", 1, "o"),
    ):
        look = Look(colour=COLOURS[colour], marker=marker, width=0, size=5.0)
        curves.append(Curve(x=x.ravel(), y=y.ravel(), label=label, look=look))
    names = [
        (main[1], 1.0, (4, 6), "$x_k=x_k^0$"),
        (values[1, 1], 1.0 + control[1], (-16, -12), "$x_k^1$"),
        (main[2], 2.0, (4, -15), "$x_k^2=x_{k+1}$"),
    ]
    sketch = functools.partial(_sketch, nodes=nodes, names=names)
    return figure([Panel(curves=curves, ylim=(0.0, None))], sketch, height=2.2)


def _motion(time: Array) -> Array:
    return np.asarray(0.85 + 0.27 * np.sin(1.9 * time - 0.6) + 0.03 * time)


def _sketch(axes: Axes, panel: Panel, nodes: Array, names: Sequence[Any]) -> None:
    """Lines over an axis of time with the grid of steps, the names of points, and lengths."""
    lines(axes, panel)
    axes.spines["left"].set_visible(False)
    axes.tick_params(left=False, labelleft=False)
    axes.set_xticks(range(_N_STEPS + 1), ["$t_{k-1}$", "$t_k$", "$t_{k+1}$", "$t_{k+2}$"])
    axes.vlines(range(_N_STEPS + 1), 0.0, 1.3, PALE, linewidth=0.5, zorder=0)
    axes.vlines(1.0 + nodes, 0.0, (1.1, 0.82), COLOURS[2], "dotted", linewidth=0.8, zorder=0)
    for height, place, offset, name in names:
        axes.annotate(name, (place, height), offset, textcoords="offset points")
    lengths = ((-1.0, 0.12, "$h$"), (nodes[0], 0.12, "$c_1h$"), (nodes[1], 0.3, "$c_2h$"))
    for length, height, name in lengths:
        look = {"color": INK if length < 0 else COLOURS[2], "shrinkA": 0, "shrinkB": 0}
        arrow = {"arrowstyle": "<->", "mutation_scale": 6} | look
        axes.annotate("", (1.0, height), (1.0 + length, height), arrowprops=arrow)
        axes.text(1.0 + length / 2, height + 0.03, name, color=look["color"], ha="center")
