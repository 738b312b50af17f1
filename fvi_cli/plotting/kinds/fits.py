"""Data and fitted motions, residuals, and profiles of the misfit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import COLOURS, GREY, INK, Look, dots
from fvi_cli.plotting.words import load_in_words, number_in_words
from fvi_cli.reports.naming import key_label, with_ratio, with_unit
from fvi_cli.studies.fits.result import Estimate, FitResult, ModelFit
from fvi_cli.studies.fits.settings import Series

_MOST_COLUMNS, _MOST_MODELS, _MOST_PROFILES = 3, 4, 12  # that are drawn, the first ones
_CRITICAL = 3.841  # increase of chi squared at the ends of a 95 % interval
_HIGHEST = 6.0
_BEST = Look(colour=COLOURS[0], width=1.4)


def fit_figures(name: str, results: Sequence[FitResult]) -> Mapping[str, Figure]:
    """For every experiment the motions, and the profiles of the best model, by name of figure."""
    found: dict[str, Figure] = {}
    for result in results:
        own = f"{name}-fit" if len(results) == 1 else f"{name}-{result.name}-fit"
        if result.best.series:
            found[own] = _motions(result)
        if result.best.is_converged:
            found[f"{own}-profiles"] = _profiles(result.best, result.units)
    return found


def _motions(result: FitResult) -> Figure:
    """The data with the best model, and residuals of every model; a column for each measurement."""
    models = sorted((one for one in result.models if one.series), key=lambda one: one.criterion)
    models, count = models[:_MOST_MODELS], min(len(result.best.series), _MOST_COLUMNS)
    columns = [_column(result, models, index) for index in range(count)]
    forces = next((one.forces for one in result.settings.data if one.forces), ())
    heading = f"load: {', '.join(map(load_in_words, forces))}" if forces else ""
    drawn, height = [one for row in zip(*columns, strict=True) for one in row], [1.9]
    height += [0.95] * len(models)
    return figure(drawn, lines, columns=count, height=height, sharex="col", heading=heading)


def _column(result: FitResult, models: Sequence[ModelFit], index: int) -> list[Panel]:
    """Panels of one measured column; bands of the noise show the scale of residuals."""
    best = result.best.series[index]
    series, units = best.series, result.units
    label, residual = _words(series, units)
    is_response = series.amplitude is not None
    what, log = ("frequency", "x") if is_response else ("time", "")
    is_size = series.amplitude is not None and series.amplitude.part == "magnitude"
    x = with_unit(what, units, what)
    title = best.data if len({one.data for one in result.best.series}) > 1 else ""
    name = result.best.model.name or "fitted"
    curves = [
        Curve(x=best.curve[0], y=best.curve[1], label=name, look=_BEST),
        Curve(x=series.times, y=series.values, label="measured", look=dots(INK, 2.2)),
    ]
    panels = [Panel(curves=curves, x=x, y=label, title=title, log=log + "y" * is_size)]
    ends, noise = series.times[[0, -1]], np.full(2, 2 * best.deviation)
    look, bands = Look(colour=GREY, width=0.5), [("noise, $2\\sigma$", -noise, noise)]
    zero = Curve(x=ends, y=np.zeros(2), look=look, bands=bands)
    for one in models:
        left = Curve(x=series.times, y=-one.series[index].residuals, look=dots(COLOURS[0], 2.2))
        worse = one.criterion - result.best.criterion
        words = rf"{one.model.name}, $\Delta$AICc = {worse:.3g}" if len(models) > 1 else ""
        panels.append(Panel(curves=[zero, left], x=x, y=residual, title=words, log=log))
    return panels


def _words(series: Series, units: Mapping[str, str]) -> tuple[str, str]:
    """Labels of the panels of a measured column and of its residuals."""
    amplitude = series.amplitude
    if amplitude is None:
        names = (series.column, series.name, *filter(None, [series.quality]))
        return with_unit(series.column, units, *names), with_unit("residual", units, *names)
    form, part = series.name.removesuffix(f" ({amplitude.part})"), amplitude.part
    if part == "phase":
        return f"phase of {form} (degrees)", "residual (degrees)"
    words = f"{part} of {form}" if part == "magnitude" else f"{part} part of {form}"
    of = ("length", "velocity", "acceleration")[amplitude.rate]
    return with_ratio(words, units, of, "force"), with_ratio("residual", units, of, "force")


def _profiles(model: ModelFit, units: Mapping[str, str]) -> Figure:
    """The increase of chi squared with each parameter, its 95 % interval filled."""
    drawn = model.estimates[:_MOST_PROFILES]
    names = [one.name for one in drawn]
    panels = [
        Panel(
            curves=_profile(one),
            x=key_label(one.name, units, model.model.specification, names),
            y=r"misfit $\Delta\chi^2$",
            title="{} ({}, {})".format(*map(number_in_words, (one.value, one.low, one.high))),
            levels=[_CRITICAL],
            ylim=(0.0, _HIGHEST),
        )
        for one in drawn
    ]
    return figure(panels, lines, columns=min(len(panels), 3), height=1.9, sharey=True)


def _profile(one: Estimate) -> list[Curve]:
    """The profile through its points, and the part of it in the interval."""
    from scipy.interpolate import PchipInterpolator  # slow to import

    points = np.array([*one.profile, (one.value, 0.0)])
    x, places = np.unique(points[:, 0], return_index=True)
    root = points[places, 1]
    near = np.abs(root) <= np.sqrt(_HIGHEST)
    look, blue = dots(COLOURS[0], 3.0), Look(colour=COLOURS[0], width=1.2)
    tried = Curve(x=x[near], y=root[near] ** 2, look=look, marks=[(one.value, 0.0, "")])
    if x.size < 2:
        return [tried]
    fine = np.linspace(x[0], x[-1], 401)
    rises = PchipInterpolator(x, root)(fine) ** 2
    rises[rises > _HIGHEST] = np.nan
    low = np.where((fine >= one.low) & (fine <= one.high), rises, np.nan)
    band = ("95 % interval", low, np.full(fine.size, _CRITICAL))
    return [Curve(x=fine, y=rises, look=blue, bands=[band]), tried]
