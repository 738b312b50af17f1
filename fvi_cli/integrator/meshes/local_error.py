r"""The local error of a step from its own polynomials.

Two estimates, both lengths. The Legendre coefficients :math:`a_k` of the velocity fall quickly
where the steps are short enough, and :math:`h |a_{m-1}| \min(1, |a_{m-1} / a_{m-2}|)` is about the
first one that is left out. Forces that the stages miss show between them: the second estimate is
the largest difference, at the 2 m + 1 points that are stages, middles between them and ends, of the
acceleration from the polynomial through the stages, times :math:`0.1 h^2`.

A structure of thousands of degrees of freedom has modes whose periods are far below any step. A
Gauss method keeps these modes as they are, round-off included; steps that are short enough to
resolve them are not needed. So the part of a motion that is missed is multiplied by
:math:`(M + (h/m)^2 K)^{-1} M`, which leaves slow modes as they are and is small where
:math:`h \omega` is much more than the number m of stages (as stiff equations have it: Shampine,
Baca, *Error estimators for stiff differential equations*, 1984).
"""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.forces import Places, StepForces, StepPath
from fvi_cli.integrator.meshes.looks import Looks, formulas_of, may_hide
from fvi_cli.integrator.tables import StepTables
from fvi_cli.mathematics.arrays import Array

BETWEEN_SHARE = 0.1
"""Factor of h^2 times a difference of accelerations between the stages."""


class LocalError:
    """Local errors of the steps of one run.

    Forces that no point of a step sees may move the scene by `may_miss` until its end, a length,
    and by no more than the local tolerance.
    """

    def __init__(self, scene: Scene, tables: StepTables, may_miss: float = math.inf) -> None:
        stages = tables.points
        between = np.concatenate([[0.0], 0.5 * (stages[:-1] + stages[1:]), [1.0]])
        places = np.empty(2 * stages.size + 1)
        places[::2], places[1::2] = between, stages
        self._places = Places.of(tables.degree, places)
        self._from_stages = tables.stage_basis.values(between).T
        # the last two Legendre coefficients of the velocity from U
        self._tail = (tables.to_legendre @ tables.slopes[1:].T)[-2:]
        self._forces = StepForces(scene, stages.size)
        hides = any(map(may_hide, formulas_of(scene)))
        self._looks = Looks(scene, self._forces, tables) if hides else None
        self._may_miss, self._end = may_miss, scene.final_time
        # the stiffness of a linear scene hides nothing
        self._has_forces = scene.forcing is not None or not scene.is_linear

    def of(self, path: StepPath, tolerance: float, *, is_fresh: bool) -> float:
        """The local error of a step, a length; infinite where a number is not finite.

        Forces between its points are looked for only if the local tolerance is kept. A fresh step
        begins where a force may be singular.
        """
        with np.errstate(all="ignore"):
            error = self._missed_by_polynomial(path)
            if self._has_forces and math.isfinite(error):
                momentum, force = self._forces.at(path, self._places)
                moved = path.size * self._moved_by_missed(path, force)
                if momentum is not None:
                    moved += self._moved_by_missed(path, momentum)
                if is_fresh and not math.isfinite(moved[0]):
                    moved[0] = 0.0
                error = max(error, BETWEEN_SHARE * path.size * float(moved.max()))
                if self._looks is not None and error <= tolerance:
                    impulse = self._looks.missed(path, force[1::2])
                    velocity = np.abs(self._forces.accelerations(path, impulse[None])).max()
                    missed = float(velocity) * (self._end - path.begin)
                    error = max(error, missed * (tolerance / min(tolerance, self._may_miss)))
        return error if math.isfinite(error) else math.inf

    def _missed_by_polynomial(self, path: StepPath) -> float:
        """The first Legendre coefficient of the velocity that is left out, as a length."""
        rates = self._forces.resolved(path, self._tail @ path.unknowns)
        before, last = np.abs(rates).max(axis=1).tolist()
        return float(path.size * last * min(1.0, last / (before + 1e-300)))

    def _moved_by_missed(self, path: StepPath, values: Array) -> Array:
        """Accelerations by what the polynomial through the stages misses between them."""
        missed = values[::2] - self._from_stages @ values[1::2]
        return np.asarray(np.abs(self._forces.accelerations(path, missed)).max(axis=1))
