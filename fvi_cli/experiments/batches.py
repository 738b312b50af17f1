"""Runs that are computed, and stored, together."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.experiments.experiment import FinishedRun, Run
from fvi_cli.experiments.study import execute


def batches_of(runs: Sequence[Run]) -> list[tuple[Run, ...]]:
    """The runs in the groups that are computed together, in their order."""
    return [(run,) for run in runs]


def execute_batch(batch: tuple[Run, ...]) -> list[FinishedRun]:
    """Compute every run of a batch and its error; see :func:`study.execute`."""
    return [execute(run) for run in batch]
