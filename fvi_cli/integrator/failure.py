"""Why runs stop before their end."""

from __future__ import annotations


class StepFailedError(Exception):
    """A step whose equations could not be solved.

    Parameters
    ----------
    message
        What is wrong, and what to do.
    residuals
        Sizes of the residuals of Newton's iteration, first to last.
    """

    def __init__(self, message: str, residuals: tuple[float, ...] = ()) -> None:
        self.residuals = residuals
        super().__init__(message)
