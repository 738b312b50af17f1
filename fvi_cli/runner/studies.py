"""Studies other than runs: what accuracy costs, what is stable, and fits to measurements."""

from __future__ import annotations

import functools
import itertools
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from fvi_cli.config import LoadedConfig
from fvi_cli.config.fits.fitted import fitted_text
from fvi_cli.errors import RequestError
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.patterns import has_patterns
from fvi_cli.integrator.stability.region import StabilityMap, stability_map
from fvi_cli.mathematics.arrays import Array
from fvi_cli.runner.progress import Task, carry_out
from fvi_cli.runner.request import Source, load
from fvi_cli.storage.files import replace_file
from fvi_cli.studies.cost import REPEATS, CostRow, CostTable, measure_cost
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment, Run
from fvi_cli.studies.fits.result import FitResult, ModelFit
from fvi_cli.studies.fits.settings import FitModel, FitSettings
from fvi_cli.studies.study import StabilityRow, StabilityTable, prediction_of

_logger = logging.getLogger(__name__)


def cost(source: Source, *, repeats: int = REPEATS, progress: bool = False) -> list[CostTable]:
    """Error, time and work of every method, as ``fvi cost`` measures them.

    One run after the other, in this process.

    Parameters
    ----------
    source
        As for :func:`load`.
    repeats
        How often every run is timed.
    progress
        As for :func:`run`.

    Raises
    ------
    RequestError
        For a sweep, and where nothing is integrated.
    """
    config = load(source)
    tasks = cost_tasks(config, repeats=repeats)
    rows: list[CostRow] = carry_out(tasks, config.name, progress=progress)
    tables = [
        CostTable(experiment=one, rows=tuple(r for r in rows if r.finished.run.experiment is one))
        for one in config.experiments
    ]
    for line in (line for table in tables for line in table.unexpected):
        _logger.warning("%s", line)
    return tables


def cost_tasks(config: LoadedConfig, *, repeats: int = REPEATS) -> list[Task]:
    """A task for every run that is timed; raises :class:`RequestError` as :func:`cost` does."""
    if complaints := list(_cost_complaints(config)):
        raise RequestError(*complaints)
    return [
        Task(
            experiment=experiment.name,
            action=f"time {run.method.label}",
            of=f"N = {run.n_steps}",
            work=functools.partial(measure_cost, run, repeats=repeats),
        )
        for experiment in config.experiments
        for run in experiment.runs()
    ]


def _cost_complaints(config: LoadedConfig) -> Iterator[str]:
    """Why costs of an experiment cannot be measured."""
    for one in config.experiments:
        if one.members:
            yield f"{one.name}: costs are measured for one scene; leave out sweep"
        elif one.problem.scene is None:
            yield f"{one.name}: costs are measured for motions, not for a fractional derivative"
        elif one.needs_search:
            yield f"{one.name}: {NEEDS_LADDER}"
        elif one.problem.exact_source == "none":
            yield f"{one.name}: exact: none gives no errors; write --set problem.exact=auto"


def stability(source: Source, *, progress: bool = False) -> list[StabilityTable]:
    """What is predicted to be stable, as ``fvi stability`` studies it.

    Parameters
    ----------
    source
        As for :func:`load`.
    progress
        As for :func:`run`.

    Raises
    ------
    RequestError
        For an experiment in which nothing is integrated.
    """
    return [_stability_of(one, progress=progress) for one in load(source).experiments]


def stability_tasks(config: LoadedConfig) -> list[Task]:
    """A task for every method with every number of steps, and for every region."""
    return [task for one in config.experiments for task in _stability_tasks_of(one)]


def _stability_of(experiment: Experiment, *, progress: bool) -> StabilityTable:
    found = carry_out(list(_stability_tasks_of(experiment)), experiment.name, progress=progress)
    results = list(itertools.chain.from_iterable(found))
    return StabilityTable(
        experiment=experiment,
        rows=tuple(one for one in results if isinstance(one, StabilityRow)),
        regions=tuple(one for one in results if isinstance(one, StabilityMap)),
    )


def _stability_tasks_of(experiment: Experiment) -> Iterator[Task]:
    if experiment.needs_search:
        raise RequestError(f"{experiment.name}: {NEEDS_LADDER}")
    scene = experiment.problem.scene
    if scene is None or scene.prescribed is not None:
        words = "has no motion" if scene is None else "has a given motion"
        raise RequestError(f"{experiment.name}: {words}, and so no stability")
    for method, n_steps in itertools.product(experiment.methods, experiment.steps):
        of = (f"N = {n_steps}", f"{len(experiment.members)} members" * bool(experiment.members))
        yield Task(
            experiment=experiment.name,
            action=f"predict {method.label}",
            of=", ".join(filter(None, of)),
            work=functools.partial(_stability_rows, experiment, method, n_steps),
        )
    if (region := experiment.stability.region) is None:
        return
    for order in region.orders:
        for method in _distinct_regions(experiment.methods):
            yield Task(
                experiment=experiment.name,
                action=f"region of {method.label}",
                of=f"order {order:g}",
                work=functools.partial(_stability_maps, method, order, *map(np.array, region.axes)),
            )


def _distinct_regions(methods: Sequence[AnyMethod]) -> list[AnyMethod]:
    """One method for each stability region: start and forcing do not change the region."""
    found: dict[str, AnyMethod] = {}
    for method in filter(has_patterns, methods):
        keys = {k: v for k, v in method.keys.items() if k not in ("start", "forcing_quadrature")}
        found.setdefault(repr(keys), method)
    return list(found.values())


def _stability_rows(
    experiment: Experiment, method: AnyMethod, n_steps: int
) -> Sequence[StabilityRow]:
    runs = (
        Run(experiment=experiment, method=method, n_steps=n_steps, member=member)
        for member in experiment.members or (None,)
    )
    return [StabilityRow(run=run, prediction=prediction_of(run)) for run in runs]


def _stability_maps(
    method: AnyMethod, order: float, stiffness: Array, damping: Array
) -> Sequence[StabilityMap]:
    return [stability_map(method, order, stiffness, damping)]


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
        replace_file(path, text.encode())
        paths.append(path)
    return paths
