"""Sketch of the discrete trajectory: polynomials on steps, control and quadrature points."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvi_cli.integrator.method import RuleSpecification
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.plotting.draw import SMALL, figure, lines
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import COLOURS, GREY, INK, PALE, Look

_N_STEPS, _DEGREE = 3, 2
_HIGHEST = 1.45


def interpolation_figure() -> Figure:
    """Draw how a Galerkin variational integrator of degree s = 2 approximates a curve.

    Every step has a polynomial of degree s through s + 1 Lobatto control points, the outer two
    shared with the neighbours, and s Gauss points at which the Lagrangian is evaluated. The
    polynomials are drawn at a distance from the curve, so that both are visible.
    """
    nodes = RuleSpecification(points=_DEGREE).build().nodes
    basis, tau = lobatto_basis(_DEGREE), np.linspace(0.0, 1.0, 101)
    control = basis.control_points
    # arbitrary values, which make the kinks at the nodes visible
    main = _motion(np.arange(_N_STEPS + 1.0)) + np.array([-0.07, 0.12, -0.1, 0.06])
    values = _motion(np.arange(_N_STEPS)[:, None] + control) + np.array([[0.1], [-0.17], [0.2]])
    values[:, 0], values[:, -1] = main[:-1], main[1:]
    time = np.linspace(-0.12, _N_STEPS + 0.12, 301)
    dashed = Look(colour=GREY, dashes=(0, (4, 2)), width=1.1)
    curves = [Curve(x=time, y=_motion(time), label="$x(t)$", look=dashed)]
    piece = Look(colour=COLOURS[0], width=1.5)
    at_points = values @ basis.values(nodes)
    for step, own in enumerate(values):
        label = "$x_d(t)$, degree $s = 2$" * (step == 0)
        curves.append(Curve(x=step + tau, y=own @ basis.values(tau), label=label, look=piece))
    places = np.arange(_N_STEPS)[:, None] + nodes
    for x, y, label, colour, marker in (
        (places, at_points, "quadrature points", COLOURS[2], "x"),
        (np.arange(_N_STEPS) + control[1], values[:, 1], "inner control points", COLOURS[4], "o"),
        (np.arange(_N_STEPS + 1.0), main, "control points at nodes", COLOURS[1], "o"),
    ):
        look = Look(colour=colour, marker=marker, width=0, size=5.0)
        curves.append(Curve(x=x.ravel(), y=y.ravel(), label=label, look=look))

    def sketch(axes: Axes, panel: Panel) -> None:
        lines(axes, panel)
        _dress(axes, places, at_points)
        _name_points(axes, nodes, control, values[1])

    panel = Panel(curves=curves, xlim=(-0.2, _N_STEPS + 0.2), ylim=(0.0, _HIGHEST))
    return figure([panel], sketch, height=2.5)


def _motion(time: Array) -> Array:
    return np.asarray(0.85 + 0.27 * np.sin(1.9 * time - 0.6) + 0.03 * time)


def _name_points(axes: Axes, nodes: Array, control: Array, values: Array) -> None:
    """Label the points of the second step."""
    for index, node in enumerate(nodes, start=1):
        _measure(axes, (1.0, 1.0 + node), 0.02 + 0.15 * index, f"$c_{{{index}}}h$", COLOURS[2])
    names = ("$x_k = x_k^0$", "$x_k^1$", "$x_k^2 = x_{k+1}$")
    for index, (place, value) in enumerate(zip(control, values, strict=True)):
        offset = (4, 8) if index == 0 else (-3, -9)
        words = axes.annotate(names[index], (1 + place, value), offset, textcoords="offset points")
        words.set(fontsize=SMALL, ha="left" if index == 0 else "right", va="center")


def _measure(axes: Axes, ends: tuple[float, float], height: float, words: str, colour: str) -> None:
    """Draw an arrow between two times with the name of its length."""
    arrow = {"arrowstyle": "<->", "linewidth": 0.7, "color": colour, "shrinkA": 0, "shrinkB": 0}
    axes.annotate(
        "", (ends[0], height), (ends[1], height), arrowprops=arrow | {"mutation_scale": 7}
    )
    text = axes.text(sum(ends) / 2, height + 0.02, words, ha="center", va="bottom", color=colour)
    text.set_fontsize(SMALL)


def _dress(axes: Axes, places: Array, at_points: Array) -> None:
    """Reduce the axes to the time with its grid, and mark the length of one step."""
    axes.spines["left"].set_visible(False)
    axes.tick_params(left=False, labelleft=False)
    axes.set_xticks(range(_N_STEPS + 1), ["$t_{k-1}$", "$t_k$", "$t_{k+1}$", "$t_{k+2}$"])
    axes.vlines(places.ravel(), 0.0, at_points.ravel(), COLOURS[2], ":", linewidth=0.6, zorder=1)
    axes.vlines(range(_N_STEPS + 1), 0.0, _HIGHEST, PALE, linewidth=0.5, zorder=0)
    _measure(axes, (0.0, 1.0), 0.17, "$h$", INK)
