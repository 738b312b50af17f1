r"""Modes of a large structure that steps of some length do not resolve.

A structure of thousands of degrees of freedom has modes whose periods are far below any step. A
Gauss method carries them along as they are, round-off among them, and short steps would be the
answer to a question that nobody asked. So what is missed of a motion is looked at through
:math:`(M + (h/m)^2 K)^{-1} M`, which leaves slow modes as they are and is small where
:math:`h \omega` is much more than the number m of stages (as stiff equations have it: Shampine,
Baca, *Error estimators for stiff differential equations*, 1984).
"""

from __future__ import annotations

from collections import OrderedDict

import numpy as np

from fvi_cli.effects.matrices import Form, Solve, added, scaled, solver, times
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array

KEPT = 128
"""Step sizes whose factors are kept."""


class StiffModes:
    """What is left of errors and forces where a step resolves them."""

    def __init__(self, mass: Form, stiffness: Form, stages: int) -> None:
        self._mass, self._stiffness, self._stages = mass, stiffness, stages
        self._kept: OrderedDict[float, Solve] = OrderedDict()

    def resolved(self, displacements: Array, step_size: float) -> Array:
        """Ways or velocities ``(n, d)`` as far as a step of this size resolves them."""
        return self.accelerations(times(displacements, self._mass), step_size)

    def accelerations(self, forces: Array, step_size: float) -> Array:
        """Accelerations to forces ``(n, d)``, as far as a step of this size resolves them."""
        found = self._kept.get(step_size)
        if found is None:
            softened = scaled(self._stiffness, (step_size / self._stages) ** 2)
            found = self._kept[step_size] = solver(added(self._mass, softened))
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return np.asarray(found(forces.T).T)


def stiff_modes(scene: Scene, stages: int) -> StiffModes | None:
    """Those of a scene with sparse matrices; None: small ones are resolved, or fail."""
    if not (scene.is_sparse and isinstance(scene.potential, QuadraticPotential)):
        return None
    return StiffModes(scene.inertia.form, scene.potential.form, stages)
