"""How far convolution quadrature gets by itself on a singular function, in two norms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.convergence import Study
from fvi_cli.plotting.methods import SeriesStyle, series_styles
from fvi_cli.plotting.panels import (
    Row,
    Series,
    draw_errors,
    figure_legend,
    finish_panels,
    set_limits,
)
from fvi_cli.plotting.style import (
    COLUMN_WIDTH,
    SMALL_TEXT,
    TEXT_WIDTH,
    fraction,
    journal_style,
    new_figure,
)
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import FinishedRun

_NORMS = ("max", "final")


def saturation_figure(studies: Sequence[Study]) -> Figure:
    r"""Draw the error of convolution quadrature of :math:`D^\gamma f`, in two norms.

    For :math:`f \sim t^b` at 0 the order is :math:`\min(p, b-\gamma)` in the maximum norm over
    the grid and :math:`\min(p, b+1)` at a fixed time (Lubich, *Discretized fractional calculus*,
    1986). One column for every b, one row for every norm. An experiment in the other norm than
    a row's stands in for it by its trajectory.

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
    columns: dict[float, list[Study]] = {}
    for study in studies:
        columns.setdefault(leading_exponent(_derivative(study)), []).append(study)
    styles = series_styles([f.run.method for _, finished in studies for f in finished])
    first = _derivative(studies[0])
    width = TEXT_WIDTH if len(columns) > 1 else COLUMN_WIDTH
    with journal_style():
        figure = new_figure(width, 4.6 if width == TEXT_WIDTH else 5.4)
        grid = figure.subplots(2, len(columns), squeeze=False, sharex=True, sharey=True)
        drawn = []
        for column, exponent in enumerate(sorted(columns)):
            for row, norm in enumerate(_NORMS):
                axes = grid[row, column]
                series = _series(columns[exponent], norm, styles)
                draw_errors(axes, series)
                limit = exponent - first.order if norm == "max" else exponent + 1
                title = rf"order $\min(p, {fraction(limit)})$"
                axes.set_title(f"$b = {exponent:g}$\n{title}" if row == 0 else title)
                best = max(_largest_order(one) for one in columns[exponent])
                drawn.append((axes, series, [min(limit, best)]))
        for axes, label in zip(grid[:, 0], _NORMS, strict=True):
            end = f"{first.final_time:g}"
            axes.set_ylabel(
                "error, maximum over the grid" if label == "max" else f"error at $t = {end}$"
            )
        for axes in grid[-1]:
            axes.set_xlabel("step size $h$")
        for axes in grid.flat:
            set_limits(axes, [one for _, series, _ in drawn for one in series])
        figure.suptitle(_heading(columns, first, width), fontsize=SMALL_TEXT)
        figure_legend(figure, list(styles.values()), width, loc="outside lower center")
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
    rows: dict[str, list[Row]] = {}
    for _, finished in own or studies[:1]:
        for item in finished:
            error = item.error if own else _measured(item, norm)
            status = item.status
            if status in ("ok", "floor"):
                status = "floor" if error < item.floor else "ok"
            row = Row(step_size=item.run.step_size, error=error, floor=item.floor, status=status)
            rows.setdefault(item.run.method.case, []).append(row)
    return [
        Series(style=styles[case], rows=tuple(sorted(ladder, key=lambda row: row.step_size)))
        for case, ladder in rows.items()
    ]


def _measured(item: FinishedRun, norm: str) -> float:
    exact = item.run.experiment.problem.exact
    trajectory = item.trajectory
    if exact is None or trajectory.time.size == 0:
        return math.nan
    error = np.abs(trajectory.position - exact(trajectory.time))
    return float(error.max() if norm == "max" else error[-1].max())


def _heading(columns: dict[float, list[Study]], first: DerivativeProblem, width: float) -> str:
    order = fraction(first.order)
    family = all(_is_family_member(exponent, studies) for exponent, studies in columns.items())
    function = r"$f(t) = t^{\,b-1} \sin t$" if family else r"$f(t) \sim t^{\,b}$ at 0"
    # one column has no room for lines of the whole width
    turn = " " if width == TEXT_WIDTH else "\n"
    return (
        f"Caputo derivative of order {order} of {function}{turn}"
        f"on $[0, {first.final_time:g}]$ by convolution quadrature, BDF$p$.\n"
        rf"The order is $\min(p, b - {order})$ in the maximum norm{turn}"
        rf"and $\min(p, b + 1)$ at a fixed time;{turn}the captions of the paper say $b$."
    )


def _is_family_member(exponent: float, studies: Sequence[Study]) -> bool:
    problem = _derivative(studies[0])
    time = problem.final_time * np.linspace(0.1, 1.0, 7)
    values = problem.function(time).reshape(7, -1)[:, 0]
    return bool(np.allclose(values, time ** (exponent - 1) * np.sin(time), rtol=1e-12))
