"""Stability studies of a configuration."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from fvi_cli.config import LoadedConfig
from fvi_cli.errors import RequestError
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.region import StabilityMap, stability_map
from fvi_cli.mathematics.arrays import Array
from fvi_cli.runner.progress import Task, carry_out
from fvi_cli.runner.request import Source, load
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment, Run
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable, distinct_regions
from fvi_cli.studies.study import prediction_of


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
    return [_study(one, progress=progress) for one in load(source).experiments]


def stability_tasks(config: LoadedConfig) -> list[Task]:
    """A task for every method with every number of steps, and for every region."""
    return [task for one in config.experiments for task in _tasks(one)]


def _study(experiment: Experiment, *, progress: bool) -> StabilityTable:
    found = carry_out(list(_tasks(experiment)), experiment.name, progress=progress)
    results = list(itertools.chain.from_iterable(found))
    return StabilityTable(
        experiment=experiment,
        rows=tuple(one for one in results if isinstance(one, StabilityRow)),
        regions=tuple(one for one in results if isinstance(one, StabilityMap)),
    )


def _tasks(experiment: Experiment) -> Iterator[Task]:
    if experiment.needs_search:
        raise RequestError(f"{experiment.name}: {NEEDS_LADDER}")
    if experiment.problem.scene is None:
        raise RequestError(f"{experiment.name}: has no motion, and so no stability")
    for method, n_steps in itertools.product(experiment.methods, experiment.steps):
        of = (f"N = {n_steps}", f"{len(experiment.members)} members" * bool(experiment.members))
        yield Task(
            experiment=experiment.name,
            action=f"predict {method.label}",
            of=", ".join(filter(None, of)),
            work=functools.partial(_rows, experiment, method, n_steps),
        )
    if (region := experiment.stability.region) is None:
        return
    for order in region.orders:
        for method in distinct_regions(experiment.methods):
            yield Task(
                experiment=experiment.name,
                action=f"region of {method.label}",
                of=f"order {order:g}",
                work=functools.partial(_maps, method, order, *map(np.array, region.axes)),
            )


def _rows(experiment: Experiment, method: AnyMethod, n_steps: int) -> Sequence[StabilityRow]:
    runs = (
        Run(experiment=experiment, method=method, n_steps=n_steps, member=member)
        for member in experiment.members or (None,)
    )
    return [StabilityRow(run=run, prediction=prediction_of(run)) for run in runs]


def _maps(
    method: AnyMethod, order: float, stiffness: Array, damping: Array
) -> Sequence[StabilityMap]:
    return [stability_map(method, order, stiffness, damping)]
