"""Global errors against step size, with what diverged and what reached round-off."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.ladders.panels import (
    Series,
    collect_series,
    draw_errors,
    figure_legend,
    finish_panels,
    set_limits,
)
from fvi_cli.plotting.methods import SeriesStyle, common_features, series_styles
from fvi_cli.plotting.style import fraction, journal_style, legend_columns, new_figure, panel_grid
from fvi_cli.reports.naming import method_names
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import kind_title
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.norms import Norm

Study = tuple[Experiment, Sequence[FinishedRun]]

NORM_LABELS: dict[Norm, str] = {
    "max": r"$\mathrm{max}_k\,|x_k - x(t_k)|$",
    "final": r"$|x_N - x(T)|$",
    "l2": r"$(h\,\Sigma_k\,|x_k - x(t_k)|^2)^{1/2}$",
}
MOST_CURVES = 7
"""Curves that one panel can hold."""

LONGEST_TITLE = 56
"""Letters of a line above the legend."""

_MOST_GUIDES = 5
_MOST_ROWS = 3


def convergence_figure(studies: Sequence[Study]) -> Figure:
    """Draw the error of every run against its step size, one panel for every experiment.

    Runs that have no error stand hollow in a strip at the top that names what happened; errors
    that reached the floor lie in a hatched region. One experiment with more than
    :data:`MOST_CURVES` methods has a panel for every variant of them, as ``degree 2``. Triangles
    show the slopes that theory expects, or else those observed; what the source states is dashed.

    Parameters
    ----------
    studies
        Experiments with their finished runs.

    Raises
    ------
    ValueError
        If there is nothing to draw.
    """
    if not studies or not any(finished for _, finished in studies):
        raise ValueError("finished runs: none were given; a convergence figure needs at least one")
    methods = [f.run.method for _, finished in studies for f in finished]
    styles = series_styles(methods)
    titles = panel_titles([experiment for experiment, _ in studies])
    parts = [(title, study, styles) for title, study in zip(titles, studies, strict=True)]
    if len(studies) == 1 and len(styles) > MOST_CURVES:
        parts = _by_variant(titles[0], studies[0], styles) or parts
    n_columns = 1 if len(parts) <= _MOST_ROWS else 2
    n_rows = -(-len(parts) // n_columns)
    shown = {style.label: style for _, _, some in parts for style in some.values()}
    common = textwrap.fill(common_features(methods), LONGEST_TITLE)
    legend_rows = -(-len(shown) // legend_columns(list(shown))) + len(common.splitlines())
    # many curves need room for slope triangles between them
    panel_height = 2.2 + 0.12 * min(max(len(shown) - 3, 0), 7) if n_columns == 1 else 1.8
    with journal_style():
        figure = new_figure(n_rows * panel_height + 0.17 * legend_rows)
        _, panels = panel_grid(figure, len(parts), n_columns)
        drawn = []
        is_one_norm = len({experiment.norm for experiment, _ in studies}) == 1
        for position, (axes, part) in enumerate(zip(panels, parts, strict=True)):
            title, (experiment, finished), some = part
            series = collect_series(finished, some)
            draw_errors(axes, series)
            set_limits(axes, series)
            axes.set_title(title)
            if position + n_columns >= len(parts):
                axes.set_xlabel("step size $h$")
            if position % n_columns == 0 or not is_one_norm:
                axes.set_ylabel("error " + NORM_LABELS[experiment.norm])
            drawn.append((axes, series, reference_orders(series)))
        figure_legend(figure, list(shown.values()), title=common)
        finish_panels(figure, drawn)
    return figure


_Part = tuple[str, Study, dict[str, SeriesStyle]]


def _by_variant(title: str, study: Study, styles: dict[str, SeriesStyle]) -> list[_Part]:
    """A panel for every variant, where two or three make all the methods of some families."""
    experiment, finished = study
    names = method_names([item.run.method for item in finished])
    variants = dict.fromkeys(name.variant for name in names.values())
    if not 1 < len(variants) <= _MOST_ROWS:
        return []
    parts: list[_Part] = []
    for variant in variants:
        own = {
            # the panel tells of the variant: the mark need not
            case: replace(style, label=names[case].family, is_filled=True, line_style="-")
            for case, style in styles.items()
            if names[case].variant == variant
        }
        some = [item for item in finished if item.run.method.case in own]
        parts.append((f"{title}, {variant}" if variant else title, (experiment, some), own))
    return parts


def panel_titles(experiments: Sequence[Experiment]) -> list[str]:
    """Kind and damping orders of every experiment; its name where they do not tell it apart."""
    titles = []
    for experiment in experiments:
        problem = experiment.problem
        title = kind_title(problem.kind)
        if isinstance(problem, Problem) and problem.scene.laws:
            title = experiment.name
        elif isinstance(problem, Problem) and problem.scene.damping:
            orders = dict.fromkeys(fraction(term.order) for term in problem.scene.damping)
            listed = ", ".join(orders)
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
