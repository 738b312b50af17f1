"""The fits of a configuration."""

from __future__ import annotations

import functools
import logging
from collections.abc import Sequence
from pathlib import Path

from fvi_cli.config import LoadedConfig
from fvi_cli.config.fits.fitted import fitted_text
from fvi_cli.errors import RequestError
from fvi_cli.runner.progress import Task, carry_out
from fvi_cli.runner.request import Source, load
from fvi_cli.storage.files import replace_file
from fvi_cli.studies.fits.result import FitResult, ModelFit
from fvi_cli.studies.fits.settings import FitModel, FitSettings

_logger = logging.getLogger(__name__)


def fit(
    source: Source, *, overrides: Sequence[str] = (), progress: bool = False
) -> list[FitResult]:
    """Fit numbers of a problem to measurements, as ``fvi fit`` does.

    Parameters
    ----------
    source
        As for :func:`load`.
    overrides
        Changes ``key.path=value``, only for a configuration that is not loaded yet.
    progress
        As for :func:`run`.

    One result for every experiment with ``fit``; its message says if a fit did not converge.

    Raises
    ------
    RequestError
        If no experiment has ``fit``, and for parameters without influence on the data.
    """
    config = load(source, overrides=overrides)
    found = iter(carry_out(fit_tasks(config), config.name, progress=progress))
    results = []
    for experiment in config.experiments:
        if experiment.fit is None:
            continue
        models = tuple(next(found) for _ in experiment.fit.models)
        for model in models:
            title = f"{experiment.name} {model.model.name}".strip()
            if not model.is_converged:
                _logger.error("%s: no fit: %s", title, model.message)
            for warning in model.warnings:
                _logger.warning("%s: %s", title, warning)
        results.append(
            FitResult(
                name=experiment.name, settings=experiment.fit, models=models, units=experiment.units
            )
        )
    return results


def fit_tasks(config: LoadedConfig) -> list[Task]:
    """A task for every model, with its parameters and data."""
    tasks = [
        Task(
            experiment=experiment.name,
            action=f"fit {model.name}".strip(),
            of=f"{', '.join(one.key for one in model.parameters)} to "
            + ", ".join(data.name for data in experiment.fit.data),
            work=functools.partial(_fit, experiment.fit, model),
        )
        for experiment in config.experiments
        if experiment.fit is not None
        for model in experiment.fit.models
    ]
    if not tasks:
        raise RequestError(f"{config.name}: fit: missing; write it with data and parameters")
    return tasks


def _fit(settings: FitSettings, model: FitModel) -> ModelFit:
    # a slow import, which a dry run need not wait for
    from fvi_cli.studies.fits.fitting import fit_model

    return fit_model(settings, model)


def write_fitted(config: LoadedConfig, results: Sequence[FitResult], output: Path) -> list[Path]:
    """Write a configuration with the best estimates for every experiment that has some."""
    names = [one.name for one in config.experiments]
    paths = []
    for result in results:
        best = result.best
        if not best.is_converged:
            continue
        motions = [
            (data.name, values)
            for data, values in zip(result.settings.data, best.assignments, strict=True)
        ]
        number = names.index(result.name)
        text = fitted_text(config, number, best.model.specification, motions, output)
        path = output / f"{result.name}-fitted.yaml"
        output.mkdir(parents=True, exist_ok=True)
        replace_file(path, text.encode())
        paths.append(path)
    return paths
