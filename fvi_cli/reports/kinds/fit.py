"""The report on fits: estimates with intervals, and models side by side."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fvi_cli.reports.columns import Item
from fvi_cli.reports.table import Block, Column, Report, Sheet, Within, grid_of, listed
from fvi_cli.studies.fits.result import Estimate, FitResult, ModelFit

ESTIMATED = Within(relative=1e-5, absolute=1e-9)
"""Tolerance between two fits of the same data."""
ROUGH = Within(relative=1e-2)
VAGUE = Within(relative=5e-2)


def _status(of: Item) -> str:
    return "ok" if of.model.is_converged else "failed"


def _difference(of: Item) -> float:
    is_finite = math.isfinite(of.model.criterion)
    return float(of.model.criterion - of.result.best.criterion) if is_finite else math.inf


def _discretisation(of: Item) -> float | None:
    return of.model.discretisation if of.model.steps else None


PARAMETERS = (
    Column("", "model", get="model.model.name"),
    Column("parameter", "parameter", get="one.name"),
    Column("", "estimate", get=lambda of: _digits(of.one.value, of.one.standard_error)),
    Column("estimate", within=ESTIMATED, get="one.value"),
    # from the curvature of the misfit
    Column(
        "standard_error", "standard error", lambda e: _digits(e, e), ROUGH, "", "one.standard_error"
    ),
    # ends of the 95 % interval by profile likelihood; inf: no limit, nan: not found
    Column("low", within=ROUGH, get="one.low"),
    Column("high", within=ROUGH, get="one.high"),
    Column("", "95 % from", get=lambda of: _end(of.one, of.one.low)),
    Column("", "to", get=lambda of: _end(of.one, of.one.high)),
    Column("experiment", get="result.name"),
    Column("model", get="model.model.name"),
    Column("aicc", within=ROUGH, get="model.criterion"),
    Column("whiteness", within=VAGUE, get="model.whiteness"),
    Column("status", get=_status),
)
MODELS = (
    Column("experiment", get="result.name"),
    Column("model", "model", get="model.model.name"),
    Column("parameters", "parameters", get=lambda of: len(of.model.estimates)),
    Column("values", "values", get="model.n_values"),
    Column("aicc", "AICc", ".1f", ROUGH, get="model.criterion"),
    Column("aicc_difference", "difference", ".1f", ROUGH, get=_difference),
    # probability (Ljung and Box) of the residuals if they are noise
    Column("whiteness", "noise?", ".2g", VAGUE, get="model.whiteness"),
    # none for responses, which need no runs
    Column("steps", "steps", within=None, get=lambda of: of.model.steps or None),
    # error of the runs over the residuals
    Column("discretisation", "error of runs", ".0e", None, get=_discretisation),
    # standard deviations, of one series without its name
    Column("", "noise", get=lambda of: _noise(of.model)),
    Column("status", "status", get=_status),
    Column("message", within=None, get="model.message"),
)


def fit_report(name: str, results: Sequence[FitResult]) -> Report:
    """The report on the estimates of every experiment and model."""
    models = [Item(result=result, model=model) for result in results for model in result.models]
    return Report(
        name=f"{name}-fit",
        sheets=(
            Sheet(name="parameters", columns=PARAMETERS, items=_estimates(models)),
            Sheet(name="models", columns=MODELS, items=models, is_file=False),
        ),
        blocks=list(_blocks(name, results)),
        summary=list(_blocks(name, results, has_remarks=False)),
    )


def _estimates(models: Sequence[Item]) -> list[Item]:
    return [Item(**vars(of), one=one) for of in models for one in of.model.estimates]


def _blocks(
    name: str, results: Sequence[FitResult], *, has_remarks: bool = True
) -> Iterator[Block]:
    """Models and estimates; a terminal has shown the remarks before."""
    yield f"# Fit: {name}"
    for result in results:
        models = sorted(result.models, key=lambda one: (not one.is_converged, one.criterion))
        items = [Item(result=result, model=one) for one in models]
        if len(results) > 1:
            yield f"## {result.name}"
        yield grid_of(MODELS, items)
        yield grid_of(
            PARAMETERS, [Item(**vars(o), one=e) for o in items for e in o.model.estimates]
        )
        if has_remarks:
            yield from listed(
                f"{m.model.name}: {words}".removeprefix(": ")
                for m in models
                for words in _remarks(m)
            )


def _remarks(model: ModelFit) -> Iterator[str]:
    """Why there is no fit, and what is doubtful."""
    if not model.is_converged:
        yield f"no fit: {model.message}; these are the best numbers so far"
    yield from model.warnings


def _noise(model: ModelFit) -> str:
    """The standard deviation of the noise of every column."""
    named = len(model.series) > 1
    return ", ".join(
        f"{one.series.column} " * named + f"{one.deviation:.3g}" for one in model.series
    )


def _digits(value: float, error: float) -> str:
    """A number rounded to two digits of its standard error; the CSV form has all digits."""
    decimals = 1 - math.floor(math.log10(error)) if 0 < error < math.inf else 99
    if decimals > 8 or abs(value) >= 1e7:
        return f"{value:.8g}"
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def _end(one: Estimate, value: float) -> str:
    """An end of an interval."""
    if math.isnan(value):
        return "not found"
    return "no limit" if math.isinf(value) else _digits(value, one.standard_error)
