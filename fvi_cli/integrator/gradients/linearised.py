r"""The discrete equations of a run, linearised along it: what disturbances do to the trajectory.

A step maps position x and momentum p at its beginning and load vectors g to x and p after it and to
the velocities V at its stages. The forces of the past are load vectors too, one for each term of
the damping with its matrix C,

.. math:: (x', p', V) = S\,(x, p, g + \sum C R z), \qquad z' = A z + Q V,

where z are the states of the memory. S are the solved equations of
:mod:`fvi_cli.integrator.engine.step`, with the second derivatives of L at the stages.

Shapes: n steps, p disturbances, d components; m stages of a step, f damping terms, J states.
"""

from __future__ import annotations

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

    position: Array  # at the points of the mesh, (n + 1, d, p)
    velocity: Array  # at the stages, (n, m, d, p)


class Maps(NamedTuple):
    """Maps of n steps; those of the memory are for u different lengths."""

    solved: list[Array]  # S of every step, ((2 + m) d, (3 + s) d)
    which: list[int]  # index of the length of every step, (n,)
    past: Array  # R, from states at the beginning of a step to load vectors, (u, f (s + 1), J)
    intake: Array  # Q, from velocities of a step to states after it, (u, J, m)
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
        """Forces of the damping of scenes on one motion, or several, at the stages of its steps.

        All from shapes ``(n, m, ..., e)`` to the same: one march of the memory serves all.
        """
        terms = [term for one in scenes for term in _terms(one)]
        if not terms:
            return [np.zeros_like(velocity) for _ in scenes]
        memory = self._memory_of(terms)
        lengths, which = np.unique(self.steps.step_size, return_inverse=True)
        local, response, intake, change = memory.of_steps(lengths)
        # beside the motion one with the velocity 1, which terms above order 1 subtract
        (n, m), k = velocity.shape[:2], len(memory.terms)
        moved = velocity.reshape(n, m, -1).swapaxes(1, 2)
        if any(map(_is_relative, memory.terms)):
            moved = np.concatenate([moved, np.ones((n, 1, m))], axis=1)
        shape = moved.shape[:2]
        taken, plain = np.empty((*shape, memory.n_states)), np.empty((*shape, k, m))
        steps = [which == place for place in range(lengths.size)]
        for own, each in zip(steps, intake, strict=True):
            taken[own] = np.tensordot(moved[own], each, axes=(2, 1))
        path, decay = np.zeros_like(taken), 1.0 + change[which]
        for before, factor, own, after in zip(path, decay, taken, path[1:], strict=False):
            np.multiply(factor, before, after)
            after += own
        for own, each, by_state in zip(steps, local, response, strict=True):
            table = memory.weights[:, None] * by_state
            plain[own] = np.tensordot(path[own], table, axes=(2, 2))
            plain[own] += np.tensordot(moved[own], each, axes=(2, 2))
        found = []
        for one in scenes:
            total = np.zeros_like(velocity)
            for term, matrix in zip(_terms(one), _matrices(one), strict=True):
                force = plain[:, :, memory.terms.index(term)].swapaxes(1, 2)
                own = force[..., : velocity[0, 0].size].reshape(velocity.shape)
                if _is_relative(term):
                    start = np.broadcast_to(one.initial_velocity, velocity.shape[2:])
                    own = own - np.multiply.outer(force[..., -1], start)
                total += own @ matrix
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
        d, (n, m, _), p = self.d, self.steps.velocity.shape, len(change.position)
        position, velocity = np.empty((n + 1, d, p)), np.empty((n, m, d, p))
        position[0] = change.position.T
        end = np.concatenate([change.position.T, change.momentum.T])
        states = np.zeros((self._memory.n_states, d * p))
        loads = change.loads.transpose(1, 2, 3, 0)
        for own in self._parts():
            maps = self._maps(own)
            for step, (solved, which) in enumerate(zip(*maps[:2], strict=True), own.start):
                past = np.dot(maps.past[which], states).reshape(len(self.coefficients), -1, d, p)
                driven = loads[step] + np.matmul(self.coefficients[:, None], past).sum(axis=0)
                after = np.dot(solved, np.concatenate([end, driven.reshape(-1, p)]))
                end = after[: 2 * d]
                position[step + 1], velocity[step] = end[:d], after[2 * d :].reshape(m, d, p)
                states = maps.decay[which] * states
                states += np.dot(maps.intake[which], after[2 * d :].reshape(m, -1))
        return Tangent(position, velocity)

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
        to_loads = -lengths[:, None, None] * self.tables.to_loads
        weighted = self._memory.weights[self._rows][:, None, None] * response
        past = np.matmul(to_loads, weighted).swapaxes(0, 1)
        # a linear scene has one map for each length
        every, at = np.arange(which.size), which
        if self.scene.is_linear:
            every, at = which, np.arange(lengths.size)
        motion = (steps.stage_position, steps.velocity, steps.stage_time)
        points = [one[own][: at.size] for one in motion]
        damp = to_loads @ by_term.swapaxes(0, 1)[self._rows] @ self.tables.to_inputs
        solved = self._solved(lengths[at], damp[:, at], points)
        return Maps(
            solved=[solved[k] for k in every.tolist()],
            which=which.tolist(),
            past=np.concatenate(list(past.swapaxes(0, 1)), axis=1),
            intake=intake,
            decay=1.0 + change[..., None],
        )

    def _solved(self, sizes: Array, damp: Array, points: list[Array]) -> Array:
        """S of n steps: the solved equations of the engine under unit cases."""
        t, d, n = self.tables, self.d, sizes.size
        at, h = self.scene.derivatives(*points), sizes[:, None, None]
        step = dense_step(
            unit_tables(self.method, d, has_rates=True),
            Linearisation(at.mass, at.mixed, -at.stiffness),
            h,
            list(damp),
            list(self.coefficients[:, None]),
        )
        count = (3 + t.degree) * d
        x, p, loads = np.split(
            np.broadcast_to(np.eye(count), (n, count, count)), [d, 2 * d], axis=2
        )
        unknowns, dx, dp = step.solve(x, p, loads.reshape(n, count, t.degree + 1, d))
        velocity = np.matmul(t.to_inputs, unknowns).reshape(n, count, -1)
        return np.concatenate([x + dx, p + dp, velocity], axis=2).swapaxes(1, 2)


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
