r"""The local error of a step from its own polynomials.

Two estimates, both lengths. The Legendre coefficients :math:`a_k` of the velocity fall quickly
where the steps are short enough, and :math:`h |a_{m-1}| \min(1, |a_{m-1} / a_{m-2}|)` is about the
first one that is left out. Forces that the stages miss show between them: the second estimate is
the largest difference, there and at both ends, of the acceleration from the polynomial through the
stages, times
:math:`0.1 h^2`.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.matrices import Form, Solve, solver, times
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.forces import PointForces, SceneForces
from fvi_cli.integrator.tables import StepTables
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis

KEPT = 128
"""Number of step sizes whose factors are kept."""


class StiffModes:
    r"""Removes modes that a step does not resolve from errors and forces.

    A structure of thousands of degrees of freedom has modes whose periods are far below any step.
    A Gauss method keeps these modes as they are, round-off included; steps that are short enough to
    resolve them are not needed. So the part of a motion that is missed is multiplied by
    :math:`(M + (h/m)^2 K)^{-1} M`, which leaves slow modes as they are and is small where
    :math:`h \omega` is much more than the number m of stages (as stiff equations have it:
    Shampine, Baca, *Error estimators for stiff differential equations*, 1984).
    """

    def __init__(self, mass: Form, stiffness: Form, stages: int) -> None:
        self._mass, self._stiffness, self._stages = mass, stiffness, stages
        self._kept: OrderedDict[float, Solve] = OrderedDict()

    def resolved(self, displacements: Array, step_size: float) -> Array:
        """The part of displacements or velocities ``(n, d)`` that a step of this size resolves."""
        return self.accelerations(times(displacements, self._mass), step_size)

    def accelerations(self, forces: Array, step_size: float) -> Array:
        """Accelerations by forces ``(n, d)``, the part that a step of this size resolves."""
        found = self._kept.get(step_size)
        if found is None:
            softened = (step_size / self._stages) ** 2 * self._stiffness
            found = self._kept[step_size] = solver(self._mass + softened)
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return np.asarray(found(forces.T).T)


def stiff_modes(scene: Scene, stages: int) -> StiffModes | None:
    """Stiff modes of a scene with sparse matrices; None for others: steps resolve them or fail."""
    if not (scene.is_sparse and isinstance(scene.potential, QuadraticPotential)):
        return None
    return StiffModes(scene.inertia.form, scene.potential.form, stages)


BETWEEN_SHARE = 0.1
"""Factor of h^2 times a difference of accelerations between the stages."""


class StepPath(NamedTuple):
    """The polynomial of one solved step."""

    begin: float  # t and h
    size: float
    position: Array  # where it begins, shape (d,)
    unknowns: Array  # U, shape (s, d)

    @property
    def middle(self) -> float:
        """Time in its middle."""
        return self.begin + 0.5 * self.size


@lru_cache(maxsize=32)
def _look_tables(tables: StepTables) -> tuple[Array, Array, Array, Array]:
    """Places in turn between stages (or at ends) and at stages; and maps to values there.

    The maps are from U to increments over h and to velocities at all places, and from values at the
    stages to values between them.
    """
    basis, stages = lobatto_basis(tables.degree), tables.points
    between = np.concatenate([[0.0], 0.5 * (stages[:-1] + stages[1:]), [1.0]])
    places = np.empty(2 * stages.size + 1)
    places[::2], places[1::2] = between, stages
    values, slopes = (one[1:].T for one in (basis.values(places), basis.derivatives(places)))
    from_stages = np.ascontiguousarray(tables.stage_basis.values(between).T)
    return places, np.ascontiguousarray(values), np.ascontiguousarray(slopes), from_stages


class Between:
    """Evaluates a step between its stages; the caller handles floating-point errors.

    `places` in [0, 1], ``(2 m + 1,)``: ends, stages and the middles between them, in order.
    `stiff` are the modes that steps do not resolve; None: there are none.
    """

    def __init__(
        self, forces: SceneForces, tables: StepTables, stiff: StiffModes | None = None
    ) -> None:
        self.forces, self._stiff, self._stage_basis = forces, stiff, tables.stage_basis
        self.places, self._values, self._slopes, self._from_stages = _look_tables(tables)

    def path_at(self, path: StepPath, places: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and times at places of a step."""
        basis = lobatto_basis(path.unknowns.shape[0])
        values, slopes = basis.values(places)[1:].T, basis.derivatives(places)[1:].T
        position = path.position + path.size * (values @ path.unknowns)
        return position, slopes @ path.unknowns, path.begin + path.size * places

    def look(self, path: StepPath) -> PointForces:
        """Forces at all :attr:`places` of a step."""
        position = path.position + path.size * (self._values @ path.unknowns)
        velocity = self._slopes @ path.unknowns if self.forces.needs_velocity else position
        times = path.begin + path.size * self.places
        return self.forces.at(position, velocity, times, path.middle)

    def defect(self, path: StepPath, found: PointForces, *, fresh: bool) -> float:
        """The error by forces missed between stages, a length; infinite if a force is not finite.

        A fresh step begins where a force may be singular.
        """
        size = path.size
        total = self._sizes(path, found.force, BETWEEN_SHARE * size * size)
        if found.momentum is not None:
            total = total + self._sizes(path, found.momentum, BETWEEN_SHARE * size)
        if fresh and not math.isfinite(total[0]):
            total[0] = 0.0
        largest = float(total.max())
        return largest if math.isfinite(largest) else math.inf

    def _sizes(self, path: StepPath, values: Array, factor: float) -> Array:
        """Errors, as lengths, by forces or momenta ``(n, d)`` missed between the stages."""
        missed = values[::2] - self._from_stages @ values[1::2]
        moved = np.abs(self._accelerations(path, missed))
        return np.asarray(factor * (moved[:, 0] if moved.shape[1] == 1 else moved.max(axis=1)))

    def forces_off(self, path: StepPath, found: PointForces, places: Array) -> Array:
        """What the polynomial through the forces at the stages misses at other places, ``(n,)``."""
        force = self.forces.at(*self.path_at(path, places), path.middle).force
        told = self._stage_basis.values(places).T @ found.force[1::2]
        return np.asarray(np.abs(force - told).max(axis=1))

    def mobility_of(self, path: StepPath) -> float:
        """Largest acceleration by forces that are 1 at most."""
        units = self.forces.units_at(path.middle) if self._stiff is not None else None
        if self._stiff is not None and units is not None:
            return float(np.abs(self._stiff.accelerations(units, path.size)).max())
        with np.errstate(all="ignore"):
            return self.forces.mobility(path.position, self._first_rate(path), path.begin)

    def _accelerations(self, path: StepPath, forces: Array) -> Array:
        if self._stiff is not None:
            return self._stiff.accelerations(forces, path.size)
        rate = self._first_rate(path) if self.forces.needs_velocity else path.position
        return self.forces.accelerations(forces, path.position, rate, path.begin)

    def _first_rate(self, path: StepPath) -> Array:
        return np.asarray(self._slopes[1] @ path.unknowns)
