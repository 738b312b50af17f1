"""The fits of a request."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from pathlib import Path

from fvi_cli.config.fits.fitted import fitted_text
from fvi_cli.errors import RequestError
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Request, Source, Task, requested
from fvi_cli.storage.files import replace_file
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.fits.result import FitResult
from fvi_cli.studies.fits.settings import FitSettings

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
        As for :func:`stability`.

    Returns
    -------
    list of FitResult
        One for every experiment with ``fit``; its message says if a fit did not converge.

    Raises
    ------
    RequestError
        If no experiment has ``fit``, and for parameters without influence on the data.
    """
    from fvi_cli.studies.fits.fitting import fit_models as fit_experiment

    request = requested(source, overrides=overrides)
    chosen = _chosen(request)
    results = []
    total = sum(len(settings.models) for _, settings in chosen)
    with progress_bar(request.name, total, wanted=progress) as advance:
        for experiment, settings in chosen:
            found = fit_experiment(experiment.name, settings, log=advance)
            results.append(dataclasses.replace(found, units=experiment.units))
            for model in found.models:
                title = f"{experiment.name} {model.model.name}".strip()
                if not model.is_converged:
                    _logger.error("%s: no fit: %s", title, model.message)
                for warning in model.warnings:
                    _logger.warning("%s: %s", title, warning)
    return results


def _chosen(request: Request) -> list[tuple[Experiment, FitSettings]]:
    """The experiments with ``fit``, and these settings."""
    chosen = [(one, one.fit) for one in request.loaded.experiments if one.fit is not None]
    if not chosen:
        raise RequestError(f"{request.name}: fit: missing; write it with data and parameters")
    return chosen


def fit_tasks(request: Request) -> list[Task]:
    """A task for every model that would be fitted, with its parameters and data."""
    return [
        Task(
            experiment=experiment.name,
            action=f"fit {model.name}".strip(),
            of=f"{', '.join(one.key for one in model.parameters)} to "
            + ", ".join(data.name for data in settings.data),
        )
        for experiment, settings in _chosen(request)
        for model in settings.models
    ]


def write_fitted(request: Request, results: list[FitResult], output: Path) -> list[Path]:
    """Write a configuration with the best estimates for every experiment that has some."""
    names = [one.name for one in request.loaded.experiments]
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
        try:
            text = fitted_text(request.loaded, number, best.model.specification, motions, output)
        except RequestError as error:
            _logger.error("%s", error)
            continue
        path = output / f"{result.name}-fitted.yaml"
        output.mkdir(parents=True, exist_ok=True)
        replace_file(path, text.encode())
        paths.append(path)
    return paths
