"""Data and fitted motions, residuals, and profiles of the misfit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import COLOURS, GREY, INK
from fvi_cli.plotting.words import load_in_words, number_in_words, typeset_name
from fvi_cli.reports.naming import key_label, with_ratio, with_unit
from fvi_cli.studies.fits.result import Estimate, FitResult, ModelFit
from fvi_cli.studies.fits.settings import Series

MOST_COLUMNS, MOST_MODELS, MOST_PROFILES = 3, 4, 12
"""Measured columns, models and parameters that are drawn, the first ones."""
_CRITICAL = 3.841  # increase of chi squared at the ends of a 95 % interval
_HIGHEST = 6.0
_FAR = 15.0  # residuals larger than those of the best model by this factor have their own scale
_WIDE = 8.0  # frequencies that span this factor have a logarithmic axis
_BEST = Look(colour=COLOURS[0], width=1.4)
_DATA = Look(colour=INK, marker="o", has_line=False, size=2.2)
_RESIDUAL = replace(_DATA, colour=COLOURS[0])


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
    models, count = models[:MOST_MODELS], min(len(result.best.series), MOST_COLUMNS)
    columns = [_column(result, models, index) for index in range(count)]
    forces = next((one.forces for one in result.settings.data if one.forces), ())
    heading = f"load: {', '.join(map(load_in_words, forces))}" if forces else ""
    return figure(
        list(zip(*columns, strict=True)),
        lines,
        height=(1.9, *[0.95] * len(models)),
        is_wide=count > 1,
        sharex="col",
        legend="below",
        heading=heading,
    )


def _column(result: FitResult, models: Sequence[ModelFit], index: int) -> list[Panel]:
    """Panels of one measured column."""
    best = result.best.series[index]
    series, units = best.series, result.units
    label, residual = _words(series, units)
    what = "time" if series.amplitude is None else "frequency"
    is_wide = series.amplitude is not None and bool(series.times[-1] > _WIDE * series.times[0])
    is_size = series.amplitude is not None and series.amplitude.part == "magnitude"
    x, log = with_unit(what, units, what), "x" * is_wide
    names = {id(one): one.model.name or "fitted" for one in models}
    title = best.data if len({one.data for one in result.best.series}) > 1 else ""
    curves = [
        Curve(
            x=best.curve[0], y=best.curve[1], label=names.get(id(result.best), "fitted"), look=_BEST
        ),
        Curve(x=series.times, y=series.values, label="measured", look=_DATA),
    ]
    panels = [Panel(curves=curves, x=x, y=label, title=title, log=log + "y" * is_size)]
    sizes = [float(np.abs(one.series[index].residuals).max()) for one in models]
    near = [size for size in sizes if size <= _FAR * min(sizes)]
    for one, size in zip(models, sizes, strict=True):
        scale = 1.1 * max(max(near), size, 2 * best.deviation)
        ends, noise = series.times[[0, -1]], np.full(2, 2 * best.deviation)
        zero = Curve(
            x=ends,
            y=np.zeros(2),
            look=Look(colour=GREY, width=0.5),
            bands=[("noise, $2\\sigma$", -noise, noise)],
        )
        dots = Curve(x=series.times, y=-one.series[index].residuals, look=_RESIDUAL)
        worse = one.criterion - result.best.criterion
        words = rf"{names[id(one)]}, $\Delta$AICc = {worse:.3g}" if len(models) > 1 else ""
        panels.append(
            Panel(curves=[zero, dots], x=x, y=residual, title=words, log=log, ylim=(-scale, scale))
        )
    return panels


def _words(series: Series, units: Mapping[str, str]) -> tuple[str, str]:
    """Labels of the panels of a measured column and of its residuals."""
    amplitude = series.amplitude
    if amplitude is None:
        usual = "velocity" if series.is_velocity else "length"
        names = (series.column, series.name, *([] if series.formula else [usual]))
        return with_unit(series.column, units, *names), with_unit("residual", units, *names)
    form, rate = series.name.removesuffix(f" ({amplitude.part})"), amplitude.rate
    dots = ("", r"\dot ", r"\ddot ")[rate]
    what = form[min(rate, 1) :]
    if what.isidentifier():
        form = f"${dots}{typeset_name(what).strip('$')}$"
    part = {"real": "real part", "imaginary": "imaginary part"}.get(amplitude.part, amplitude.part)
    if amplitude.part == "phase":
        return f"phase of {form} (degrees)", "residual (degrees)"
    of = ("length", "velocity", "acceleration")[rate]
    words = f"{part} of {form}"
    return with_ratio(words, units, of, "force"), with_ratio("residual", units, of, "force")


def _profiles(model: ModelFit, units: Mapping[str, str]) -> Figure:
    """The increase of chi squared with each parameter, its 95 % interval filled."""
    drawn = model.estimates[:MOST_PROFILES]
    names = [one.name for one in drawn]
    panels: list[Panel | None] = [
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
    columns = min(len(panels), 3)
    panels += [None] * (-len(panels) % columns)
    rows = [panels[k : k + columns] for k in range(0, len(panels), columns)]
    return figure(rows, lines, height=1.9, is_wide=columns > 2, sharey=True)


def _profile(one: Estimate) -> list[Curve]:
    """The profile through its points, and the part of it in the interval."""
    x, root = one.profile[np.argsort(one.profile[:, 0])].T if len(one.profile) else np.zeros((2, 0))
    near = np.abs(root) <= math.sqrt(_HIGHEST)
    fine, smooth = _smooth(x, root, one)
    inside = (fine >= one.low) & (fine <= one.high)
    rises = smooth**2
    filled = (rises[inside], np.full(int(inside.sum()), _CRITICAL))
    blue = Look(colour=COLOURS[0], width=1.2)
    dots = Look(colour=COLOURS[0], marker="o", has_line=False, size=3.0)
    return [
        Curve(x=fine, y=np.where(rises <= _HIGHEST, rises, np.nan), look=blue),
        Curve(x=fine[inside], y=rises[inside], look=blue, bands=[("95 % interval", *filled)]),
        Curve(x=x[near], y=root[near] ** 2, look=dots, marks=[(one.value, 0.0, "")]),
    ]


def _smooth(x: Array, root: Array, one: Estimate) -> tuple[Array, Array]:
    """A cubic through the signed roots of a profile, tangent to its linear approximation."""
    near = np.abs(root) <= 4.0
    x, root = x[near], root[near]
    if x.size < 3 or not one.standard_error > 0:
        return x, root
    scaled = (x - one.value) / one.standard_error
    powers = np.stack([scaled**2, scaled**3], axis=1)
    bend = np.linalg.lstsq(powers, root - scaled, rcond=None)[0]
    fine = np.linspace(scaled[0], scaled[-1], 201)
    return one.value + fine * one.standard_error, fine + bend[0] * fine**2 + bend[1] * fine**3
