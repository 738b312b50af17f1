r"""The discrete equations of a run, linearised along it: what disturbances do to the trajectory.

A step maps position x and momentum p at its beginning, the forces F of the past at its stages (term
by term, without their matrices) and load vectors g to x and p after it and to the velocities V at
its stages,

.. math:: (x', p', V) = T\,(x, p, F) + G g, \qquad z' = A z + Q V, \qquad F = R z,

where z are the states of the memory. T and G are the solved equations of
:mod:`fvi_cli.integrator.engine.step`, with the second derivatives of L at the stages.

Shapes: n steps, p disturbances, d components; m stages of a step, f damping terms, J states.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.law import Linearisation
from fvi_cli.integrator.engine.step import dense_step, unit_tables
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.kernel import LARGEST_EXPONENT, Term
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array

AT_ONCE = 2**21
"""Most entries of the matrices of steps that are computed together: some 16 MB."""


class Disturbance(NamedTuple):
    """Effect of p changes of a scene on the equations of a run of n steps, at fixed motion."""

    loads: Array  # load vectors, (p, n, s + 1, d)
    position: Array  # at the start, (p, d)
    momentum: Array


class Tangent(NamedTuple):
    """Effect of p disturbances on a trajectory."""

    position: Array  # at the points of the mesh, (p, n + 1, d)
    velocity: Array  # at the stages, (p, n, m, d)
    forces: Array  # there, of all terms without their matrices, (f, p, n, m, d)


class Maps(NamedTuple):
    """Maps of n steps; those of the memory are for u different lengths."""

    by_state: list[Array]  # T of every step, ((2 + m) d, (2 + f m) d)
    by_load: Array  # G, (1 or n, (2 + m) d, (s + 1) d)
    which: list[int]  # index of the length of every step, (n,)
    local: Array  # from velocities of a step to its forces, (f, n, m, m)
    response: Array  # from states at its beginning to its forces, (u, f m, J)
    intake: Array  # from velocities of a step to states after it, (u, J, m)
    decay: Array  # factors of the states over a step, (u, J, 1)


class LinearisedRun:
    """A run of a Runge-Kutta method, ready for tangents."""

    def __init__(self, scene: Scene, method: Method, steps: RunSteps) -> None:
        self.scene, self.method, self.steps = scene, method, steps
        self.tables, self.d = steps.tables, scene.dimension
        # those of a scene without damping do nothing
        self.coefficients = np.array(_matrices(scene) or [np.zeros((self.d, self.d))])
        terms = _terms(scene) or [0.0]
        self._memory = self._memory_of(terms)
        self._rows = [self._memory.terms.index(one) for one in terms]

    def _memory_of(self, terms: Sequence[Term]) -> Exponentials:
        sizes = self.steps.step_size
        shortest = float(sizes.min())
        return Exponentials(
            self.method,
            tuple(dict.fromkeys(terms)),
            shortest_step=shortest,
            final_time=self.scene.final_time,
            steps=float((shortest / sizes).sum()),
        )

    def forces_of(self, scenes: Sequence[Scene], velocity: Array) -> list[Array]:
        """Forces of the damping of scenes on one motion, at the stages of its steps.

        All from shapes ``(n, m, e)`` to the same: one march of the memory serves all scenes.
        """
        terms = [term for one in scenes for term in _terms(one)]
        if not terms:
            return [np.zeros_like(velocity) for _ in scenes]
        memory = self._memory_of(terms)
        lengths, which = np.unique(self.steps.step_size, return_inverse=True)
        local, response, intake, change = memory.of_steps(lengths)
        # beside the motion one with the velocity 1, which terms above order 1 subtract
        (n, m, e), k, moved = velocity.shape, len(memory.terms), velocity.swapaxes(1, 2)
        if any(map(_is_relative, memory.terms)):
            moved = np.concatenate([moved, np.ones((n, 1, m))], axis=1)
        shape = moved.shape[:2]
        taken, plain = np.empty((*shape, memory.n_states)), np.empty((*shape, k, m))
        steps = [which == place for place in range(lengths.size)]
        for own, each in zip(steps, intake, strict=True):
            taken[own] = np.tensordot(moved[own], each, axes=(2, 1))
        path = _states(1.0 + change[which], taken)
        for own, each, by_state in zip(steps, local, response, strict=True):
            table = memory.weights[:, None] * by_state
            plain[own] = np.tensordot(path[own], table, axes=(2, 2))
            plain[own] += np.tensordot(moved[own], each, axes=(2, 2))
        found = []
        for one in scenes:
            total = np.zeros_like(velocity)
            for term, matrix in zip(_terms(one), _matrices(one), strict=True):
                force = plain[:, :, memory.terms.index(term)].swapaxes(1, 2)
                if _is_relative(term):
                    force = force[..., :e] - force[..., e:] * one.initial_velocity
                total += force[..., :e] @ matrix
            found.append(total)
        return found

    def loads_by(self, momentum: Array, force: Array) -> Array:
        r"""Load vectors ``(n, s + 1, d)`` of changes of P and of Q - F at the stages.

        They are :math:`g_\nu = \sum_i b_i (l_\nu' \partial P_i + h l_\nu \partial (Q - F)_i)`.
        """
        t, h = self.tables, self.steps.step_size[:, None, None]
        return np.asarray(
            np.matmul(t.weights * t.slopes, momentum) + h * np.matmul(t.test_weights, force)
        )

    def tangent(self, change: Disturbance) -> Tangent:
        """Effect of disturbances on the trajectory."""
        d, (n, m, _), f = self.d, self.steps.velocity.shape, len(self.coefficients)
        p = len(change.position)
        positions, velocities = np.empty((p, n + 1, d)), np.empty((p, n, m, d))
        forces = np.empty((f, p, n, m, d))
        positions[:, 0] = change.position
        end = np.concatenate([change.position.T, change.momentum.T])
        states = np.zeros((self._memory.n_states, d * p))
        for own in self._parts():
            maps, loads = self._maps(own), change.loads[:, own]
            found = np.matmul(maps.by_load, loads.reshape(*loads.shape[:2], -1).transpose(1, 2, 0))
            given = np.empty((len(found), (2 + f * m) * d, p))
            # np.dot is the quickest product of small matrices
            for index, which in enumerate(maps.which):
                begin, after = given[index], found[index]
                begin[: 2 * d] = end
                begin[2 * d :] = np.dot(maps.response[which], states).reshape(-1, p)
                after += np.dot(maps.by_state[index], begin)
                end = after[: 2 * d]
                states = maps.decay[which] * states
                states += np.dot(maps.intake[which], after[2 * d :].reshape(-1, d * p))
            positions[:, own.start + 1 : own.stop + 1] = found[:, :d].transpose(2, 0, 1)
            velocity = found[:, 2 * d :].reshape(-1, m, d, p).transpose(3, 0, 1, 2)
            past = given[:, 2 * d :].reshape(-1, f, m, d, p).transpose(1, 4, 0, 2, 3)
            velocities[:, own] = velocity
            forces[:, :, own] = past + np.matmul(maps.local[:, None], velocity)
        return Tangent(positions, velocities, forces)

    def _parts(self) -> Iterator[slice]:
        """Ranges of steps whose maps are computed together."""
        sizes = self.steps.step_size
        n = sizes.size
        distinct = np.unique(sizes).size if self.scene.is_linear else n
        together = max(1, n * AT_ONCE // (distinct * (self.tables.degree * self.d) ** 2))
        return (slice(first, min(first + together, n)) for first in range(0, n, together))

    def _maps(self, own: slice) -> Maps:
        steps = self.steps
        lengths, which = np.unique(steps.step_size[own], return_inverse=True)
        by_term, response, intake, change = self._memory.of_steps(lengths)
        local = by_term[:, self._rows].swapaxes(0, 1)
        weighted = self._memory.weights[self._rows][:, None] * response[:, None]
        # a linear scene has one map for each length
        every, at = np.arange(which.size), which
        if self.scene.is_linear:
            every, at = which, np.arange(lengths.size)
        motion = (steps.stage_position, steps.velocity, steps.stage_time)
        points = [one[own][: at.size] for one in motion]
        by_state, by_load = self._of_steps(lengths[at], local[:, at], points)
        return Maps(
            by_state=[by_state[k] for k in every.tolist()],
            by_load=by_load[every] if len(by_load) > 1 else by_load,
            which=which.tolist(),
            local=local[:, which],
            response=np.concatenate(list(weighted.swapaxes(0, 1)), axis=1),
            intake=intake,
            decay=1.0 + change[..., None],
        )

    def _of_steps(self, sizes: Array, local: Array, points: list[Array]) -> tuple[Array, Array]:
        """T and G of n steps: the solved equations of the engine under unit cases."""
        t, d, (n, m) = self.tables, self.d, points[2].shape
        at, h = self.scene.derivatives(*points), sizes[:, None, None]
        to_loads = -h * t.to_loads
        step = dense_step(
            unit_tables(self.method, d, has_rates=True),
            Linearisation(at.mass, at.mixed, -at.stiffness),
            h,
            [to_loads @ (one @ t.to_inputs) for one in local],
            list(self.coefficients[:, None]),
        )
        # cases: x, p, forces of the past at the stages, load vectors
        first, last = 2 * d, (2 + len(local) * m) * d
        count = last + (t.degree + 1) * d
        x, p = np.zeros((2, n, count, d))
        x[:, :d], p[:, d:first] = np.eye(d), np.eye(d)
        loads = np.zeros((n, count, t.degree + 1, d))
        past = np.einsum("nai,fde->nfiead", to_loads, self.coefficients)
        loads[:, first:last] = past.reshape(n, last - first, -1, d)
        loads[:, last:] = np.eye((t.degree + 1) * d).reshape(-1, t.degree + 1, d)
        unknowns, dx, dp = step.solve(x, p, loads)
        velocity = np.matmul(t.to_inputs, unknowns)
        after = np.concatenate([x + dx, p + dp, velocity.reshape(n, count, -1)], axis=2)
        return after[:, :last].swapaxes(1, 2), after[:, last:].swapaxes(1, 2)


def _states(decay: Array, taken: Array) -> Array:
    """States where n steps begin, ``(n, e, J)``, by their decay ``(n, J)`` and what they take.

    In some sqrt(n) blocks of as many steps: first in all blocks at once, then from block to block.
    """
    n, size = len(taken), math.isqrt(len(taken)) + 1
    count = math.ceil(n / size)
    decay, taken = (
        np.concatenate([one, np.zeros((count * size - n, *one.shape[1:]))]).reshape(
            count, size, *one.shape[1:]
        )
        for one in (decay[:, None], taken)
    )
    inside, left = np.zeros_like(taken), np.ones_like(decay)
    for k in range(size - 1):
        inside[:, k + 1] = decay[:, k] * inside[:, k] + taken[:, k]
        left[:, k + 1] = decay[:, k] * left[:, k]
    begin = np.zeros(taken.shape[2:])
    for block in range(count):
        inside[block] += left[block] * begin
        begin = decay[block, -1] * inside[block, -1] + taken[block, -1]
    return inside.reshape(count * size, *inside.shape[2:])[:n]


def _is_relative(term: Term) -> bool:
    """Whether a term is a damper above order 1, which acts on the change of the velocity."""
    return isinstance(term, float) and term < 0.0


def _terms(scene: Scene) -> list[Term]:
    """Exponents of damping terms, then kernels of laws."""
    exponents = [min(1.0 - one.order, LARGEST_EXPONENT) for one in scene.damping]
    return [*exponents, *(one.kernel for one in scene.laws)]


def _matrices(scene: Scene) -> list[Array]:
    """Matrices of damping terms, then of laws, these times their sizes."""
    found = [one.matrix for one in scene.damping]
    return [*found, *(one.size * one.matrix for one in scene.laws)]
