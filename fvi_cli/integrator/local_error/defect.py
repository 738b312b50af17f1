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
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.local_error.forces import PointForces, SceneForces
from fvi_cli.integrator.local_error.stiff_modes import StiffModes
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import LagrangeBasis, lobatto_basis

BETWEEN_SHARE = 0.1
"""What a difference of accelerations between the stages counts, times h^2."""
ON_KINK = 1e-11
"""Of its largest size in the step; with less a kink lies at the end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepPath:
    """The polynomial of one solved step."""

    begin: float  # t and h
    size: float
    position: Array  # where it begins, shape (d,)
    unknowns: Array  # U, shape (s, d)

    @property
    def middle(self) -> float:
        """Time in its middle."""
        return self.begin + 0.5 * self.size


@dataclass(frozen=True, kw_only=True, eq=False)
class _LookTables:
    """Places by turns between and at the stages, ends among the former; all of a method."""

    places: Array
    values: Array
    slopes: Array
    from_stages: Array
    stage_basis: LagrangeBasis


@lru_cache(maxsize=32)
def _look_tables(tables: StepTables) -> _LookTables:
    basis, stages = lobatto_basis(tables.degree), tables.points
    between = np.concatenate([[0.0], 0.5 * (stages[:-1] + stages[1:]), [1.0]])
    places = np.empty(2 * stages.size + 1)
    places[::2], places[1::2] = between, stages
    return _LookTables(
        places=places,
        values=np.ascontiguousarray(basis.values(places)[1:].T),
        slopes=np.ascontiguousarray(basis.derivatives(places)[1:].T),
        from_stages=np.ascontiguousarray(tables.stage_basis.values(between).T),
        stage_basis=tables.stage_basis,
    )


class Between:
    """Looks at a step between its stages; floating-point errors are the caller's.

    `stiff` are the modes that steps do not resolve; None: there are none.

    Attributes
    ----------
    places
        All points that are looked at, in [0, 1]: ends, stages and the middles between them, by
        turns ``(2 m + 1,)``.
    """

    def __init__(
        self, forces: SceneForces, tables: StepTables, stiff: StiffModes | None = None
    ) -> None:
        self.forces, self._stiff = forces, stiff
        self._tables = _look_tables(tables)
        self.places = self._tables.places

    def path_at(self, path: StepPath, places: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and times at places of a step."""
        basis = lobatto_basis(path.unknowns.shape[0])
        values, slopes = basis.values(places)[1:].T, basis.derivatives(places)[1:].T
        position = path.position + path.size * (values @ path.unknowns)
        return position, slopes @ path.unknowns, path.begin + path.size * places

    def look(self, path: StepPath) -> PointForces:
        """Forces at all :attr:`places` of a step."""
        tables, forces = self._tables, self.forces
        position = path.position + path.size * (tables.values @ path.unknowns)
        velocity = tables.slopes @ path.unknowns if forces.needs_velocity else position
        times = path.begin + path.size * tables.places
        return forces.at(position, velocity, times, path.middle)

    def defect(self, path: StepPath, found: PointForces, *, fresh: bool) -> float:
        """What is missed between the stages, a length; infinite where a force is not finite.

        A fresh step begins where a force may be singular.
        """
        size = path.size
        total = self._sizes(path, found.force, BETWEEN_SHARE * size * size)
        if found.momentum is not None:
            total = total + self._sizes(path, found.momentum, BETWEEN_SHARE * size)
        if fresh and not math.isfinite(total[0]):
            total[0] = 0.0
        for place in (0, -1):
            if found.kinks.size and self._on_kink(found.kinks, place).any():
                # the force has two values there
                total[place] = 0.0
        largest = float(total.max())
        return largest if math.isfinite(largest) else math.inf

    def _sizes(self, path: StepPath, values: Array, factor: float) -> Array:
        """What is missed of forces or momenta between the stages, ``(n, d)`` to lengths."""
        missed = values[::2] - self._tables.from_stages @ values[1::2]
        moved = np.abs(self._accelerations(path, missed))
        return np.asarray(factor * (moved[:, 0] if moved.shape[1] == 1 else moved.max(axis=1)))

    def interpolated(self, found: PointForces, places: Array) -> Array:
        """The polynomial through the forces at the stages, at other places, ``(n, d)``."""
        return np.asarray(self._tables.stage_basis.values(places).T @ found.force[1::2])

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
        rate = self._first_rate(path) if self.forces.needs_velocity else path.position
        return self.forces.accelerations(forces, path.position, rate, path.begin)

    def _first_rate(self, path: StepPath) -> Array:
        return np.asarray(self._tables.slopes[1] @ path.unknowns)

    def _on_kink(self, kinks: Array, place: int) -> NDArray[np.bool_]:
        return np.asarray(np.abs(kinks[:, place]) <= ON_KINK * np.abs(kinks).max(axis=1))
