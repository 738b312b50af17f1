"""Data and fitted motions, residuals, and profiles of the misfit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.panels import over_time, plane
from fvi_cli.plotting.style import COLOURS, GUIDE_COLOUR, INK, LINE_STYLES, MARKERS
from fvi_cli.plotting.words import in_formula, load_in_words, typeset_name
from fvi_cli.reports.naming import key_label, with_ratio, with_unit
from fvi_cli.studies.fits.result import Estimate, FitResult, ModelFit
from fvi_cli.studies.fits.settings import Series

_PROFILE = Look(colour=COLOURS[0])
_FITTED = Look(colour=COLOURS[0], marker="o", has_line=False, size=3.0)
_LINEAR = Look(colour=GUIDE_COLOUR, dashes=(0, (4, 2)), width=0.7)
_NOISE = Look(colour=INK, dashes=(0, (4, 2)), width=0.7)
_END = Look(colour=COLOURS[1], dashes=(0, (1, 1)), width=0.9)
_WIDE = 8.0
"""Frequencies that span this factor have a logarithmic axis."""
MOST_PANELS = 6
"""Most measured columns that are drawn, the first ones."""
MOST_PROFILES = 12
_FAR = 15.0
"""Residuals beyond this many times those of the best model leave the panel, where these would not
be readable otherwise."""
_MEASURED = Look(colour=INK, marker=".", has_line=False, size=3.0)


def fit_figures(name: str, results: Sequence[FitResult]) -> Mapping[str, Figure]:
    """For every experiment the motions, and the profiles of the best model, by name of figure."""
    found: dict[str, Figure] = {}
    for result in results:
        own = f"{name}-fit" if len(results) == 1 else f"{name}-{result.name}-fit"
        models = [one for one in result.models if one.series]
        if models:
            found[own] = _motions(result, models)
        if result.best.is_converged:
            found[f"{own}-profiles"] = _profiles(result.best, result.units)
    return found


def _motions(result: FitResult, models: Sequence[ModelFit]) -> Figure:
    """Measured and fitted curves, and the residuals with twice their standard deviation."""
    # the best model is drawn first, below the thinner lines of the others
    models = sorted(models, key=lambda one: one.criterion)
    first, units = models[0].series, result.units
    several = len({one.data for one in first}) > 1
    drawn = [one.series for one in first[:MOST_PANELS]]
    shared = all(np.array_equal(one.times, drawn[0].times) for one in drawn)
    best = f"_{result.best.model.name or 'fitted'}"
    panels, limits = [], []
    for index, shown in enumerate(first[:MOST_PANELS]):
        series = shown.series
        measured = Curve(x=series.times, y=series.values, label="measured", look=_MEASURED)
        upper, lower = [measured], []
        for number, model in enumerate(models):
            one = model.series[index]
            colour = COLOURS[number % len(COLOURS)]
            dashes = LINE_STYLES[number % len(LINE_STYLES)]
            line = Look(colour=colour, dashes=dashes, width=max(2.2 - 0.5 * number, 0.9))
            mark = MARKERS[number % len(MARKERS)]
            dots = Look(colour=colour, has_line=False, marker=mark, is_filled=False, size=2.0)
            label = model.model.name or "fitted"
            upper.append(Curve(x=one.curve[0], y=one.curve[1], label=label, look=line))
            lower.append(Curve(x=one.series.times, y=-one.residuals, label=f"_{label}", look=dots))
        label, residual = _words(series, units)
        reached, remark = residual_limits(lower, residual.partition(" (")[2].rstrip(")"))
        deviation = result.best.series[index].deviation if result.best.series else 0.0
        limits.append((min(reached[0], -2 * deviation), max(reached[1], 2 * deviation)))
        ends = series.times[[0, -1]]
        for sign, name in ((1, r"noise, $\pm 2\sigma$"), (-1, "_minus twice the noise")):
            limit = np.full(2, 2 * sign * deviation)
            lower.append(Curve(x=ends, y=limit, label=name, look=_NOISE))
        amplitude = series.amplitude
        what = "time" if amplitude is None else "frequency"
        panels += [
            Panel(
                curves=upper,
                y=label,
                title=shown.data if several else "",
                height=1.5,
                is_log=amplitude is not None and amplitude.part == "magnitude",
            ),
            Panel(
                curves=sorted(lower, key=lambda one: one.label == best),  # on top
                y=residual,
                x="" if shared else with_unit(what, units, what),
                remark=remark,
                height=1.0,
                levels=(0.0,),
            ),
        ]
    is_wide = all(one.amplitude and one.times[-1] > _WIDE * one.times[0] for one in drawn)
    more = f"the first {MOST_PANELS} of {len(first)} columns" if len(first) > MOST_PANELS else ""
    forces = next((one.forces for one in result.settings.data if one.name == first[0].data), ())
    load = f"load: {', '.join(map(load_in_words, forces))}" if forces else ""
    figure = over_time(
        panels,
        x=with_unit(what, units, what),
        logarithmic=is_wide,
        shared=shared,
        title="; ".join(filter(None, [load, more])),
    )
    for axes, (low, high) in zip(figure.axes[1::2], limits, strict=True):
        axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    return figure


def residual_limits(residuals: Sequence[Curve], unit: str) -> tuple[tuple[float, float], str]:
    """Limits of a panel of residuals, and a remark on models that exceed them."""
    largest = {one.label[1:]: float(one.y[np.abs(one.y).argmax()]) for one in residuals}
    most = _FAR * min(map(abs, largest.values()))
    room = max(abs(value) for value in largest.values() if abs(value) <= most)
    every = np.concatenate([one.y for one in residuals])
    kept = every[np.abs(every) <= room]
    far = [
        f"{name} (to ${in_formula(value, 3)}$ {unit}".rstrip() + ")"
        for name, value in largest.items()
        if abs(value) > most
    ]
    ends = float(kept.min(initial=0.0)), float(kept.max(initial=0.0))
    return ends, f"beyond the panel: {', '.join(far)}" if far else ""


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
    words = f"{amplitude.part} of {form}"
    if amplitude.part in ("real", "imaginary"):
        words = f"{amplitude.part} part of {form}"
    if amplitude.part == "phase":
        return f"{words} (degrees)", "residual (degrees)"
    of = ("length", "velocity", "acceleration")[rate]
    return with_ratio(words, units, of, "force"), with_ratio("residual", units, of, "force")


def _profiles(model: ModelFit, units: Mapping[str, str]) -> Figure:
    """Signed roots of the increase of chi-squared; for a linear model they are straight lines."""
    drawn = model.estimates[:MOST_PROFILES]
    count = len(model.estimates)
    words = f"the first {MOST_PROFILES} of {count} parameters" if count > MOST_PROFILES else ""
    panels = [
        Panel(
            curves=_profile(one),
            x=key_label(
                one.name, units, model.model.specification, [other.name for other in drawn]
            ),
            y=r"$\mathrm{sign}(\theta - \hat\theta)\,\sqrt{\Delta \chi^2}$",
            height=1.4,
        )
        for one in drawn
    ]
    figure = plane(panels, columns=min(2, len(drawn)), title=words, most_ticks=3)
    for axes in figure.axes:
        axes.set_ylim(-3.2, 3.2)
    return figure


def _profile(one: Estimate) -> list[Curve]:
    """The profile of a parameter, its linear approximation, and the ends of its interval."""
    inside = one.profile[np.abs(one.profile[:, 1]) <= 4.0]
    smooth, spread = _smooth(inside, one), np.array([-2.5, 2.5])
    line = one.value + spread * one.standard_error
    curves = [
        Curve(x=smooth[0], y=smooth[1], label="profile", look=_PROFILE),
        Curve(x=inside[:, 0], y=inside[:, 1], label="the others fitted anew", look=_FITTED),
        Curve(x=line, y=spread, label="linear approximation", look=_LINEAR),
    ]
    ends = [end for end in (one.low, one.high) if np.isfinite(end)]
    return curves + [
        Curve(x=np.full(2, end), y=np.array([-3.2, 3.2]), label="95 % interval", look=_END)
        for end in ends
    ]


def _smooth(points: Array, one: Estimate) -> tuple[Array, Array]:
    """A cubic through the points of a profile, tangent to its linear approximation."""
    x, y = points[np.argsort(points[:, 0])].T
    if x.size < 3 or not one.standard_error > 0:
        return x, y
    scaled = (x - one.value) / one.standard_error
    powers = np.stack([scaled**2, scaled**3], axis=1)
    bend = np.linalg.lstsq(powers, y - scaled, rcond=None)[0]
    fine = np.linspace(scaled[0], scaled[-1], 101)
    return one.value + fine * one.standard_error, fine + bend[0] * fine**2 + bend[1] * fine**3
