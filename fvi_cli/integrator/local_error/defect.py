r"""The local error of a step from its own polynomials.

Two numbers, lengths both. The Legendre coefficients :math:`a_k` of the velocity fall quickly where
the steps are short enough, and :math:`h |a_{m-1}| \min(1, |a_{m-1} / a_{m-2}|)` is about the first
one that is left out. What the stages do not see at all shows between them: the largest difference
there, and at both ends, of the acceleration from the polynomial through the stages, times
:math:`0.1 h^2`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.local_error.forces import PointForces, SceneForces
from fvi_cli.integrator.local_error.stiff_modes import StiffModes
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis

BETWEEN_SHARE = 0.1
"""What a difference of accelerations between the stages counts, times h^2."""
ON_KINK = 1e-11
"""Of its largest size in the step; with less a kink lies at the end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepPath:
    """The polynomial of one solved step.

    Parameters
    ----------
    begin, size
        t and h.
    position
        Where it begins, shape ``(d,)``.
    unknowns
        U, shape ``(s, d)``.
    """

    begin: float
    size: float
    position: Array
    unknowns: Array

    @property
    def middle(self) -> float:
        """Time in its middle."""
        return self.begin + 0.5 * self.size


class Between:
    """Looks at a step between its stages.

    Parameters
    ----------
    forces
        The forces of the scene.
    tables
        Numbers of the method.
    stiff
        Modes that steps do not resolve; None: there are none.

    Attributes
    ----------
    places
        All points that are looked at, in [0, 1]: ends, stages and what lies between.
    """

    def __init__(
        self, forces: SceneForces, tables: StepTables, stiff: StiffModes | None = None
    ) -> None:
        self.forces, self._stiff = forces, stiff
        self._basis = lobatto_basis(tables.degree)
        stages = tables.points
        looked_at = np.concatenate([[0.0], 0.5 * (stages[:-1] + stages[1:]), [1.0]])
        self.places = np.sort(np.concatenate([stages, looked_at]))
        self._stages = np.searchsorted(self.places, stages)
        self._looked_at = np.searchsorted(self.places, looked_at)
        self._from_stages = tables.stage_basis.values(self.places[self._looked_at])
        self._through_stages = tables.stage_basis
        self._values = self._basis.values(self.places)[1:].T
        self._slopes = self._basis.derivatives(self.places)[1:].T

    def path_at(self, path: StepPath, places: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and times at places of a step."""
        values = self._basis.values(places)[1:].T
        slopes = self._basis.derivatives(places)[1:].T
        position = path.position + path.size * (values @ path.unknowns)
        return position, slopes @ path.unknowns, path.begin + path.size * places

    def look(self, path: StepPath) -> PointForces:
        """Forces at all :attr:`places` of a step."""
        position = path.position + path.size * (self._values @ path.unknowns)
        velocity = self._slopes @ path.unknowns
        times = path.begin + path.size * self.places
        with np.errstate(all="ignore"):
            return self.forces.at(position, velocity, times, path.middle)

    def defect(self, path: StepPath, found: PointForces, *, fresh: bool) -> float:
        """What is missed between the stages, a length; infinite where a force is not finite.

        Parameters
        ----------
        path, found
            The step, and the forces at its places.
        fresh
            Whether it begins where a force may be singular.
        """
        at_stages, between = found.force[self._stages], found.force[self._looked_at]
        with np.errstate(all="ignore"):
            missed = self._accelerations(path, between - self._from_stages.T @ at_stages)
            total = BETWEEN_SHARE * path.size**2 * np.abs(missed).max(axis=1)
            if found.momentum is not None:
                rates = found.momentum
                change = rates[self._looked_at] - self._from_stages.T @ rates[self._stages]
                pushed = np.abs(self._accelerations(path, change)).max(axis=1)
                total = total + BETWEEN_SHARE * path.size * pushed
        counted = np.ones(total.size, dtype=bool)
        if fresh and not math.isfinite(total[0]):
            counted[0] = False
        for place in (0, -1):
            if found.kinks.size and self._on_kink(found.kinks, place).any():
                # the force has two values there
                counted[place] = False
        largest = float(total[counted].max())
        return largest if math.isfinite(largest) else math.inf

    def interpolated(self, found: PointForces, places: Array) -> Array:
        """The polynomial through the forces at the stages, at other places, ``(n, d)``."""
        return np.asarray(self._through_stages.values(places).T @ found.force[self._stages])

    def mobility_of(self, path: StepPath) -> float:
        """Largest acceleration to forces that are 1 at most."""
        units = self.forces.units_at(path.middle) if self._stiff is not None else None
        if self._stiff is not None and units is not None:
            return float(np.abs(self._stiff.accelerations(units, path.size)).max())
        with np.errstate(all="ignore"):
            return self.forces.mobility(path.position, self._first_rate(path), path.begin)

    def _accelerations(self, path: StepPath, forces: Array) -> Array:
        if self._stiff is not None:
            return self._stiff.accelerations(forces, path.size)
        rate = self._first_rate(path)
        return self.forces.accelerations(forces, path.position, rate, path.begin)

    def _first_rate(self, path: StepPath) -> Array:
        return np.asarray(self._slopes[self._stages[0]] @ path.unknowns)

    def _on_kink(self, kinks: Array, place: int) -> NDArray[np.bool_]:
        return np.asarray(np.abs(kinks[:, place]) <= ON_KINK * np.abs(kinks).max(axis=1))
