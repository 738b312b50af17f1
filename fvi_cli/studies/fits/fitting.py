"""From settings to estimates with intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fvi_cli.errors import RequestError
from fvi_cli.integrator.gradients.gradient import RunFailedError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.intervals import estimates
from fvi_cli.studies.fits.model import Evaluation, MotionModel, rms
from fvi_cli.studies.fits.profile import BetterMinimumError, Minimum, quantile
from fvi_cli.studies.fits.result import Estimate, FitResult, ModelFit, SeriesFit
from fvi_cli.studies.fits.search import HOPELESS, Found, distinct, least_squares_from, search
from fvi_cli.studies.fits.settings import FitModel, FitSettings
from fvi_cli.studies.fits.statistics import (
    ROUND_OFF,
    covariance,
    criterion,
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
MOST_OTHERS = 3
"""How many minima apart from the best are refined."""
SEPARATION = 10.0
"""Points at least so many standard deviations away belong to another minimum."""
NO_INFLUENCE = 1e-10
POINTS_OF_CURVES = 400

Log = Callable[[str], None]


class NoFitError(ValueError):
    """No model could be fitted; holds the reason and the last point that was tried."""

    def __init__(self, message: str, point: Array) -> None:
        super().__init__(message)
        self.point = point


def fit_models(name: str, settings: FitSettings, *, log: Log = lambda words: None) -> FitResult:
    """Fit every model of an experiment to its data.

    Raises
    ------
    RequestError
        For parameters without influence on the data.
    """
    models = []
    for model in settings.models:
        log(model.name or name)
        models.append(fit_model(settings, model))
    return FitResult(name=name, settings=settings, models=tuple(models))


def fit_model(settings: FitSettings, described: FitModel) -> ModelFit:
    """Fit one model.

    Raises
    ------
    RequestError
        For parameters without influence on the data.
    """
    model = MotionModel(described, settings.data, ())
    model.deviations = [rms(one.values) or 1.0 for one in model.series]
    if settings.deviation is not None:
        model.deviations = [settings.deviation] * len(model.series)
    scale = _scale(model)
    _check_influence(model, scale)
    found = search(model, model.bounds, scale)
    if not found:
        return _failed(model, "every run near the starting values fails", model.start)
    try:
        return _fit_from(model, found, scale, is_known=settings.deviation is not None)
    except NoFitError as error:
        return _failed(model, str(error), error.point)
    except RunFailedError as error:
        return _failed(model, f"the run fails at the best point ({error})", found[0].point)


def _fit_from(
    model: MotionModel, found: Sequence[Found], scale: float, *, is_known: bool
) -> ModelFit:
    """The result from rough minima, the best first.

    Raises
    ------
    NoFitError, RunFailedError
        If there is no minimum, or the run at the best point does not reach its end.
    """
    best, others = found[0], list(found[1:])
    for _ in range(MOST_BETTER + 1):
        best, minimum, ratio = _polished(model, best, scale, is_known=is_known)
        close = [one for one in others if one.cost <= HOPELESS * found[0].cost][:MOST_OTHERS]
        polished = distinct(least_squares_from(model, one.point, model.bounds) for one in close)
        try:
            return _result(best, minimum, polished, ratio, is_known=is_known)
        except BetterMinimumError as better:
            others.append(best)
            best = replace(best, point=better.point)
    raise NoFitError(
        "the search for intervals keeps finding better minima: begin elsewhere, "
        "or fit fewer parameters",
        others[-1].point,
    )


def _polished(
    model: MotionModel, best: Found, scale: float, *, is_known: bool
) -> tuple[Found, Minimum, float]:
    """The minimum on steps that are fine enough, and their error relative to the residuals."""
    bounds, tolerance = model.bounds, FIRST_TOLERANCE
    while True:
        model.remesh(best.point, tolerance * scale)
        for _ in range(MOST_REWEIGHTINGS):
            again = least_squares_from(model, best.point, bounds)
            if again is None:
                raise NoFitError("the run fails at the best point", best.point)
            best = again
            at_best = model.evaluate(best.point)
            if is_known or len(model.series) == 1 or _is_clean(model, at_best):
                break
            fresh = _estimate_noise(model, best.point, at_best)
            change = max(abs(a / b - 1.0) for a, b in zip(fresh, model.deviations, strict=True))
            if change < ENOUGH:
                break
            model.deviations = fresh
        at_best = model.evaluate(best.point)
        used = model.meshes
        finer = max(LAST_TOLERANCE, 1e-3 * tolerance)
        model.remesh(best.point, finer * scale)
        difference = model.evaluate(best.point, with_jacobian=False).residuals - at_best.residuals
        ratio = rms(difference) / max(rms(at_best.residuals), 1e-300)
        if ratio <= DISCRETISATION or tolerance <= LAST_TOLERANCE:
            model.meshes = used
            return (
                best,
                Minimum(model=model, point=best.point, evaluation=at_best, bounds=bounds),
                ratio,
            )
        tolerance = max(LAST_TOLERANCE, 1e-4 * tolerance)


def _scale(model: MotionModel) -> float:
    """Size of the motion, a length."""
    sizes = [
        float(np.abs(one.values).max())
        for one in model.series
        if not (one.is_velocity or one.formula or one.amplitude)
    ]
    if sizes and max(sizes) > 0:
        return max(sizes)
    try:
        return model.size_at_start() or 1.0
    except ValueError:
        return 1.0


def _check_influence(model: MotionModel, scale: float) -> None:
    """Refuse parameters without influence on the data at the start of the search."""
    model.loosen(1e-5 * scale)
    try:
        jacobian = model.evaluate(model.start).jacobian
    except ValueError:
        return
    if jacobian is None:
        return
    sizes = np.abs(jacobian).max(axis=0)
    mistakes = []
    for one, value, size in zip(model.free, model.start, sizes, strict=True):
        if size * max(abs(value), 1.0) <= NO_INFLUENCE * max(float(sizes.max()), 1e-300):
            mistakes.append(
                f"{one.place}fit.parameters.{one.key}: it has no influence on "
                f"what was measured where the search begins ({one.start:g}); begin elsewhere, or "
                "leave it out"
            )
    if mistakes:
        raise RequestError(*mistakes)


def _is_clean(model: MotionModel, at: Evaluation) -> bool:
    """Whether the residuals are round-off."""
    data = np.concatenate([one.values for one in model.series])
    return rms(np.concatenate(model.split(at.residuals))) <= ROUND_OFF * rms(data)


def _estimate_noise(model: MotionModel, point: Array, at: Evaluation) -> list[float]:
    """Standard deviation of the noise of every series, from the residuals."""
    found = []
    for one, part, n in zip(
        model.series,
        model.split(at.residuals),
        series_freedoms(at, model.sizes).tolist(),
        strict=True,
    ):
        if n < LEAST_FREEDOM:
            raise NoFitError(
                f"the noise of column {one.column} cannot be estimated: the parameters use up its "
                f"values ({one.values.size}); write noise: with a standard deviation",
                point,
            )
        # a column that is met to round-off would weigh without bound
        least = max(ROUND_OFF * rms(one.values), 1e-300)
        found.append(max(math.sqrt(float(part @ part) / n), least))
    return found


def _result(
    best: Found, minimum: Minimum, others: Sequence[Found], ratio: float, *, is_known: bool
) -> ModelFit:
    model, at_best = minimum.model, minimum.evaluation
    p = len(model.free)
    freedom = model.size - p
    variance = 1.0 if is_known else max(at_best.cost / freedom, 1e-300)
    correlations, _, is_regular = covariance(at_best, variance)
    values = model.values(best.point)
    is_clean = _is_clean(model, at_best)
    is_sought = is_regular and best.is_converged
    found = estimates(minimum, variance, is_known=is_known, is_clean=is_clean, is_sought=is_sought)
    left = model.split(at_best.residuals)
    unit = 1.0 if is_known else math.sqrt(variance)
    deviations = [value * unit for value in model.deviations]
    series = [(data.name, one) for data in model.data for one in data.series]
    curves = model.curves(best.point, POINTS_OF_CURVES)
    alike = [
        tuple(model.values(one.point).tolist())
        for one in others
        if one.is_converged
        and one.cost - at_best.cost <= variance * quantile(freedom, is_known=is_known) ** 2
        and _is_separated(at_best, one.point - best.point, variance)
    ]
    message = best.message if not best.is_converged else ""
    if not is_regular:
        message = (
            message
            or "the data do not determine all parameters: "
            "some can change together without a worse fit"
        )
    return ModelFit(
        model=model.model,
        estimates=found,
        correlations=correlations,
        series=tuple(
            SeriesFit(data=name, series=one, residuals=rest, deviation=deviation, curve=curve)
            for (name, one), rest, deviation, curve in zip(
                series, left, deviations, curves, strict=True
            )
        ),
        misfit=at_best.cost / variance if is_known else float(freedom),
        criterion=criterion(left, deviations, p, is_known=is_known),
        whiteness=min(
            whiteness(rest, one.values) for rest, one in zip(left, model.series, strict=True)
        ),
        steps=sum(getattr(mesh, "n_steps", 0) for mesh in model.meshes),
        discretisation=float(ratio),
        others=tuple(alike),
        evaluations=model.evaluations,
        is_converged=best.is_converged and is_regular,
        message=message,
        assignments=tuple(model.assignments(number, values) for number in range(len(model.data))),
    )


def _is_separated(at_best: Evaluation, direction: Array, variance: float) -> bool:
    """Whether a point with a misfit like the best one is too far off to belong to that minimum."""
    if at_best.jacobian is None:
        return False
    expected = at_best.jacobian @ direction
    return float(expected @ expected) > SEPARATION**2 * variance


def _failed(model: MotionModel, message: str, point: Array) -> ModelFit:
    """The result of a fit that failed, with the reason."""
    values = model.values(point)
    return ModelFit(
        model=model.model,
        estimates=tuple(
            Estimate(name=one.key, value=float(value))
            for one, value in zip(model.free, values, strict=True)
        ),
        correlations=np.eye(len(model.free)),
        evaluations=model.evaluations,
        message=message,
        assignments=tuple(model.assignments(number, values) for number in range(len(model.data))),
    )
