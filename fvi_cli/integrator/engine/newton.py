r"""Newton's iteration on a single step or a block of steps, for all members at once.

With second derivatives that are fixed, the points of the steps are
``begin + fold . remainder(points)``. A single step has second derivatives at every point, which are
computed again where the iteration is slow; where it diverges, shorter steps of Newton find the
root, or the step fails. A block has one linearisation for all points, and fails where its iteration
does not contract.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fvi_cli.integrator.engine.block import Block, Rows
from fvi_cli.integrator.engine.law import Linearisation, StepLaw
from fvi_cli.integrator.engine.products import apply
from fvi_cli.mathematics.arrays import Array, Integers, Mask
from fvi_cli.mathematics.convergence import (
    ITERATIONS,
    NEGLIGIBLE,
    NOISE,
    SLOW,
    SMALLEST,
    UNIT,
    find_roots,
)

HALF_THE_DIGITS = UNIT**0.5  # larger relative changes that fall are progress, not round-off


class Linearised(NamedTuple):
    """Steps linearised about points, and the remainders at the points, ``(q, n r, w)``."""

    at: Linearisation
    block: Block
    rest: Array


Linearise = Callable[[Array], Linearised]
"""Linearise a single step at points ``(q, r w)``."""


class Solution(NamedTuple):
    """Rows of the steps, the last remainders ``(q, n r, w)``, and how the iteration ended."""

    rows: Rows
    rest: Array
    iterations: Integers  # of every member, (q,)
    failed: Mask
    finite: Mask  # whether the last points are finite


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """What n steps begin from."""

    law: StepLaw
    t: float
    x: Array  # position and momentum, (q, e)
    p: Array
    loads: Array  # (q, n, s + 1, e)
    live: Mask  # members to be solved

    def rows(self, block: Block, rest: Array | None = None) -> Rows:
        """Rows of the steps with given remainders."""
        loads, count = self.loads, self.loads.shape[1]
        if rest is not None:
            loads = loads + block.loads_of(rest, count)
        return block.solve(None, self.p, None, loads, count)

    def remainder(self, at: Linearisation, block: Block, points: Array) -> Array:
        """Remainders at points ``(q, n r w)``."""
        times = block.frame.unit.tables.points
        if self.law.has_rates:
            # other laws do not depend on the time
            steps = np.arange(self.loads.shape[1])[:, None]
            times = self.t + block.frame.h * (steps + times).ravel()
        width = self.x.shape[1] * (2 if self.law.has_rates else 1)
        return self.law.remainder(at, self.x, points.reshape(len(points), -1, width), times)


def largest(values: Array) -> Array:
    """The largest at the points, ``(q, n, w)`` to ``(q, w)``."""
    return np.asarray(np.maximum.reduce(values, axis=1))


def solve_block(problem: Problem, start: Linearised) -> Solution:
    """Solve a block; the iteration starts from the remainders in `start`."""
    at, block, rest = start
    begin, fold = _map_of(problem, block)
    points = begin + apply(fold, rest.reshape(len(rest), -1))
    rest = problem.remainder(at, block, points)
    return _iterate(problem, Linearised(at, block, rest), points, (begin, fold), None)


def solve_step(problem: Problem, points: Array, linearise: Linearise) -> Solution:
    """Solve a single step; the iteration starts from points ``(q, r w)``."""
    start = linearise(points)
    return _iterate(problem, start, points, _map_of(problem, start.block), linearise)


def _map_of(problem: Problem, block: Block) -> tuple[Array, Array]:
    """Points without remainders, ``(q, n r w)``, and their matrix by remainders."""
    begin = block.points_of(problem.rows(block))
    size = begin.shape[1]
    return begin, block.fold[:, :size, :size]


def _iterate(
    problem: Problem,
    linearised: Linearised,
    points: Array,
    to_points: tuple[Array, Array],
    linearise: Linearise | None,
) -> Solution:
    """Iterate until every component of every live member has converged.

    Changes must be negligible relative to displacements, since positions are compensated sums;
    where round-off prevents that, relative to the terms of the equations.
    """
    (at, block, rest), q, (begin, fold) = linearised, len(points), to_points
    shape, last = rest.shape, None
    iterating, failed, rescued = problem.live, np.zeros(q, dtype=bool), np.zeros(q, dtype=bool)
    iterations = np.zeros(q, dtype=np.int64)
    for _ in range(ITERATIONS):
        new_points = begin + apply(fold, rest.reshape(q, -1))
        change = largest(np.abs(new_points - points).reshape(shape))
        scale = largest(np.abs(new_points).reshape(shape))
        points = new_points
        iterations += iterating
        # the first change has none before it: it is the distance of the guess
        last = change / SLOW if last is None else last
        # the next change would be change^2 / last
        converged = change * change <= NEGLIGIBLE * scale * last
        slow = ~(converged | (change <= SLOW * last))
        stuck = iterating & np.logical_or.reduce(slow, axis=1)
        if np.count_nonzero(stuck):
            per_scale = 1.0 / np.maximum(scale, SMALLEST)
            worst = (per_scale * change).max(axis=1)
            rises = ~(worst < (per_scale * last).max(axis=1))
            # large changes that fall are no round-off
            if (stuck & (rises | (worst < HALF_THE_DIGITS))).any():
                terms = np.abs(rest) + at.terms_of(problem.x, points.reshape(shape))
                terms = block.round_off(problem.p, problem.loads, terms) + np.abs(points)
                converged |= slow & (change <= NOISE * UNIT * largest(terms.reshape(shape)))
                stuck &= (slow & ~converged).any(axis=1)
            rises &= stuck
        last = change
        iterating = iterating & ~np.logical_and.reduce(converged, axis=1)
        if np.count_nonzero(stuck):
            lost = rises
            if linearise is not None:
                lost = rises & rescued
                if (rescue := rises & ~rescued).any():
                    points, is_root = _by_shorter_steps(problem, block, points, rescue, linearise)
                    lost |= rescue & ~is_root
                    rescued |= rescue
                (at, block, rest), last = linearise(points), None
                begin, fold = _map_of(problem, block)
            failed |= lost
            iterating &= ~lost
        if not np.count_nonzero(iterating):
            break
        if last is not None:
            rest = problem.remainder(at, block, points)
    finite = np.asarray(np.isfinite(change).all(axis=1))
    return Solution(problem.rows(block, rest), rest, iterations, failed | iterating, finite)


def _by_shorter_steps(
    problem: Problem, block: Block, points: Array, members: Mask, linearise: Linearise
) -> tuple[Array, Mask]:
    """Points of some members at a root, by shorter steps of Newton from uniform motion on.

    Corrections must fall (:func:`find_roots`): steps that only reduce the residual may jump over a
    singularity of the motion, to a root beyond it.
    """
    (q, e), c = problem.x.shape, block.frame.unit.tables.control_points[1:]
    identity = np.broadcast_to(np.eye(c.size * e), (q, c.size * e, c.size * e))
    none = np.zeros((q, 1, e))

    def points_of(u: Array) -> Array:
        return block.points_of(Rows(u.reshape(q, 1, -1, e), none, none))

    def evaluate(u: Array) -> tuple[Array, Array, Array]:
        step = linearise(points_of(u))
        residual = u - problem.rows(step.block, step.rest).unknowns.reshape(q, -1)
        residual[~members] = np.nan
        return residual, identity, np.abs(u)

    velocity = problem.law.velocity(problem.x, problem.p, problem.t)
    root, found, _ = find_roots(evaluate, (c[:, None] * velocity[:, None]).reshape(q, -1))
    return np.where(found[:, None], points_of(root), points), found
