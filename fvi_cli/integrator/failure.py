"""Why runs stop before their end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Reason = Literal["not finite", "no unique solution", "step failed", "irregular", "most steps"]


class StepFailedError(Exception):
    """A step whose equations could not be solved, with a reason for the program."""

    def __init__(self, message: str, reason: Reason = "step failed") -> None:
        self.reason = reason
        super().__init__(message)


@dataclass(frozen=True)
class Failure:
    """Why a run stopped: words for the reader, and fields for programs."""

    words: str  # the whole message
    reason: Reason = "step failed"  # what happened
    step: int | None = None  # number of the step in the run, from 0, and where it begins or ends
    time: float | None = None

    def __str__(self) -> str:
        """The words."""
        return self.words

    @classmethod
    def in_step(cls, step: int, time: float, error: StepFailedError) -> Failure:
        """A step that failed."""
        return cls(f"step {step}, t = {time:.6g}: {error}", error.reason, step, time)

    @classmethod
    def not_finite(cls, step: int, time: float) -> Failure:
        """A step that ends at `time` with numbers that are not finite."""
        return cls(f"not finite after step {step}, t = {time:.6g}", "not finite", step, time)


def no_unique_solution(step_size: float) -> StepFailedError:
    """The error of a step with singular equations, as with negative stiffness."""
    return StepFailedError(
        f"the equations of a step of length {step_size:.6g} have no unique solution; take "
        "another number of steps",
        reason="no unique solution",
    )
