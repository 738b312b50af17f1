"""Data and fitted motions, what is left, and profiles of the misfit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from fvi_cli.plotting.style import (
    COLOURS,
    GUIDE_COLOUR,
    INK,
    LINE_STYLES,
    SMALL_TEXT,
    LineStyle,
    journal_style,
    legend_above,
    new_figure,
    panel_grid,
)
from fvi_cli.studies.fits.result import FitResult, ModelFit

DASHES: LineStyle = (0, (4, 2))
WIDE = 8.0
"""Frequencies that differ by this factor are drawn along a logarithm."""
MOST_PANELS = 6
"""Measured columns that are drawn; the first of them."""


def fit_figures(name: str, results: Sequence[FitResult]) -> Mapping[str, Figure]:
    """Figures of fits by name: of every experiment the motions, and the profiles of the best model.

    Parameters
    ----------
    name
        Names begin with it.
    results
        Of experiments with at least one model that could be computed.
    """
    found: dict[str, Figure] = {}
    for result in results:
        own = f"{name}-fit" if len(results) == 1 else f"{name}-{result.name}-fit"
        models = [one for one in result.models if one.series]
        if models:
            found[own] = _motions(result, models)
        if result.best.is_converged:
            found[f"{own}-profiles"] = _profiles(result.best)
    return found


def _motions(result: FitResult, models: Sequence[ModelFit]) -> Figure:
    count = min(len(models[0].series), MOST_PANELS)
    several = len({one.data for one in models[0].series}) > 1
    with journal_style():
        figure = new_figure(0.5 + 2.5 * count)
        grid = figure.subplots(
            2 * count, 1, squeeze=False, sharex=count == 1, height_ratios=[2.0, 1.0] * count
        )
        for index in range(count):
            upper, lower = grid[2 * index, 0], grid[2 * index + 1, 0]
            shown = models[0].series[index]
            measured = shown.series.times, shown.series.values
            upper.plot(*measured, ".", markersize=3.0, color=GUIDE_COLOUR, label="measured")
            for number, model in enumerate(models):
                one = model.series[index]
                colour = COLOURS[number % len(COLOURS)]
                dashes, label = LINE_STYLES[number % len(LINE_STYLES)], model.model.name or "fitted"
                upper.plot(*one.curve, color=colour, linestyle=dashes, label=label)
                lower.plot(one.series.times, -one.residuals, ".", markersize=2.5, color=colour)
            lower.axhline(0.0, color=INK, linewidth=0.5)
            deviation = result.best.series[index].deviation if result.best.series else 0.0
            for level in (-2.0 * deviation, 2.0 * deviation):
                lower.axhline(level, color=GUIDE_COLOUR, linewidth=0.5, linestyle=DASHES)
            upper.set_ylabel(shown.series.column)
            lower.set_ylabel("left over")
            lower.yaxis.set_major_locator(MaxNLocator(3))
            if several:
                upper.set_title(shown.data, fontsize=SMALL_TEXT)
            if count == 1:
                upper.tick_params(labelbottom=False)
            amplitude = shown.series.amplitude
            lower.set_xlabel("time" if amplitude is None else "frequency")
            if amplitude is not None:
                is_wide = shown.series.times[-1] > WIDE * shown.series.times[0]
                for axes in (upper, lower) if is_wide else ():
                    axes.set_xscale("log")
                    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
                    axes.xaxis.set_minor_formatter(NullFormatter())
                if amplitude.part == "magnitude":
                    upper.set_yscale("log")
        legend_above(figure, grid[0, 0])
    return figure


def _profiles(model: ModelFit) -> Figure:
    """The root of the increase of the misfit: a straight line where the model is linear."""
    drawn = model.estimates[:12]
    with journal_style():
        figure = new_figure(0.35 + 1.6 * -(-len(drawn) // 2))
        grid, panels = panel_grid(figure, len(drawn), min(2, len(drawn)), sharey=True)
        for axes, one in zip(panels, drawn, strict=True):
            inside = one.profile[np.abs(one.profile[:, 1]) <= 4.0]
            axes.plot(*inside.T, color=COLOURS[0], marker="o", markersize=2.5)
            spread = np.array([-2.5, 2.5])
            tangent = one.value + spread * one.standard_error
            axes.plot(tangent, spread, color=GUIDE_COLOUR, linewidth=0.7, linestyle=DASHES)
            for end in (one.low, one.high):
                if np.isfinite(end):
                    axes.axvline(end, color=COLOURS[1], linewidth=0.7)
            axes.axhline(0.0, color=INK, linewidth=0.5)
            axes.set_ylim(-3.2, 3.2)
            axes.set_xlabel(one.name.removeprefix("problem."), fontsize=SMALL_TEXT)
            axes.xaxis.set_major_locator(MaxNLocator(4))
        for row in grid:
            row[0].set_ylabel("root of increase")
    return figure
