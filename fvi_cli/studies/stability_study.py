"""Stability over steps and parameters, and in the plane of one step."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.method import AnyMethod, without_start
from fvi_cli.integrator.stability.patterns import has_patterns
from fvi_cli.integrator.stability.prediction import StabilityPrediction, predict_stability
from fvi_cli.integrator.stability.region import StabilityMap, stability_map
from fvi_cli.studies.experiment import Experiment, Run


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityRow:
    """One method on one member with one step size."""

    run: Run
    prediction: StabilityPrediction
    failure: str = ""
    """Message of an internal error that prevented a result; else empty."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityTable:
    """The stability study of one experiment."""

    experiment: Experiment
    rows: tuple[StabilityRow, ...]
    regions: tuple[StabilityMap, ...] = ()


def stability_rows(
    experiment: Experiment, failed: Callable[[Run, Exception], str] | None = None
) -> Iterator[StabilityRow]:
    """The stability of every run of the experiment; the runs are not computed.

    `failed` returns the message for an exception other than a `ValueError`, and the other runs are
    still examined; without it the exception is raised.

    Raises
    ------
    ValueError
        If nothing is integrated: a fractional derivative has no stability.
    """
    if experiment.problem.scene is None:
        raise ValueError(f"{experiment.name}: has no motion, and so no stability")
    for run in experiment.runs():
        try:
            prediction = predict_stability(run.scene, run.method, run.n_steps)
            yield StabilityRow(run=run, prediction=prediction)
        except (ValueError, MemoryError):
            raise
        except Exception as error:
            if failed is None:
                raise
            message = failed(run, error)
            prediction = StabilityPrediction(verdict="unknown", reason=message)
            yield StabilityRow(run=run, prediction=prediction, failure=message)


def stability_maps(
    experiment: Experiment, advance: Callable[[str], object] = lambda doing: None
) -> tuple[StabilityMap, ...]:
    """The requested stability regions of an experiment, one for every order and method."""
    region, maps = experiment.stability.region, []
    if region is not None:
        stiffness, damping = map(np.array, region.axes)
        for order, method in itertools.product(region.orders, distinct_regions(experiment.methods)):
            maps.append(stability_map(method, order, stiffness, damping))
            advance(f"region of {method.label}")
    return tuple(maps)


def distinct_regions(methods: Sequence[AnyMethod]) -> list[AnyMethod]:
    """One method for each stability region: start and forcing do not change the region."""
    return list(dict.fromkeys(map(without_start, filter(has_patterns, methods))))
