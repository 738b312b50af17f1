"""Steps of one size for systems side by side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.batches.memory import SideTables
from fvi_cli.integrator.batches.newton import ITERATION_LIMIT, Iteration
from fvi_cli.integrator.batches.responses import StepResponse, step_response
from fvi_cli.integrator.batches.systems import Systems, filled_up
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.steps.step import ForceSampling
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.convergence import UNIT


class SideStep:
    """Steps of one size.

    Parameters
    ----------
    systems
        What moves.
    damping
        Its damping in steps of this size.
    tables, sampling, step_size
        Numbers of the method, where the damping acts, and h.
    position
        Where the systems are, ``(e, q)``: nonlinear ones begin with their linear scenes there.

    Attributes
    ----------
    singular
        Systems whose steps have no unique solution, shape ``(q,)``.
    matrix, loads
        Matrices of a step, those of :class:`StepResponse`; for linear systems the first begins with
        the past, and the position at the beginning is its last column.
    """

    def __init__(
        self,
        systems: Systems,
        damping: SideTables,
        tables: StepTables,
        sampling: ForceSampling,
        step_size: float,
        position: Array,
    ) -> None:
        self._systems, self._tables, self._sampling = systems, tables, sampling
        self.damping, self.step_size = damping, step_size
        e, q = systems.shape
        r = tables.points.size
        self._shape = (r, e, q)
        # columns before those of the past
        self._before = 0 if sampling.at_stages else r * e
        self._to_way = step_size * np.ascontiguousarray(tables.basis[1:].T)
        if systems.potential is None:
            self._curvature = np.broadcast_to(systems.stiffness, (r, e, e, q))
        else:
            here = systems.potential.hessian(position[None])
            here[:, :, :, ~np.isfinite(here).all(axis=(0, 1, 2))] = 0.0
            self._curvature = np.repeat(0.5 * (here + here.transpose(0, 2, 1, 3)), r, axis=0)
        response = self._response(np.arange(q))
        self.matrix, self.loads = response.forces, response.loads
        # another linear scene may well have a unique solution
        self.singular = response.singular if systems.potential is None else np.zeros(q, dtype=bool)
        if systems.potential is None:
            # the pull of the position is a force at every stage
            stages = self.matrix[:, : r * e].reshape(-1, r, e, q).sum(axis=1)
            pulls = (stages[:, :, None] * systems.stiffness).sum(axis=1)
            self.matrix = np.concatenate([self.matrix[:, self._before :], pulls], axis=1)
        else:
            self._by_pull = self._ways(self.matrix)

    def linear(self, force: Array, position: Array, momentum: Array, load: Array | None) -> Array:
        """U and the change of the momentum of linear systems, shape ``((s + 1) e, q)``.

        Parameters
        ----------
        force
            Of the past where it acts, shape ``(m, e, q)``.
        position, momentum
            At the beginning, shape ``(e, q)``.
        load
            Load vectors of known forces, shape ``(s + 1, e, q)``.
        """
        flat = force.reshape(-1, force.shape[-1])
        moved = _times(self.matrix, np.concatenate([flat, momentum, position]))
        if load is not None:
            moved += _times(self.loads, load.reshape(-1, load.shape[-1]))
        return moved

    def iterated(
        self,
        force: Array,
        position: Array,
        momentum: Array,
        load: Array | None,
        guess: Array,
        live: NDArray[np.bool_],
    ) -> tuple[Array, Iteration]:
        """The same for nonlinear systems, and how the iteration went.

        Parameters
        ----------
        guess
            Of the ways to the stages, shape ``(r, e, q)``.
        live
            Systems that are to be solved, shape ``(q,)``.
        """
        potential = self._systems.potential
        if potential is None:
            raise ValueError("potential: linear systems need no iteration")
        r, e, q = self._shape
        inputs = np.concatenate([force.reshape(-1, q), momentum])
        known = None if load is None else load.reshape(-1, q)
        fixed = self._fixed(inputs, known)
        begun = self._way_of(fixed)

        def floor(places: Places, pull: Array, way: Array) -> Array:
            return self._rounding(places, position, inputs, known, pull, way)

        iteration = Iteration(position, guess, live, floor)
        for _ in range(ITERATION_LIMIT):
            way = iteration.way
            pull = potential.gradient(position + way) - self._bent(way)
            added = _times(self._by_pull, pull.reshape(r * e, q)).reshape(r, e, q)
            slow = iteration.take(pull, begun + added)
            if not iteration.live.any():
                break
            if slow.any():
                places = filled_up(np.flatnonzero(slow))
                self._renew(places, position, iteration.way)
                fixed[:, places] = self._fixed(inputs, known, places)
                begun = self._way_of(fixed)
                iteration.renewed(places)
        iteration.give_up()
        moved = fixed + _times(self.matrix[:, : r * e], iteration.pull.reshape(r * e, q))
        return moved, iteration

    def _fixed(self, inputs: Array, known: Array | None, places: Places | None = None) -> Array:
        """What is moved by what is known beforehand."""
        matrix, loads = self.matrix[:, self._before :], self.loads
        if places is not None:
            matrix, loads, inputs = matrix[..., places], loads[..., places], inputs[:, places]
        moved = _times(matrix, inputs)
        if known is not None:
            moved += _times(loads, known if places is None else known[:, places])
        return moved

    def _rounding(
        self,
        places: Places,
        position: Array,
        inputs: Array,
        known: Array | None,
        pull: Array,
        way: Array,
    ) -> Array:
        """What rounded terms do to the ways of some systems, through the matrices, ``(e, n)``."""
        own = filled_up(places)
        size = np.abs(position[:, own]) + np.abs(way[..., own])
        curvature = np.abs(self._curvature[..., own])
        terms = np.abs(pull[..., own]) + (curvature * size[:, None]).sum(axis=2)
        matrix = np.abs(self.matrix[:, self._before :, own])
        moved = _times(matrix, np.abs(inputs[:, own]))
        if known is not None:
            moved += _times(np.abs(self.loads[..., own]), np.abs(known[:, own]))
        r, e, _ = self._shape
        noise = on_first_axis(np.abs(self._to_way), moved[:-e].reshape(-1, e, own.size))
        by_pull = np.abs(self._by_pull[..., own])
        noise += _times(by_pull, terms.reshape(r * e, -1)).reshape(r, e, -1)
        return np.asarray(UNIT * (noise + size).max(axis=0)[:, : places.size])

    def _renew(self, places: Places, position: Array, way: Array) -> None:
        """Take the linear scenes of some systems at the ways where they are."""
        potential = self._systems.potential
        if potential is None:
            return
        found = potential.of_some(places).hessian(position[:, places] + way[..., places])
        found[..., ~np.isfinite(found).all(axis=(0, 1, 2))] = 0.0
        self._curvature[..., places] = 0.5 * (found + found.transpose(0, 2, 1, 3))
        response = self._response(places)
        self.matrix[..., places], self.loads[..., places] = response.forces, response.loads
        self._by_pull[..., places] = self._ways(response.forces)

    def _response(self, places: Places) -> StepResponse:
        damping = tuple(
            (local[..., places], None if slot.direction is None else slot.direction[..., places])
            for local, slot in zip(self.damping.local, self._systems.slots, strict=True)
        )
        return step_response(
            self._systems.mass[..., places],
            self._curvature[..., places],
            damping,
            self._tables,
            self._sampling,
            self.step_size,
        )

    def _way_of(self, moved: Array) -> Array:
        """Ways to the stages, shape ``(r, e, q)``."""
        _, e, q = self._shape
        return on_first_axis(self._to_way, moved[:-e].reshape(-1, e, q))

    def _ways(self, matrix: Array) -> Array:
        """What forces at the stages make of the ways, shape ``(r e, r e, n)``."""
        r, e, _ = self._shape
        columns = matrix[:-e, : r * e]
        ways = self._to_way @ columns.reshape(self._tables.degree, -1)
        return np.ascontiguousarray(ways.reshape(r * e, r * e, -1))

    def _bent(self, way: Array) -> Array:
        """K at the stages times the ways."""
        if self._shape[1] == 1:
            return np.asarray(self._curvature[:, 0] * way)
        return np.asarray((self._curvature * way[:, None]).sum(axis=2))


def _times(matrices: Array, vectors: Array) -> Array:
    """Matrix ``(n, m, q)`` times vector ``(m, q)`` for every system."""
    return np.asarray((matrices * vectors).sum(axis=1))


def on_first_axis(matrix: Array, values: Array) -> Array:
    """A matrix ``(n, m)`` on the first axis of values ``(m, e, q)``."""
    m, e, q = values.shape
    return np.asarray((matrix @ values.reshape(m, e * q)).reshape(-1, e, q))
