"""Compensated running sums, so that many small increments do not drift."""

from __future__ import annotations

import numpy as np

from fvi_cli.mathematics.arrays import Array


class CompensatedSum:
    """A running sum with Kahan's compensation (Kahan 1965), component by component."""

    def __init__(self, start: Array, lost: Array | None = None) -> None:
        self.value: Array = np.array(start, dtype=float)
        self._lost: Array = np.zeros_like(self.value) if lost is None else np.array(lost)

    @property
    def lost(self) -> Array:
        """What round-off has taken too much; a sum goes on with it where another one ended."""
        return self._lost

    def add(self, increment: Array) -> None:
        """Add `increment`, shape as the start value."""
        corrected = increment - self._lost
        total = self.value + corrected
        self._lost = (total - self.value) - corrected
        self.value = total
