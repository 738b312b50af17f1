"""What was fitted: estimates with intervals, correlations, models side by side."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fvi_cli.reports.document import Block, Bullets, Code, Grid, Heading, Paragraph
from fvi_cli.reports.table import Column, Report, Sheet, Within, row_of
from fvi_cli.studies.fits.result import FitResult, ModelFit

ESTIMATED = Within(relative=1e-5, absolute=1e-9)
"""How close a fit comes to another one of the same data."""
ROUGH = Within(relative=1e-2)

PARAMETER_COLUMNS = (
    Column("parameter", "key path; with @ and the motion where each has its own"),
    Column("estimate", "in the unit of the key", compared=ESTIMATED),
    Column("standard_error", "from the curvature of the misfit, same unit", compared=ROUGH),
    Column(
        "low",
        "lower end of the 95 % interval by profile likelihood; -inf: no limit; empty: not found",
        compared=ROUGH,
    ),
    Column(
        "high", "upper end of the 95 % interval; inf: no limit; empty: not found", compared=ROUGH
    ),
    Column("at_bound", "which ends of the interval are bounds of the parameter"),
    Column("experiment", "name of the experiment"),
    Column("model", "name of the model; empty: the only one"),
)
MODEL_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("model", "name of the model; empty: the only one", "model"),
    Column("parameters", "number of fitted parameters", "parameters"),
    Column("values", "number of measured values"),
    Column(
        "aicc",
        "corrected Akaike information criterion; smaller is better",
        "AICc",
        ".1f",
        compared=ROUGH,
    ),
    Column("aicc_difference", "to the best model", "difference", ".1f", compared=ROUGH),
    Column(
        "whiteness",
        "probability (Ljung and Box) of what is left, if it is noise",
        "noise?",
        ".2g",
        compared=Within(relative=5e-2),
    ),
    Column("steps", "steps of the runs", compared=None),
    Column("discretisation", "error of the runs over what is left of the data", compared=None),
    Column("not_needed", "terms whose removal the data do not refuse", "not needed"),
    Column("status", "ok or failed", "status"),
    Column("message", "why it failed", compared=None),
)
NOISE_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("model", "name of the model"),
    Column("motion", "name of the data set"),
    Column("column", "name of the column"),
    Column("values", "number of measured values"),
    Column("deviation", "standard deviation of the noise, unit of the column", compared=ROUGH),
)
CORRELATION_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("model", "name of the model"),
    Column("parameter", "one parameter"),
    Column("other", "another one"),
    Column("correlation", "of their estimates, -1 to 1", compared=Within(absolute=1e-3)),
)


def fit_report(name: str, results: Sequence[FitResult]) -> Report:
    """Estimates of every experiment and model."""
    every = [(result, model) for result in results for model in result.models]
    words = tuple(_words(name, results))
    return Report(
        name=f"{name}-fit",
        sheets=(
            Sheet(
                name="parameters",
                columns=PARAMETER_COLUMNS,
                rows=tuple(
                    row_of(
                        PARAMETER_COLUMNS,
                        one,
                        parameter=one.name,
                        estimate=one.value,
                        experiment=result.name,
                        model=model.model.name,
                    )
                    for result, model in every
                    for one in model.estimates
                ),
                keys=("experiment", "model", "parameter"),
            ),
            _models(every),
            Sheet(
                name="noise",
                columns=NOISE_COLUMNS,
                rows=tuple(
                    {
                        "experiment": result.name,
                        "model": model.model.name,
                        "motion": one.data,
                        "column": one.series.column,
                        "values": int(one.series.values.size),
                        "deviation": one.deviation,
                    }
                    for result, model in every
                    for one in model.series
                ),
                keys=("experiment", "model", "motion", "column"),
                is_file=False,
            ),
            Sheet(
                name="correlations",
                columns=CORRELATION_COLUMNS,
                rows=tuple(
                    {
                        "experiment": result.name,
                        "model": model.model.name,
                        "parameter": model.estimates[i].name,
                        "other": model.estimates[j].name,
                        "correlation": float(model.correlations[i, j]),
                    }
                    for result, model in every
                    for i in range(len(model.estimates))
                    for j in range(i)
                ),
                keys=("experiment", "model", "parameter", "other"),
                is_file=False,
            ),
        ),
        summary=words,
        blocks=words,
    )


def _models(every: Sequence[tuple[FitResult, ModelFit]]) -> Sheet:
    return Sheet(
        name="models",
        columns=MODEL_COLUMNS,
        rows=tuple(
            row_of(
                MODEL_COLUMNS,
                model,
                experiment=result.name,
                model=model.model.name,
                parameters=len(model.estimates),
                values=model.n_values,
                aicc=model.criterion,
                aicc_difference=model.criterion - result.best.criterion
                if math.isfinite(model.criterion)
                else math.inf,
                not_needed=", ".join(one.key for one in model.needless),
                status="ok" if model.is_converged else "failed",
            )
            for result, model in every
        ),
        keys=("experiment", "model"),
    )


def _words(name: str, results: Sequence[FitResult]) -> Iterator[Block]:
    yield Heading(level=1, words=f"Fit: {name}")
    for result in results:
        yield Heading(level=2, words=(Code(result.name),))
        if len(result.models) > 1:
            models = sorted(result.models, key=lambda one: one.criterion)
            yield _models([(result, one) for one in models]).grid()
        for model in result.models:
            if model.model.name:
                yield Heading(level=3, words=f"Model: {model.model.name}")
            yield from _estimates(model)


def _estimates(model: ModelFit) -> Iterator[Block]:
    if not model.is_converged:
        yield Paragraph(words=f"No fit: {model.message}. The best point so far:")
    yield Grid(
        header=("parameter", "estimate", "standard error", "95 % from", "to"),
        rows=tuple(
            (
                one.name,
                f"{one.value:.8g}",
                f"{one.standard_error:.2g}",
                _end(one.low, one.reached[0], "<", one.value),
                _end(one.high, one.reached[1], ">", one.value),
            )
            for one in model.estimates
        ),
    )
    if len(model.estimates) > 1 and model.is_converged:
        names = [str(index) for index in range(1, len(model.estimates) + 1)]
        yield Paragraph(words="Correlations of the estimates:")
        yield Grid(
            header=("", *names[:-1]),
            rows=tuple(
                (
                    f"{names[i]} {model.estimates[i].name}",
                    *(
                        f"{model.correlations[i, j]:+.3f}" if j < i else ""
                        for j in range(len(names) - 1)
                    ),
                )
                for i in range(1, len(names))
            ),
        )
    if model.series:
        yield Paragraph(
            words="Noise: "
            + "; ".join(
                f"{one.data} {one.series.column}: standard deviation {one.deviation:.3g} "
                f"({one.series.values.size} values)"
                for one in model.series
            )
            + f". If what is left is noise, its correlations have probability "
            f"{model.whiteness:.2g}."
            + (
                f" Runs of {model.steps} steps err by {model.discretisation:.0e} of what is left."
                if model.steps
                else ""
            )
        )
    said = model.warnings if model.is_converged else [one.words for one in model.needless]
    if said:
        yield Bullets(items=tuple(said))


def _end(value: float, reached: float, sign: str, estimate: float) -> str:
    """An end of an interval; where it was not found, what is known of it."""
    if math.isinf(value):
        return "no limit"
    if not math.isnan(value):
        return f"{value:.8g}"
    return "not found" if math.isnan(reached) or reached == estimate else f"{sign} {reached:.6g}"
