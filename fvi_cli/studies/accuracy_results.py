"""What a search for a tolerance gives back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.trajectory import Trajectory

Verdict = Literal["ok", "refused"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reached:
    """What a search for a tolerance came to.

    Parameters
    ----------
    method, n_steps
        What was chosen; of a refusal what was tried last.
    trajectory
        Its run; None where nothing was run.
    estimate
        Estimated error, of a refusal the least one; nan where there is none.
    verdict
        ``ok``, or ``refused`` where the tolerance cannot be reached.
    message
        The choice, or the reason for the refusal, in one line.
    attempts
        One line for every run.
    """

    method: AnyMethod
    n_steps: int
    trajectory: Trajectory | None
    estimate: float
    verdict: Verdict
    message: str
    attempts: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """What a method is thought to take before anything is run.

    Parameters
    ----------
    method, n_steps
        The method, and the steps on which it is thought to reach the tolerance.
    seconds
        For this number of steps and half as many.
    """

    method: AnyMethod
    n_steps: int
    seconds: float
