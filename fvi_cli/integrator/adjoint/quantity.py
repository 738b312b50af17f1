"""Numbers that are made of a trajectory: of positions and velocities at any times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.integrator.adjoint.linearised import Tangent
from fvi_cli.integrator.run.steps_of_run import RunSteps
from fvi_cli.mathematics.lagrange import lobatto_basis

Array = NDArray[np.float64]
COMPLEX_STEP = 1e-30


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    """A number made of the positions and velocities at some times.

    Parameters
    ----------
    times
        Shape ``(n,)``, in any order; what lies in a step is taken from its polynomial.
    value
        From positions and velocities there, both ``(n, d)``, to the number.
    slopes
        From the same to its derivatives by both, each ``(n, d)``; None: by complex steps, for which
        `value` must take complex arrays and be analytic (no abs, no max).

    Raises
    ------
    ValueError
        For times that are not finite numbers in one row.
    """

    times: Array
    value: Callable[[Array, Array], float]
    slopes: Callable[[Array, Array], tuple[Array, Array]] | None = None

    def __post_init__(self) -> None:
        times = np.atleast_1d(np.array(self.times, dtype=float))
        if times.ndim != 1 or not times.size or not np.isfinite(times).all():
            raise ValueError("times: finite numbers are needed, at least one")
        object.__setattr__(self, "times", times)

    def derivatives(self, position: Array, velocity: Array) -> tuple[Array, Array]:
        """By positions and velocities, each ``(n, d)``.

        Raises
        ------
        ValueError
            If they cannot be had by complex steps.
        """
        if self.slopes is not None:
            by_position, by_velocity = self.slopes(position, velocity)
            return np.asarray(by_position, dtype=float), np.asarray(by_velocity, dtype=float)
        given = np.stack([position, velocity]).astype(complex)
        found = np.zeros(given.shape)
        for index in np.ndindex(*given.shape):
            beside = given.copy()
            beside[index] += 1j * COMPLEX_STEP
            value = complex(self.value(beside[0], beside[1]))
            found[index] = value.imag / COMPLEX_STEP
        if not np.isfinite(found).all():
            raise ValueError("quantity: its derivatives by complex steps are not finite")
        return found[0], found[1]


def position_at(time: float, component: int = 0) -> Quantity:
    """One coordinate at one time."""
    return _one(time, component, of_velocity=False)


def velocity_at(time: float, component: int = 0) -> Quantity:
    """One velocity at one time."""
    return _one(time, component, of_velocity=True)


def _one(time: float, component: int, *, of_velocity: bool) -> Quantity:
    def value(position: Array, velocity: Array) -> float:
        return float((velocity if of_velocity else position)[0, component])

    def slopes(position: Array, velocity: Array) -> tuple[Array, Array]:
        found = np.zeros((2, *position.shape))
        found[int(of_velocity), 0, component] = 1.0
        return found[0], found[1]

    return Quantity(times=np.array([time]), value=value, slopes=slopes)


def misfit(
    times: ArrayLike, data: ArrayLike, *, component: int = 0, deviation: float = 1.0
) -> Quantity:
    r"""Half the sum of squares of :math:`(x(t_k) - d_k) / \sigma` of one coordinate.

    Parameters
    ----------
    times, data
        :math:`t_k` and :math:`d_k`, shape ``(n,)``.
    component
        Number of the coordinate, from 0.
    deviation
        :math:`\sigma`, in the unit of the data.
    """
    measured = np.asarray(data, dtype=float)

    def value(position: Array, velocity: Array) -> float:
        left = (position[:, component] - measured) / deviation
        return float(0.5 * left @ left)

    def slopes(position: Array, velocity: Array) -> tuple[Array, Array]:
        found = np.zeros(position.shape)
        found[:, component] = (position[:, component] - measured) / deviation**2
        return found, np.zeros(position.shape)

    return Quantity(times=np.asarray(times, dtype=float), value=value, slopes=slopes)


class Observation:
    """Positions and velocities of a run at some times, as linear functions of its steps.

    Parameters
    ----------
    steps
        The steps.
    times
        Shape ``(n,)``.

    Raises
    ------
    ValueError
        For times outside of the run.
    """

    def __init__(self, steps: RunSteps, times: Array) -> None:
        self._steps = steps
        self._which, tau = steps.located(times)
        basis = lobatto_basis(steps.tables.degree)
        self._way = steps.step_size[self._which, None] * basis.values(tau)[1:].T
        self._slopes = np.ascontiguousarray(basis.derivatives(tau)[1:].T)

    def motion(self) -> tuple[Array, Array]:
        """Positions and velocities, each ``(n, d)``."""
        unknowns = self._steps.unknowns[self._which]
        position = self._steps.position[self._which]
        position = position + np.einsum("ks,ksd->kd", self._way, unknowns)
        return position, np.einsum("ks,ksd->kd", self._slopes, unknowns)

    def changes(self, tangent: Tangent) -> tuple[Array, Array]:
        """Their changes by disturbances, each ``(n, d, p)``."""
        unknowns = tangent.unknowns[self._which]
        position = tangent.position[self._which]
        position = position + np.einsum("ks,ksdp->kdp", self._way, unknowns)
        return position, np.einsum("ks,ksdp->kdp", self._slopes, unknowns)

    def spread(self, by_position: Array, by_velocity: Array) -> tuple[Array, Array]:
        """Derivatives by positions at mesh points and by unknowns from those by the motion."""
        steps, d = self._steps, by_position.shape[1]
        positions = np.zeros((steps.n_steps + 1, d))
        unknowns = np.zeros((steps.n_steps, steps.tables.degree, d))
        np.add.at(positions, self._which, by_position)
        own = np.einsum("ks,kd->ksd", self._way, by_position)
        own += np.einsum("ks,kd->ksd", self._slopes, by_velocity)
        np.add.at(unknowns, self._which, own)
        return positions, unknowns
