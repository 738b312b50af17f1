"""From settings to estimates with intervals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fvi_cli.integrator.gradients.gradient import RunFailedError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread
from fvi_cli.studies.fits.intervals import BetterMinimumError, estimates
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.result import Estimate, ModelFit, SeriesFit
from fvi_cli.studies.fits.search import Found, least_squares_from, search
from fvi_cli.studies.fits.settings import FitModel, FitSettings, Series
from fvi_cli.studies.fits.statistics import (
    ROUND_OFF,
    covariance,
    criterion,
    rms,
    series_freedoms,
    whiteness,
)

FIRST_TOLERANCE, LAST_TOLERANCE = 1e-3, 1e-12
"""Tolerance of a step in the first and in the finest runs, relative to the size of the motion."""
DISCRETISATION = 0.01
"""Permitted error of the runs, relative to the residuals."""
MOST_REWEIGHTINGS, ENOUGH = 20, 1e-3
"""Most iterations for the noise of the columns; they end when it changes by less, relative."""
LEAST_FREEDOM = 0.5
"""Degrees of freedom of a column below which its noise cannot be estimated."""
MOST_BETTER = 3
"""How often a fit begins again because a profile found less misfit."""
POINTS_OF_CURVES = 400


@in_one_thread
def fit_model(settings: FitSettings, described: FitModel) -> ModelFit:
    """Fit one model."""
    model = MotionModel(described, settings.data, ())
    is_known = settings.deviation is not None or settings.relative is not None
    point = model.start
    try:
        model.deviations = [_given_noise(settings, one) for one in model.series]
        scale = _scale(model)
        point = search(model, scale).point
        for _ in range(MOST_BETTER + 1):
            best, ratio = _polished(model, point, scale, is_known=is_known)
            point = best.point
            try:
                return _result(model, best, ratio, is_known=is_known)
            except BetterMinimumError as better:
                point = better.point
        message = "the search for intervals keeps finding better minima: fit fewer parameters"
    except ValueError as error:
        message = str(error)
    return ModelFit(model=described, message=message, **_values(model, point))


def _given_noise(settings: FitSettings, series: Series) -> Array | float:
    """Deviation of the values of a series; where none is given, their size."""
    if settings.relative is None:
        return settings.deviation or rms(series.values) or 1.0
    return settings.relative * np.abs(series.values)


def _values(model: MotionModel, point: Array) -> dict[str, Any]:
    """Estimates without intervals, and the values that a configuration takes."""
    values = model.values(point)
    pairs = zip(model.free, values.tolist(), strict=True)
    return {
        "estimates": tuple(Estimate(name=one.key, value=value) for one, value in pairs),
        "assignments": tuple(model.assignments(k, values) for k in range(len(model.data))),
    }


def _scale(model: MotionModel) -> float:
    """Size of the motion, a length: that of measured positions, or of a run at the start."""
    names = {name for one in model.data for name in one.coordinates}
    sizes = [float(np.abs(one.values).max()) for one in model.series if one.name in names]
    return max(sizes, default=0.0) or model.size_at_start()


def _polished(
    model: MotionModel, point: Array, scale: float, *, is_known: bool
) -> tuple[Found, float]:
    """The minimum on steps that are fine enough, and their error relative to the residuals.

    Raises
    ------
    RunFailedError
        If the run fails at the best point, or the noise cannot be estimated.
    """
    tolerance = FIRST_TOLERANCE
    while True:
        model.remesh(point, tolerance * scale)
        for _ in range(MOST_REWEIGHTINGS):
            best = least_squares_from(model, point)
            point = best.point
            if is_known or len(model.series) == 1 or _is_clean(model, best):
                break
            fresh = _estimated_noise(model, best)
            change = max(
                float(np.max(np.abs(a / b - 1.0)))
                for a, b in zip(fresh, model.deviations, strict=True)
            )
            if change < ENOUGH:
                break
            model.deviations = list(fresh)
        used = model.meshes
        model.remesh(point, max(LAST_TOLERANCE, 1e-3 * tolerance) * scale)
        finer = model.evaluate(point, with_jacobian=False).residuals
        ratio = rms(finer - best.at.residuals) / max(rms(best.at.residuals), 1e-300)
        if ratio <= DISCRETISATION or tolerance <= LAST_TOLERANCE:
            model.meshes = used
            return best, ratio
        tolerance = max(LAST_TOLERANCE, 1e-3 * tolerance)


def _is_clean(model: MotionModel, best: Found) -> bool:
    """Whether the residuals are round-off."""
    data = np.concatenate([one.values for one in model.series])
    return rms(np.concatenate(model.split(best.at.residuals))) <= ROUND_OFF * rms(data)


def _estimated_noise(model: MotionModel, best: Found) -> list[float]:
    """Standard deviation of the noise of every series, from the residuals."""
    found = []
    left, freedoms = model.split(best.at.residuals), series_freedoms(best.at, model.sizes)
    for one, part, freedom in zip(model.series, left, freedoms.tolist(), strict=True):
        if freedom < LEAST_FREEDOM:
            raise RunFailedError(
                f"the noise of column {one.column} cannot be estimated: the parameters use up its "
                f"values ({one.values.size}); write noise: with a standard deviation"
            )
        # a column that is met to round-off would weigh without bound
        least = max(ROUND_OFF * rms(one.values), 1e-300)
        found.append(max(math.sqrt(float(part @ part) / freedom), least))
    return found


def _result(model: MotionModel, best: Found, ratio: float, *, is_known: bool) -> ModelFit:
    p, size = len(model.free), sum(model.sizes)
    variance = 1.0 if is_known else max(best.cost / (size - p), 1e-300)
    correlations, _, is_regular = covariance(best.at, variance)
    is_profiled = is_regular and not best.message and not _is_clean(model, best)
    found = estimates(model, best, variance, is_known=is_known, is_profiled=is_profiled)
    left, curves = model.split(best.at.residuals), model.curves(best.point, POINTS_OF_CURVES)
    named = [(data.name, one) for data in model.data for one in data.series]
    every = zip(named, left, model.deviations, curves, strict=True)
    message = best.message
    if not is_regular:
        message = message or (
            "the data do not determine all parameters: some can change together without a worse fit"
        )
    return ModelFit(
        **{**_values(model, best.point), "estimates": found},
        model=model.model,
        correlations=correlations,
        series=tuple(
            SeriesFit(
                data=name,
                series=one,
                residuals=rest,
                deviation=rms(np.asarray(deviation)) * math.sqrt(variance),
                curve=curve,
            )
            for (name, one), rest, deviation, curve in every
        ),
        misfit=best.cost / variance,
        is_known=is_known,
        criterion=criterion(left, best.cost, p, is_known=is_known),
        whiteness=min(
            whiteness(rest / deviation, one.values / deviation)
            for rest, deviation, one in zip(left, model.deviations, model.series, strict=True)
        ),
        steps=sum(getattr(mesh, "n_steps", 0) for mesh in model.meshes),
        discretisation=float(ratio),
        is_converged=not message,
        message=message,
    )
