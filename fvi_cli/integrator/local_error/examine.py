"""Examination of a solved step before it is accepted."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.defect import Between, StepPath, stiff_modes
from fvi_cli.integrator.local_error.forces import SceneForces
from fvi_cli.integrator.local_error.looks import Looks
from fvi_cli.integrator.meshes.samples import ForceSamples
from fvi_cli.integrator.tables import StepTables
from fvi_cli.mathematics.arrays import Array


class Examiner:
    """Examines the steps of one run.

    Forces that no point of a step sees may move the scene by `may_miss` until its end, a length,
    and by no more than the local tolerance.
    """

    def __init__(
        self,
        scene: Scene,
        tables: StepTables,
        *,
        may_miss: float = math.inf,
        samples: ForceSamples | None = None,
    ) -> None:
        # Legendre coefficients of the velocity from U
        self._tail = (tables.to_legendre @ tables.slopes[1:].T)[-2:]
        self._forces = SceneForces(scene)
        self._stiff = stiff_modes(scene, tables.points.size)
        self._between = Between(self._forces, tables, self._stiff)
        self._looks: Looks | None = None
        if self._forces.may_hide:
            self._looks = Looks(scene, self._between, tables, samples)
        self._may_miss = may_miss

    def spectrum(self, unknowns: Array, size: float) -> float:
        """Local error from the last Legendre coefficients of the velocity, a length."""
        rates = self._tail @ unknowns
        if self._stiff is not None:
            rates = self._stiff.resolved(rates, size)
        before, last = np.maximum.reduce(np.abs(rates), axis=1).tolist()
        if not math.isfinite(before + last):
            return math.inf
        return float(size * last * min(1.0, last / (before + 1e-300)))

    def local_error(self, path: StepPath, tolerance: float, *, fresh: bool) -> float:
        """The local error of a step, a length.

        Forces between its points are looked for only if the local tolerance is kept. A fresh step
        begins where a force may be singular.
        """
        error = self.spectrum(path.unknowns, path.size)
        if not math.isfinite(error) or self._forces.are_zero_at(path.middle):
            return error
        seen = self._between.look(path)
        error = max(error, self._between.defect(path, seen, fresh=fresh))
        if self._looks is not None and error <= tolerance:
            missed = self._looks.missed(path, seen)
            error = max(error, missed * (tolerance / min(tolerance, self._may_miss)))
        return error
