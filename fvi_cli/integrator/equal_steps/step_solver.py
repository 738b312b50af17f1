"""What the loop over steps asks of the equations of one step."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class StepSolver(Protocol):
    """The equations of a step."""

    @property
    def first_guess(self) -> Array:
        """Increments to begin with in the first step, shape ``(s, d)``."""

    def free_motion(self, index: int, position: Array, momentum: Array) -> Array:
        """Increments of step `index` if nothing acted on it, shape ``(s, d)``."""

    def damping_force(self, known: Array, offset: Array, increments: Array) -> Array:
        """F of a step: finished history, plus the newest weight times the newest sample."""

    def advance(
        self,
        index: int,
        position: Array,
        momentum: Array,
        known: Array,
        offset: Array,
        guess: Array,
    ) -> tuple[Array, Array, Array, tuple[float, ...]]:
        """Solve step `index`: increments, damping force, momentum increment, residuals.

        Raises
        ------
        StepFailedError
            If Newton's iteration does not converge.
        """
