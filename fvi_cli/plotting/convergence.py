"""Global errors against step size, with what diverged and what reached round-off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.methods import common_features, series_styles
from fvi_cli.plotting.panels import (
    Series,
    collect_series,
    draw_errors,
    figure_legend,
    finish_panels,
    set_limits,
)
from fvi_cli.plotting.style import (
    COLUMN_WIDTH,
    TEXT_WIDTH,
    fraction,
    journal_style,
    legend_columns,
    new_figure,
)
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import kind_title
from fvi_cli.studies.experiment import Experiment, FinishedRun, Norm

Study = tuple[Experiment, Sequence[FinishedRun]]

NORM_LABELS: dict[Norm, str] = {
    "max": r"$\mathrm{max}_k\,|x_k - x(t_k)|$",
    "final": r"$|x_N - x(T)|$",
    "l2": r"$(h\,\Sigma_k\,|x_k - x(t_k)|^2)^{1/2}$",
}
_MOST_GUIDES = 5


def convergence_figure(
    studies: Sequence[Study], *, orders: Sequence[float] | None = None
) -> Figure:
    """Draw the error of every run against its step size, one panel for every experiment.

    Runs that have no error stand hollow in a strip at the top that names what happened; errors
    that reached the floor lie in a hatched region.

    Parameters
    ----------
    studies
        Experiments with their finished runs.
    orders
        Slopes to show; None: those that theory expects of the methods, or else the observed ones.

    Raises
    ------
    ValueError
        If there is nothing to draw.
    """
    if not studies or not any(finished for _, finished in studies):
        raise ValueError("finished runs: none were given; a convergence figure needs at least one")
    methods = [f.run.method for _, finished in studies for f in finished]
    styles = series_styles(methods)
    n_columns = min(3, len(studies))
    n_rows = -(-len(studies) // n_columns)
    width = COLUMN_WIDTH if len(studies) == 1 else TEXT_WIDTH
    labels = [style.label for style in styles.values()]
    common = common_features(methods)
    legend_rows = -(-len(labels) // legend_columns(labels, width)) + (common != "")
    # many curves need room for slope triangles between them
    height = n_rows * (2.3 + 0.12 * min(max(len(labels) - 3, 0), 7)) + 0.17 * legend_rows
    with journal_style():
        figure = new_figure(width, height)
        grid = figure.subplots(n_rows, n_columns, squeeze=False)
        titles = panel_titles([experiment for experiment, _ in studies])
        drawn = []
        for position, axes in enumerate(grid.flat):
            if position >= len(studies):
                axes.set_axis_off()
                continue
            experiment, finished = studies[position]
            series = collect_series(finished, styles)
            draw_errors(axes, series)
            set_limits(axes, series)
            axes.set_title(titles[position])
            if position + n_columns >= len(studies):
                axes.set_xlabel("step size $h$")
            norms = [e.norm for e, _ in studies]
            if position % n_columns == 0 or len(set(norms)) > 1:
                axes.set_ylabel("error " + NORM_LABELS[experiment.norm])
            wanted = reference_orders(series) if orders is None else list(orders)
            drawn.append((axes, series, wanted))
        figure_legend(figure, list(styles.values()), width, title=common)
        finish_panels(figure, drawn)
    return figure


def panel_titles(experiments: Sequence[Experiment]) -> list[str]:
    """Kind and damping orders of every experiment; its name where that does not tell them apart."""
    titles = []
    for experiment in experiments:
        problem = experiment.problem
        title = kind_title(problem.kind)
        if isinstance(problem, Problem) and problem.scene.damping:
            listed = ", ".join(fraction(term.order) for term in problem.scene.damping)
            title += rf", $\gamma = {listed}$"
        titles.append(title)
    return [
        title if titles.count(title) == 1 else experiment.name
        for title, experiment in zip(titles, experiments, strict=True)
    ]


def reference_orders(series: Sequence[Series]) -> list[float]:
    """Orders worth a slope triangle: what theory expects, else observed slopes to the half.

    Of every curve the expected order at its smallest step above the floor counts.
    """
    curves = [one.curve() for one in series]
    expected = {order for curve in curves if np.isfinite(order := curve.expected_order())}
    if not expected:
        slopes = [curve.slope() for curve in curves]
        expected = {round(2 * slope) / 2 for slope in slopes if np.isfinite(slope) and slope > 0.25}
    return sorted(expected)[:_MOST_GUIDES]
