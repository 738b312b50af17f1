"""From settings to estimates with intervals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from fvi_cli.integrator.gradients.gradient import RunFailedError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread
from fvi_cli.studies.fits.intervals import estimates
from fvi_cli.studies.fits.model import TOLERANCES, Evaluation, MotionModel
from fvi_cli.studies.fits.result import Estimate, ModelFit, SeriesFit
from fvi_cli.studies.fits.search import Found, least_squares_from, search
from fvi_cli.studies.fits.settings import FitModel, FitSettings
from fvi_cli.studies.fits.statistics import ROUND_OFF, criterion, linearised, rms, whiteness

DISCRETISATION = 0.01
"""Permitted error of the runs, relative to the residuals: the difference from the next level."""
MOST_REWEIGHTINGS, ENOUGH = 20, 1e-3
"""Most iterations for the noise of the columns; they end when it changes by less, relative."""
LEAST_FREEDOM = 0.5
"""Degrees of freedom of a column below which its noise cannot be estimated."""
POINTS_OF_CURVES = 400


@in_one_thread
def fit_model(settings: FitSettings, described: FitModel) -> ModelFit:
    """Fit one model."""
    model = MotionModel(described, settings)
    point = model.start
    try:
        point = search(model)
        best, ratio = _polished(model, point)
        return _result(model, best, ratio)
    except ValueError as error:
        return ModelFit(model=described, message=str(error), **_values(model, point))


def _values(model: MotionModel, point: Array) -> dict[str, Any]:
    """Estimates without intervals, and the values that a configuration takes."""
    pairs = zip(model.free, point.tolist(), strict=True)
    return {
        "estimates": tuple(Estimate(name=one.key, value=value) for one, value in pairs),
        "assignments": tuple(model.assignments(k, point) for k in range(len(model.data))),
    }


def _polished(model: MotionModel, point: Array) -> tuple[Found, float]:
    """The minimum on steps that are fine enough, and their error relative to the residuals.

    Raises
    ------
    RunFailedError
        If the run fails at the best point, or the noise cannot be estimated.
    """
    model.remesh(point, 0)
    for finer in range(1, len(TOLERANCES)):
        best, used = _weighted(model, point), model.meshes
        point = best.point
        model.remesh(point, finer)
        change = model.evaluate(point, with_jacobian=False).residuals - best.at.residuals
        ratio = rms(change) / max(rms(best.at.residuals), 1e-300)
        if ratio <= DISCRETISATION:
            break
    model.meshes = used
    return best, ratio


def _weighted(model: MotionModel, point: Array) -> Found:
    """The minimum with the noise that is given, or that its residuals have."""
    for _ in range(MOST_REWEIGHTINGS):
        best = least_squares_from(model, point)
        if model.settings.is_known:
            break
        point, before, model.deviations = best.point, model.deviations, _noise(model, best)
        pairs = zip(model.deviations, before, strict=True)
        ratios = [float(new / old) for new, old in pairs]
        if max(ratios) < (1.0 + ENOUGH) * min(ratios):
            # the columns weigh as before
            factors, at = np.repeat(ratios, model.sizes), best.at
            at = Evaluation(
                residuals=at.residuals / factors, jacobian=at.jacobian / factors[:, None]
            )
            return replace(best, at=at)
    return best


def _noise(model: MotionModel, best: Found) -> list[Array | float]:
    """Standard deviation of the noise of every series, from the residuals."""
    found = list[Array | float]()
    left = model.split(best.at.residuals)
    freedoms = linearised(best.at.jacobian, model.sizes).series_freedoms
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


def _result(model: MotionModel, best: Found, ratio: float) -> ModelFit:
    linear = linearised(best.at.jacobian, model.sizes)
    left, curves = model.split(best.at.residuals), model.curves(best.point, POINTS_OF_CURVES)
    named = [(data.name, one) for data in model.data for one in data.series]
    every = zip(named, left, model.deviations, curves, strict=True)
    message = best.message
    if not linear.is_regular:
        message = message or (
            "the data do not determine all parameters: some can change together without a worse fit"
        )
    series = tuple(
        SeriesFit(
            data=name,
            series=one,
            residuals=rest,
            deviation=rms(np.asarray(deviation)),
            curve=curve,
        )
        for (name, one), rest, deviation, curve in every
    )
    is_known = model.settings.is_known
    return ModelFit(
        **{**_values(model, best.point), "estimates": estimates(model, best, linear)},
        model=model.model,
        correlations=linear.correlations,
        series=series,
        criterion=criterion(left, best.at.cost, len(model.free), is_known=is_known),
        whiteness=min(
            whiteness(rest / deviation, one.values / deviation)
            for rest, deviation, one in zip(left, model.deviations, model.series, strict=True)
        ),
        steps=sum(getattr(mesh, "n_steps", 0) for mesh in model.meshes),
        discretisation=float(ratio),
        is_converged=not message,
        message=message,
    )
