"""Stability over steps and parameters, and in the plane of one step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.patterns import has_patterns
from fvi_cli.integrator.stability.prediction import StabilityPrediction
from fvi_cli.integrator.stability.region import StabilityMap
from fvi_cli.studies.experiment import Experiment, Run


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityRow:
    """One method on one member with one step size."""

    run: Run
    prediction: StabilityPrediction


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityTable:
    """The stability study of one experiment."""

    experiment: Experiment
    rows: tuple[StabilityRow, ...]
    regions: tuple[StabilityMap, ...] = ()


def distinct_regions(methods: Sequence[AnyMethod]) -> list[AnyMethod]:
    """One method for each stability region: start and forcing do not change the region."""
    found: dict[str, AnyMethod] = {}
    for method in filter(has_patterns, methods):
        keys = {k: v for k, v in method.keys.items() if k not in ("start", "forcing_quadrature")}
        found.setdefault(repr(keys), method)
    return list(found.values())
