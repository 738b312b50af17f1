"""What is known of Newton's iteration in a run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, eq=False)
class NewtonRecord:
    """How Newton's iteration went: one residual norm per iteration of the steps worth keeping."""

    iterations: int = 0  # total number of iterations
    largest: int = 0  # largest number of iterations in one step
    worst_step: int = -1  # the step that took that many
    worst_residuals: tuple[float, ...] = ()  # residual norms of that step, first to last
