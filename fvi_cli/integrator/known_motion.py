"""The known part of a motion, as Lagrangians need it that hold products of q and v."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownMotion:
    """The known part S on the quadrature points of every step, arrays of shape ``(N, r, d)``.

    Parameters
    ----------
    position, velocity
        S and S'.
    momentum, force
        dL/dv and dL/dq at (S, S', t).
    """

    position: Array
    velocity: Array
    momentum: Array
    force: Array

    def steps(self, first: int, last: int) -> KnownMotion:
        """The same for the steps `first` <= k < `last`."""
        return KnownMotion(
            position=self.position[first:last],
            velocity=self.velocity[first:last],
            momentum=self.momentum[first:last],
            force=self.force[first:last],
        )

    def place(self, step: int, point: int) -> tuple[Array, Array]:
        """Position and momentum at one point, shape ``(d,)`` each."""
        return self.position[step, point], self.momentum[step, point]
