"""What became of many members, in a line for every method and number of steps."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.studies.experiment import FinishedRun


@dataclass(frozen=True, kw_only=True)
class SweepLine:
    """The members of one sweep with one method and number of steps.

    Parameters
    ----------
    method, n_steps, step_size
        What they share.
    median_error, largest_error
        Over the members that have one; nan where none has.
    worst
        The values of the member with the largest error, in words.
    statuses
        ``ok``, or ``ok: 998; diverged: 2``.
    members
        How many are finished.
    """

    method: AnyMethod
    n_steps: int
    step_size: float
    median_error: float
    largest_error: float
    worst: str
    statuses: str
    members: int


def sweep_lines(finished: Iterable[FinishedRun]) -> list[SweepLine]:
    """A line for every method and number of steps, in the order of the runs."""
    groups: dict[tuple[AnyMethod, int], list[FinishedRun]] = {}
    for one in finished:
        groups.setdefault((one.run.method, one.run.n_steps), []).append(one)
    return [_line(method, n_steps, runs) for (method, n_steps), runs in groups.items()]


def _line(method: AnyMethod, n_steps: int, runs: list[FinishedRun]) -> SweepLine:
    having = [one for one in runs if math.isfinite(one.error)]
    worst = max(having, key=lambda one: one.error, default=None)
    return SweepLine(
        method=method,
        n_steps=n_steps,
        step_size=runs[0].run.step_size,
        median_error=statistics.median(one.error for one in having) if having else math.nan,
        largest_error=math.nan if worst is None else worst.error,
        worst="" if worst is None or worst.run.member is None else worst.run.member.label,
        statuses=counts_in_words(one.status for one in runs),
        members=len(runs),
    )


def counts_in_words(values: Iterable[str]) -> str:
    """``ok: 998; diverged: 2``, or the one word that all have."""
    counts = Counter(values)
    if len(counts) == 1:
        return next(iter(counts))
    return "; ".join(f"{value}: {count}" for value, count in counts.most_common())
