"""What is known of Newton's iteration in a run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, eq=False)
class NewtonRecord:
    """How Newton's iteration went: one residual norm per iteration of the steps worth keeping.

    Parameters
    ----------
    iterations
        Total number of iterations.
    largest
        Largest number of iterations in one step.
    worst_step
        The step that took that many.
    worst_residuals
        Residual norms of that step, first to last.
    """

    iterations: int = 0
    largest: int = 0
    worst_step: int = -1
    worst_residuals: tuple[float, ...] = ()
