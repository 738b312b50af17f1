"""How far convolution quadrature gets by itself on a singular function, in two norms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.ladders.convergence import Study
from fvi_cli.plotting.ladders.panels import (
    Series,
    draw_errors,
    figure_legend,
    finish_panels,
    set_limits,
)
from fvi_cli.plotting.methods import SeriesStyle, series_styles
from fvi_cli.plotting.style import SMALL_TEXT, fraction, journal_style, new_figure
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import FinishedRun

_NORMS = ("max", "final")
_NORM_TITLES = {"max": "largest on the grid", "final": "at the final time"}


def saturation_figure(studies: Sequence[Study]) -> Figure:
    r"""Draw the error of convolution quadrature of :math:`D^\gamma f`, in two norms.

    For :math:`f \sim t^b` at 0 the order is :math:`\min(p, b-\gamma)` in the maximum norm over
    the grid and :math:`\min(p, b+1)` at a fixed time (Lubich, *Discretized fractional calculus*,
    1986). One row for every b, one column for every norm. An experiment in the other norm than
    a column's stands in for it by its trajectory.

    Parameters
    ----------
    studies
        Experiments of kind ``fractional-derivative`` with their finished runs.

    Raises
    ------
    ValueError
        If there is none, or a problem is of another kind.
    """
    if not studies:
        raise ValueError("studies: none were given; a saturation figure needs at least one")
    rows: dict[float, list[Study]] = {}
    for study in studies:
        rows.setdefault(leading_exponent(_derivative(study)), []).append(study)
    styles = series_styles([f.run.method for _, finished in studies for f in finished])
    first = _derivative(studies[0])
    with journal_style():
        figure = new_figure(1.1 + 1.65 * len(rows))
        # every panel has its own range: beside b = 5 the errors of b = 1 would lie in one line
        grid = figure.subplots(len(rows), 2, squeeze=False, sharex=True)
        drawn = []
        for row, exponent in enumerate(sorted(rows)):
            for column, norm in enumerate(_NORMS):
                axes = grid[row, column]
                series = _series(rows[exponent], norm, styles)
                draw_errors(axes, series)
                set_limits(axes, series)
                limit = exponent - first.order if norm == "max" else exponent + 1
                title = rf"$b = {exponent:g}$: order $\min(p, {fraction(limit)})$"
                axes.set_title(f"{_NORM_TITLES[norm]}\n{title}" if row == 0 else title)
                best = max(_largest_order(one) for one in rows[exponent])
                drawn.append((axes, series, [min(limit, best)]))
            grid[row, 0].set_ylabel("error")
        for axes in grid[-1]:
            axes.set_xlabel("step size $h$")
        figure.suptitle(_heading(rows, first), fontsize=SMALL_TEXT)
        figure_legend(figure, list(styles.values()), above=False)
        finish_panels(figure, drawn)
    return figure


def leading_exponent(problem: DerivativeProblem) -> float:
    """The b of f(t) ~ c t^b at 0, from the function itself, to three decimals."""
    near = problem.final_time * np.array([1e-6, 1e-5])
    values = np.abs(problem.function(near)).reshape(2, -1)[:, 0]
    if not np.all(values > 0):
        return float("nan")
    return round(math.log10(values[1] / values[0]), 3)


def _derivative(study: Study) -> DerivativeProblem:
    problem = study[0].problem
    if not isinstance(problem, DerivativeProblem):
        raise ValueError(f"kind: {problem.kind!r} is not fractional-derivative")
    return problem


def _largest_order(study: Study) -> float:
    orders = [getattr(item.run.method, "cq", "") for item in study[1]]
    return float(max((int(cq[3:]) for cq in orders if cq.startswith("bdf")), default=math.inf))


def _series(studies: Sequence[Study], norm: str, styles: dict[str, SeriesStyle]) -> list[Series]:
    """Ladders in one norm: of the experiment that has it, else measured on the trajectories."""
    own = [study for study in studies if study[0].norm == norm]
    rows: dict[str, list[FinishedRun]] = {}
    for _, finished in own or studies[:1]:
        for item in finished:
            error = item.error if own else _measured(item, norm)
            status = item.status
            if status in ("ok", "floor"):
                status = "floor" if error < item.floor else "ok"
            row = replace(item, error=error, status=status)
            rows.setdefault(item.run.method.case, []).append(row)
    return [
        Series(style=styles[case], rows=tuple(sorted(ladder, key=lambda row: row.run.step_size)))
        for case, ladder in rows.items()
    ]


def _measured(item: FinishedRun, norm: str) -> float:
    exact = item.run.experiment.problem.exact
    trajectory = item.trajectory
    if exact is None or trajectory.time.size == 0:
        return math.nan
    error = np.abs(trajectory.position - exact(trajectory.time))
    return float(error.max() if norm == "max" else error[-1].max())


def _heading(rows: dict[float, list[Study]], first: DerivativeProblem) -> str:
    order = fraction(first.order)
    family = all(_is_family_member(exponent, studies) for exponent, studies in rows.items())
    function = r"$f(t) = t^{\,b-1} \sin t$" if family else r"$f(t) \sim t^{\,b}$ at 0"
    return (
        f"Caputo derivative of order {order} of {function}\n"
        f"on $[0, {first.final_time:g}]$ by convolution quadrature, BDF$p$.\n"
        rf"The order is $\min(p, b - {order})$ in the maximum norm"
        "\n"
        r"and $\min(p, b + 1)$ at a fixed time; the captions of the paper say $b$."
    )


def _is_family_member(exponent: float, studies: Sequence[Study]) -> bool:
    problem = _derivative(studies[0])
    time = problem.final_time * np.linspace(0.1, 1.0, 7)
    values = problem.function(time).reshape(7, -1)[:, 0]
    return bool(np.allclose(values, time ** (exponent - 1) * np.sin(time), rtol=1e-12))
