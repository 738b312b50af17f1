"""The report on fits: estimates with intervals, correlations, comparison of models."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from fvi_cli.reports.document import Block, Bullets, Heading, Paragraph
from fvi_cli.reports.table import (
    About,
    Column,
    Report,
    Sheet,
    Within,
    grid_of,
    pivot,
    within,
)
from fvi_cli.studies.fits.result import Estimate, FitResult, ModelFit

ESTIMATED = Within(relative=1e-5, absolute=1e-9)
"""Tolerance between two fits of the same data."""
ROUGH = Within(relative=1e-2)

_EXPERIMENT = Column("experiment", "name of the experiment", get="result.name")
_MODEL = Column("model", "name of the model; empty: the only one", "model", get="model.model.name")
_WHOSE = (_EXPERIMENT, replace(_MODEL, meaning="name of the model", title=""))

PARAMETER_COLUMNS = (
    *within(
        "one",
        Column("parameter", "key path", get="name"),
        Column("estimate", "in the unit of the key", compared=ESTIMATED, get="value"),
        Column("standard_error", "from the curvature of the misfit, same unit", compared=ROUGH),
        Column(
            "low",
            "lower end of the 95 % interval by profile likelihood; -inf: no limit; "
            "empty: not found",
            compared=ROUGH,
        ),
        Column(
            "high",
            "upper end of the 95 % interval; inf: no limit; empty: not found",
            compared=ROUGH,
        ),
        Column("at_bound", "which ends of the interval are bounds of the parameter"),
    ),
    _EXPERIMENT,
    _MODEL,
    *within(
        "model",
        Column("aicc", "that of the model", compared=ROUGH, get="criterion"),
        Column("whiteness", "that of its residuals", compared=Within(relative=5e-2)),
    ),
    Column("status", "ok or failed", get=lambda of: ("failed", "ok")[of.model.is_converged]),
)
MODEL_COLUMNS = (
    _EXPERIMENT,
    _MODEL,
    Column(
        "parameters",
        "number of fitted parameters",
        "parameters",
        get=lambda of: len(of.model.estimates),
    ),
    *within(
        "model",
        Column("values", "number of measured values", get="n_values"),
        Column(
            "aicc",
            "corrected Akaike information criterion; smaller is better",
            "AICc",
            ".1f",
            compared=ROUGH,
            get="criterion",
        ),
    ),
    Column(
        "aicc_difference",
        "to the best model",
        "difference",
        ".1f",
        compared=ROUGH,
        get=lambda of: (
            of.model.criterion - of.result.best.criterion
            if math.isfinite(of.model.criterion)
            else math.inf
        ),
    ),
    *within(
        "model",
        Column(
            "whiteness",
            "probability (Ljung and Box) of the residuals, if they are noise",
            "noise?",
            ".2g",
            compared=Within(relative=5e-2),
        ),
        Column("steps", "steps of the runs", compared=None),
        Column("discretisation", "error of the runs over the residuals", compared=None),
    ),
    Column(
        "status", "ok or failed", "status", get=lambda of: ("failed", "ok")[of.model.is_converged]
    ),
    Column("message", "why it failed", compared=None, get="model.message"),
)
NOISE_COLUMNS = (
    *_WHOSE,
    Column("motion", "name of the data set", get="one.data"),
    Column("column", "name of the column", get="one.series.column"),
    Column("values", "number of measured values", get=lambda of: int(of.one.series.values.size)),
    Column(
        "deviation",
        "standard deviation of the noise, unit of the column",
        compared=ROUGH,
        get="one.deviation",
    ),
)
CORRELATION_COLUMNS = (
    *_WHOSE,
    Column("parameter", "one parameter", get="one.name"),
    Column("other", "another one", get="other.name"),
    Column("correlation", "of their estimates, -1 to 1", compared=Within(absolute=1e-3)),
)
ESTIMATES = (
    Column("name", title="parameter"),
    Column("value", title="estimate", get=lambda one: _digits(one.value, one.standard_error)),
    Column("standard_error", title="standard error", form=lambda error: _digits(error, error)),
    Column("low", title="95 % from", get=lambda one: _end(one, one.low)),
    Column("high", title="to", get=lambda one: _end(one, one.high)),
)


def fit_report(name: str, results: Sequence[FitResult]) -> Report:
    """The report on the estimates of every experiment and model."""
    every = [(result, model) for result in results for model in result.models]
    whose = ("experiment", "model")
    models = [About(result=r, model=m) for r, m in every]
    estimates = [About(result=r, model=m, one=one) for r, m in every for one in m.estimates]
    noise = [About(result=r, model=m, one=one) for r, m in every for one in m.series]
    pairs = [
        About(result=r, model=m, one=one, other=other, correlation=float(m.correlations[i, j]))
        for r, m in every
        for i, one in enumerate(m.estimates)
        for j, other in enumerate(m.estimates[:i])
    ]
    return Report(
        name=f"{name}-fit",
        sheets=(
            Sheet.of("parameters", PARAMETER_COLUMNS, estimates, (*whose, "parameter")),
            Sheet.of("models", MODEL_COLUMNS, models, whose, is_file=False),
            Sheet.of("noise", NOISE_COLUMNS, noise, (*whose, "motion", "column"), is_file=False),
            Sheet.of(
                "correlations",
                CORRELATION_COLUMNS,
                pairs,
                (*whose, "parameter", "other"),
                is_file=False,
            ),
        ),
        blocks=list(_words(name, results)),
    )


def _words(name: str, results: Sequence[FitResult]) -> Iterator[Block]:
    yield Heading(1, f"Fit: {name}")
    for result in results:
        yield Heading(2, result.name)
        if len(result.models) > 1:
            models = sorted(result.models, key=lambda one: (not one.is_converged, one.criterion))
            items = (About(result=result, model=one) for one in models)
            yield grid_of(MODEL_COLUMNS, items)
        for model in result.models:
            if model.model.name:
                yield Heading(3, f"Model: {model.model.name}")
            yield from _estimates(model)


def _estimates(model: ModelFit) -> Iterator[Block]:
    if not model.is_converged:
        yield Paragraph(f"No fit: {model.message}. The best point so far:")
    yield grid_of(ESTIMATES, model.estimates)
    if len(model.estimates) > 1 and model.is_converged:
        yield Paragraph("Correlations of the estimates:")
        yield pivot(
            (
                ((f"{i + 1} {one.name}",), str(j + 1), (f"{model.correlations[i, j]:+.3f}",))
                for i, one in enumerate(model.estimates)
                for j in range(i)
            ),
            corner=("",),
            headings={str(j): (str(j),) for j in range(1, len(model.estimates))},
            absent="",
        )
    if model.series:
        yield Paragraph(_noise(model))
    if model.warnings:
        yield Bullets(tuple(model.warnings))


def _noise(model: ModelFit) -> str:
    """The noise of every column, and whether the residuals are noise."""
    columns = "; ".join(
        f"{one.data} {one.series.column}: {one.deviation:.3g} ({one.series.values.size} values)"
        for one in model.series
    )
    probability = f"Probability of the residuals if they are noise: {model.whiteness:.2g}."
    share = f"{model.discretisation:.0e}"
    steps = f" Runs of {model.steps} steps err by {share} of the residuals." if model.steps else ""
    return f"Standard deviation of the noise, {columns}. {probability}{steps}"


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
