"""From settings to estimates with intervals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from fvi_cli.errors import RequestError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import Evaluation, MotionModel, rms, series_of
from fvi_cli.studies.fits.profile import Side, profile_side, quantile
from fvi_cli.studies.fits.result import Estimate, FitResult, ModelFit, SeriesFit
from fvi_cli.studies.fits.search import HOPELESS, Found, distinct, least_squares_from, search
from fvi_cli.studies.fits.settings import FitModel, FitSettings, Series
from fvi_cli.studies.fits.statistics import ROUND_OFF, covariance, criterion, whiteness

FIRST_TOLERANCE, LAST_TOLERANCE = 1e-3, 1e-12
"""Of a step, relative to the size of the motion."""
DISCRETISATION = 0.01
"""Error of the runs that is allowed, relative to what is left of the data."""
LOOSE = 1e-4
"""Tolerance of a step while the minimum is looked for, relative to the size of the motion."""
MOST_REWEIGHTINGS = 6
MOST_OTHERS = 3
"""Minima beside the best that are looked at closely."""
APART = 10.0
"""Standard deviations by which the misfit of another minimum should be larger."""
NO_INFLUENCE = 1e-10
POINTS_OF_CURVES = 400
JUMP = 1.0
"""The order at which a motion with a start velocity jumps."""
ABOVE_JUMP = 1e-6

Tell = Callable[[str], None]


def fit(name: str, settings: FitSettings, *, tell: Tell = lambda words: None) -> FitResult:
    """Fit every model of an experiment to its data.

    Parameters
    ----------
    name
        Of the experiment.
    settings
        What is asked for.
    tell
        Hears what is being done.

    Raises
    ------
    RequestError
        For parameters without influence on the data.
    """
    models = []
    for model in settings.models:
        tell(model.name or name)
        models.append(fit_model(settings, model))
    return FitResult(name=name, settings=settings, models=tuple(models))


def fit_model(settings: FitSettings, described: FitModel, *, with_scan: bool = True) -> ModelFit:
    """Fit one model.

    Parameters
    ----------
    settings, described
        The data, and what is fitted to them.
    with_scan
        Look around the start; otherwise it is taken for good.

    Raises
    ------
    RequestError
        For parameters without influence on the data.
    """
    is_known = bool(settings.deviations)
    every = series_of(settings.data)
    deviations = [settings.deviations.get(one.name, 0.0) or rms(one.values) or 1.0 for one in every]
    model = MotionModel(described, settings.data, _nested(settings, deviations))
    scale = _scale(model)
    _check_influence(model, scale)
    found: list[Found] = []
    for bounds in _regions(model):
        if with_scan:
            found += search(model, bounds, scale)
        elif _holds(bounds, model.start):
            model.loosen(LOOSE * scale)
            found += distinct([least_squares_from(model, model.start, bounds, tolerance=1e-3)])
    found = distinct(found)
    if not found:
        return _failed(model, "no run comes to its end near the start")
    best, others = found[0], found[1:]
    bounds = next(b for b in _regions(model) if _holds(b, best.point))
    tolerance, ratio = FIRST_TOLERANCE, math.inf
    while True:
        model.remesh(best.point, tolerance * scale)
        for _ in range(MOST_REWEIGHTINGS):
            again = least_squares_from(model, best.point, bounds)
            if again is None:
                return _failed(model, "the run fails at the best point", best.point)
            best = again
            if is_known or len(every) == 1:
                break
            fresh = _estimated(model, best.point)
            change = max(abs(a / b - 1.0) for a, b in zip(fresh, deviations, strict=True))
            deviations = fresh
            model.deviations = _nested(settings, deviations)
            if change < 0.01:
                break
        at_best = model.evaluate(best.point)
        used = model.meshes
        finer = max(LAST_TOLERANCE, 1e-3 * tolerance)
        model.remesh(best.point, finer * scale)
        difference = model.evaluate(best.point, with_jacobian=False).residuals - at_best.residuals
        ratio = rms(difference) / max(rms(at_best.residuals), 1e-300)
        if ratio <= DISCRETISATION or tolerance <= LAST_TOLERANCE:
            model.meshes = used
            break
        tolerance = max(LAST_TOLERANCE, 1e-4 * tolerance)
    close = [one for one in others if one.cost <= HOPELESS * found[0].cost][:MOST_OTHERS]
    polished = distinct(
        least_squares_from(
            model, one.point, next(b for b in _regions(model) if _holds(b, one.point))
        )
        for one in close
    )
    return _result(model, best, at_best, polished, deviations, ratio, bounds, is_known=is_known)


def _nested(settings: FitSettings, deviations: Sequence[float]) -> list[list[float]]:
    rest = iter(deviations)
    return [[next(rest) for _ in data.series] for data in settings.data]


def _scale(model: MotionModel) -> float:
    """Size of the motion, a length."""
    sizes = [
        float(np.abs(one.values).max())
        for one in series_of(model.data)
        if not (one.is_velocity or one.formula or one.amplitude)
    ]
    if sizes and max(sizes) > 0:
        return max(sizes)
    try:
        return model.size_at_start() or 1.0
    except ValueError:
        return 1.0


def _check_influence(model: MotionModel, scale: float) -> None:
    """Refuse parameters that change nothing where the search begins."""
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
                f"{one.place}fit.parameters.{one.key.partition('@')[0]}: it has no influence on "
                f"what was measured where the search begins ({one.start:g}); begin elsewhere, or "
                "leave it out"
            )
    if mistakes:
        raise RequestError(*mistakes)


def _regions(model: MotionModel) -> list[tuple[Array, Array]]:
    """Bounds within which the motion is a smooth function of the parameters.

    A Caputo derivative of order above 1 subtracts the start velocity: there the motion jumps.
    """
    low, high = model.bounds
    values = model.values(model.start)
    motions = any(not data.forces for data in model.data)
    moving = motions and any("velocity" in one.key for one in model.free)
    for number, data in enumerate(model.data):
        if data.forces:
            continue
        scene = model.scene(number, values)
        moving |= scene.derivative == "caputo" and bool(np.any(scene.initial_velocity != 0))
    split = [
        index
        for index, one in enumerate(model.free)
        if moving and one.key.partition("@")[0].endswith("order") and low[index] < 1 < high[index]
    ]
    found = []
    for sides in itertools.product((False, True), repeat=min(len(split), 2)):
        below, above = low.copy(), high.copy()
        for index, is_above in zip(split, sides, strict=False):
            if is_above:
                below[index] = JUMP + ABOVE_JUMP
            else:
                above[index] = JUMP
        found.append((below, above))
    return found


def _holds(bounds: tuple[Array, Array], point: Array) -> bool:
    return bool(np.all(point >= bounds[0]) and np.all(point <= bounds[1]))


def _split(model: MotionModel, residuals: Array) -> list[Array]:
    """Residuals of every series in the unit of the data."""
    sizes = [one.values.size for one in series_of(model.data)]
    deviations = [value for row in model.deviations for value in row]
    parts = np.split(residuals, np.cumsum(sizes)[:-1])
    return [part * deviation for part, deviation in zip(parts, deviations, strict=True)]


def _estimated(model: MotionModel, point: Array) -> list[float]:
    """Deviations of the series from what is left."""
    left = _split(model, model.evaluate(point, with_jacobian=False).residuals)
    share = 1.0 - len(model.free) / model.size
    return [max(rms(one) / math.sqrt(share), 1e-300) for one in left]


def _result(
    model: MotionModel,
    best: Found,
    at_best: Evaluation,
    others: Sequence[Found],
    deviations: Sequence[float],
    ratio: float,
    bounds: tuple[Array, Array],
    *,
    is_known: bool,
) -> ModelFit:
    n, p = model.size, len(model.free)
    freedom = n - p
    variance = 1.0 if is_known else max(at_best.cost / freedom, 1e-300)
    correlations, errors, is_regular = covariance(at_best, variance)
    threshold = quantile(freedom, is_known=is_known)
    slopes, values = model.slopes(best.point), model.values(best.point)
    data = np.concatenate([o.values for o in series_of(model.data)])
    is_clean = rms(np.concatenate(_split(model, at_best.residuals))) <= ROUND_OFF * rms(data)
    estimates = []
    for index, one in enumerate(model.free):
        reach = (bounds[0][index], bounds[1][index])
        sides: list[Side] = []
        for sign, limit in ((-1.0, bounds[0][index]), (1.0, bounds[1][index])):
            step = sign * threshold * errors[index]
            if is_clean:
                # the misfit is round-off: only its curvature says anything
                sides.append(Side(end=float(np.clip(best.point[index] + step, *reach))))
            elif not is_regular or not best.is_converged:
                sides.append(Side(end=sign * math.inf))
            else:
                sides.append(
                    profile_side(
                        model,
                        best.point,
                        at_best,
                        index,
                        step,
                        float(limit),
                        variance=variance,
                        threshold=threshold,
                    )
                )
        low, high = (one.outer(side.end) for side in sides)
        ends = {(True, True): "both", (True, False): "low", (False, True): "high"}
        tried = np.concatenate([sides[0].points, [[best.point[index], 0.0]], sides[1].points])
        tried = tried[np.argsort(tried[:, 0])]
        profile = np.column_stack([[one.outer(u) for u in tried[:, 0]], tried[:, 1]])
        estimates.append(
            Estimate(
                name=one.key,
                value=float(values[index]),
                standard_error=float(errors[index] * slopes[index]),
                low=low,
                high=high,
                at_bound=ends.get((sides[0].is_bound, sides[1].is_bound), ""),
                profile=profile,
            )
        )
    left = _split(model, at_best.residuals)
    alike = [
        tuple(model.values(one.point).tolist())
        for one in others
        if one.is_converged
        and one.cost - at_best.cost <= variance * threshold**2
        and _is_apart(at_best, one.point - best.point, variance)
    ]
    message = best.message if not best.is_converged else ""
    if not is_regular:
        message = message or "the data do not determine all parameters: some can be traded"
    return ModelFit(
        model=model.model,
        estimates=tuple(estimates),
        correlations=correlations,
        series=_series(model, best.point, left, deviations, is_known=is_known),
        misfit=at_best.cost / variance if is_known else float(freedom),
        criterion=criterion(left, deviations, p, is_known=is_known),
        whiteness=min((whiteness(one, data.values) for one, data in _paired(model, left))),
        steps=sum(getattr(mesh, "n_steps", 0) for mesh in model.meshes),
        discretisation=float(ratio),
        others=tuple(alike),
        evaluations=model.evaluations,
        is_converged=best.is_converged and is_regular,
        message=message,
        assignments=tuple(model.assignments(number, values) for number in range(len(model.data))),
    )


def _is_apart(at_best: Evaluation, way: Array, variance: float) -> bool:
    """Whether a point lies so far off that a misfit like the best one is another minimum's."""
    if at_best.jacobian is None:
        return False
    expected = at_best.jacobian @ way
    return float(expected @ expected) > APART**2 * variance


def _paired(model: MotionModel, left: Sequence[Array]) -> list[tuple[Array, Series]]:
    return list(zip(left, series_of(model.data), strict=True))


def _series(
    model: MotionModel,
    point: Array,
    left: Sequence[Array],
    deviations: Sequence[float],
    *,
    is_known: bool,
) -> tuple[SeriesFit, ...]:
    curves = [one for each in model.curves(point, POINTS_OF_CURVES) for one in each]
    names = [data.name for data in model.data for _ in data.series]
    share = math.sqrt(1.0 - len(model.free) / model.size)
    return tuple(
        SeriesFit(
            data=name,
            series=series,
            residuals=rest,
            deviation=float(deviation if is_known else rms(rest) / share),
            curve=np.array(curve),
        )
        for name, series, rest, deviation, curve in zip(
            names, series_of(model.data), left, deviations, curves, strict=True
        )
    )


def _failed(model: MotionModel, message: str, point: Array | None = None) -> ModelFit:
    """What is reported where nothing could be computed."""
    values = model.values(model.start if point is None else point)
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
